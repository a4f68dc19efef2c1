"""protocol.md: the stimuli, the instructions for participants, and the columns of the files."""

from .folder import KEY, KEY_COLUMNS, PRIVATE, STIMULI, TRIALS
from .study_report import label
from .trials import ABX, ENDS, RATING, SIMILARITY, TRIAL_COLUMNS

_LEVELS = {
    "matched": "Every texture of a surface was scaled to the RMS (of its samples, unweighted) of the surface's "
    "reference take and carries its friction coefficient: textures of one surface differ in everything but level and "
    "mean friction. Surfaces keep their own levels, so ratings of different surfaces still differ by level.",
    "natural": "Levels are as recorded or generated: textures of one surface may be told apart by level alone. "
    "Generated textures carry the friction coefficient that was generated, baselines that of the reference take.",
}
_TASKS = {
    ABX: 'ABX: "You will feel three textures, A, B and X. X is the same as A or the same as B. Which one? If you do '
    'not know, guess." Answer A or B. No feedback.',
    SIMILARITY: 'Similarity: "How alike do these two surfaces feel? 0: as unlike as can be. 100: the same surface." '
    "Say that two pieces of the same surface never feel exactly alike and still deserve a high number.",
    RATING: 'Ratings: "How ... does this surface feel?" One axis at a time, 0 to 8: '
    + ", ".join(f"{axis} 0 = {low}, 8 = {high}" for axis, (low, high) in ENDS.items())
    + ".",
}


def protocol_markdown(settings):
    """The protocol of a study.

    Args:
        settings (`dict`): of `experimenter/study.json`.

    Returns:
        `str`: Markdown.
    """
    conditions = ", ".join(label(condition) for condition in settings["conditions"])
    speed = settings["speed"]
    slide = "the speed of the recordings (unknown here)" if speed is None else f"about {speed:.0f} mm/s"
    attenuation = settings["attenuation_db"]
    reduced = (
        f"All were attenuated by {attenuation:.1f} dB to stay within it." if attenuation else "Nothing was attenuated."
    )
    return _PROTOCOL.format(
        checkpoint=settings["checkpoint"],
        data=settings["data"],
        source=settings["source"],
        surfaces=len(settings["surfaces"]),
        conditions=conditions,
        level=_LEVELS[settings["level"]],
        quietest=1e3 * settings["rms_n"][0],
        loudest=1e3 * settings["rms_n"][1],
        full_scale=settings["full_scale"],
        reduced=reduced,
        slide=slide,
        rate=settings["sampling_rate"],
        seconds=settings["seconds"],
        participants=settings["participants"],
        trials=settings["trials"],
        tasks="\n".join(f"- {_TASKS[task]}" for task in settings["tasks"]),
        trial_columns=_listed(TRIAL_COLUMNS),
        key_columns=_listed(KEY_COLUMNS),
        STIMULI=STIMULI,
        TRIALS=TRIALS,
        KEY=KEY,
        PRIVATE=PRIVATE,
    )


def _listed(columns):
    return "\n".join(f"| {name} | {words} |" for name, words in columns.items())


_PROTOCOL = """# Protocol

**Nothing here is a human result.** The files are stimuli and trial lists for a study that is still to be done.
This page is for the experimenter; participants hear only what is under "What to tell participants".

## What was made

Checkpoint `{checkpoint}`, data `{data}` ({source}). {surfaces} held-out surfaces, chosen to lie far apart in their
ratings. Of each: {conditions}. The reference take is what the others are compared with; another take is a second piece
of the same surface, the best that can be expected; generated textures were made from the surface's ratings alone;
a reconstruction went through encoder and decoder.

{level} Levels as played: {quietest:.2f} to {loudest:.2f} mN RMS.

Files: {seconds:.2f} s at {rate} Hz, `.wav` (16 bit, mono) with its scale in `.wav.json`, and `.npz` in newtons. All
WAV files have one scale: full scale is {full_scale:.4g} N of lateral force. {reduced} A display needs its own
conversion from newtons to drive (`tactile_diffusers.display.DriveProfile`). Whether the display clips, only the
display can tell: play the loudest file (largest `peak_n` in the key) before the first session.

## Blinding

Names in `{STIMULI}/` are random. Each texture is there twice, under unrelated names; the copy is only played as X of
ABX, so that a trial list does not tell the answer. `{PRIVATE}/` holds the key. Keep the key and the seed from
participants and from whoever runs the sessions until all answers are in. Files hold no rating and no seed, but an
analysis of their waveforms can show which belong together.

## What to tell participants

"You will feel textures on this display. Slide one finger over it at {slide}, without stopping, with a light and even
force. There are no right or wrong feelings." Mask the sound of the display (noise over headphones) and hide its screen.
Let everyone feel three textures of another seed first, for practice. Offer a break between tasks.

{tasks}

## Trials

`{TRIALS}/participant_001.csv` to `participant_{participants:03d}.csv`, {trials} answers each, in the order of the
rows. The order is random and differs between participants; which texture comes first is balanced. Tasks and axes change
places from participant to participant and are balanced over every six: use the lists in turn, from the first one on.

Fill in `response`, keep everything else, and save as CSV with commas (UTF-8) in one folder.

| column of a trial list | |
|---|---|
{trial_columns}

| column of `{KEY}` | |
|---|---|
{key_columns}

## Analysis

    python examples/make_study.py rehearse --study FOLDER --participants {participants}
    python examples/make_study.py analyse --study FOLDER --responses RESPONSES --output REPORT

Rehearse first: simulated participants show how often a study of this size would find the differences that you
assume. Decide on the number, the comparisons and the exclusion of participants before the first one comes, and write
them down (preregistration).

## Ethics

Get the approval of your ethics board before inviting anybody, and informed consent from everybody. Participants may
stop at any time, without giving a reason. Store no names with the answers. Check the electrical safety of the display
and start at low drive. Ask about skin conditions, injuries and numbness of the finger. If the surfaces are virtual, say
so wherever you publish: their textures are simulated.
"""
