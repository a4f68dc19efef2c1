"""Part of stability.py: cases of what goes in: precision, ratings, guidance, steps, levels, lengths, recordings."""

import itertools
import math

import numpy as np
import torch
from stability_bench import DECIBEL, RATINGS, SAME, SAME_DB, Row, level_error, not_finite, relative

from tactile_diffusers.signal import BAND_HZ, SEGMENT_SAMPLES, SEGMENT_SECONDS, band_pass, level, nine_band_error_db

#: Roundings of a coarser type that a texture may be off by.
ROUNDINGS = 5
HALF_DB, EIGHT_BITS_DB = 0.1, 0.5
#: Standard deviations of the training set within which what DALE generates once a texture is to lie: as far out as the
#: farthest of the bundled checkpoint's 40,584 training textures.
FAR = 9.0
#: Nine-band error that a fingertip tells apart (Israr, Tan and Reed 2006), dB.
FELT_DB = 2.2


def precision(bench):
    """The whole in float64; halves of the whole, of LCTG alone, in storage alone, by autocast."""
    yield from bench.against("float64", bench.make(bench.copy().to(torch.float64)), SAME)
    for dtype in (torch.bfloat16, torch.float16):
        name, bound = str(dtype).removeprefix("torch."), ROUNDINGS * torch.finfo(dtype).eps
        yield from bench.against(f"{name}, whole", bench.make(bench.copy().to(dtype)), bound, HALF_DB)
        pipe = bench.copy()
        pipe.lctg.to(dtype)
        yield from bench.against(f"{name}, LCTG alone", bench.make(pipe), bound, HALF_DB)
        with torch.autocast("cpu", dtype=dtype):
            made = bench.make()
        yield from bench.against(f"{name}, autocast", made, bound, HALF_DB)
        yield from bench.against(f"{name}, layerwise casting", bench.make(_stored(bench, dtype)), bound, HALF_DB)
    dtype = torch.float8_e4m3fn
    made, bound = bench.make(_stored(bench, dtype)), ROUNDINGS * torch.finfo(dtype).eps
    yield from bench.against("float8_e4m3fn, layerwise casting", made, bound, EIGHT_BITS_DB)


def _stored(bench, dtype):
    """A pipeline whose weights are kept in a type and computed with in float32."""
    pipe = bench.copy()
    for model in (pipe.lctg, pipe.dale):
        model.enable_layerwise_casting(storage_dtype=dtype, compute_dtype=torch.float32)
    return pipe


def ratings(bench):
    """One axis at a time and all at once, up to what is accepted; none."""
    yield from _within("none", bench, None, num_textures_per_rating=len(RATINGS))
    for size in (1.8, 3.0, 6.0):
        alone = [[sign * size if axis == n else None for n in range(3)] for axis in range(3) for sign in (-1, 1)]
        yield from _within(f"±{size:g}, one axis", bench, alone)
        together = [[size * sign for sign in signs] for signs in itertools.product((-1, 1), repeat=3)]
        yield from _within(f"±{size:g}, all axes", bench, together)


def guidance(bench):
    """From none to far too much, of some axes, and rescaled."""
    for scale in (0.0, 1.0, 1.5, 3.0, 10.0, 30.0, {"bumpiness": 3.0}, {"roughness": 3.0, "slipperiness": 0.0}):
        words = scale if isinstance(scale, dict) else {"all": scale}
        name = ", ".join(f"{axis} {number:g}" for axis, number in words.items())
        yield from _within(name, bench, RATINGS, guidance_scale=scale)
    for scale in (10.0, 30.0):
        yield from _within(f"all {scale:g}, rescaled", bench, RATINGS, guidance_scale=scale, guidance_rescale=1.0)


def _within(case, bench, wanted, **options):
    """Rows: whether what is generated from ratings lies near the training set, and is delivered at its level."""
    pipe, generator = bench.pipe, bench.generator()
    made = pipe(wanted, generator=generator, output_type="latent", **options)
    base, config = made.latents[:, : pipe.lctg.base_channels], pipe.dale.config
    # what DALE generates once a texture: mean cepstrum, level, log friction, in the training set's standard deviations
    scalars = pipe.dale.split_scalars(pipe.dale.pack(base, made.level, made.friction_coefficient))[1]
    friction = (made.friction_coefficient.log() - config.log_friction_mean) / config.log_friction_std
    out = pipe.decode(made.latents, made.level, made.friction_coefficient, generator=generator)
    yield Row(case, "RMS of the texture against its level", level_error(out), SAME_DB, "dB")
    for name, found in (("level", scalars[:, -2]), ("friction", friction), ("mean spectrum", scalars[:, :-2])):
        yield Row(case, f"{name}, from the training mean", float(found.abs().numpy().max(initial=0.0)), FAR, "std")


def steps(bench):
    """Both orders, each stage alone, against many steps of the second order from the same noise."""
    many = 100 if bench.quick else 1000
    counts = (1, 2, 3, 7, 10, 64) if bench.quick else (1, 2, 3, 7, 10, 64, 1000, 2000)
    latents, texture = _solve(bench, 2, many, None)
    for order in (1, 2):
        errors = {}
        for count in counts:
            made, decoded = _solve(bench, order, count, latents)
            errors[count] = relative(_rows(made), _rows(latents)), relative(decoded.textures, texture.textures)
            bands = nine_band_error_db(decoded.textures, texture.textures, decoded.sampling_rate).max()
            case = f"order {order}, {count} steps"
            yield Row(case, "values that are not finite", not_finite(made.latents, decoded.textures), 0, "")
            yield Row(case, "LCTG, nine-band error", float(bands), FELT_DB, "dB")
        for stage, name in enumerate(("DALE", "LCTG")):
            # a method of order p gains (64 / 10)^p; half of that, because networks are not smooth
            gained, bound = errors[64][stage] / errors[10][stage], 2 * (10 / 64) ** order
            yield Row(f"order {order}", f"{name}, error of 64 steps over that of 10", gained, bound, "")
            most = errors[counts[-1]][stage]
            yield Row(f"order {order}", f"{name}, error of {counts[-1]} steps over RMS", most, errors[64][stage], "")


def _solve(bench, order, count, latents):
    """DALE's latents, and textures decoded from given ones, or from these."""
    pipe = bench.copy()
    for name in ("scheduler", "dale_scheduler"):
        scheduler = getattr(pipe, name)
        setattr(pipe, name, type(scheduler).from_config(scheduler.config, multistep_order=order))
    pipe.dale.register_to_config(distilled_steps=None)  # what a distilled model solves has an order too
    made = pipe(RATINGS[:1], latents=bench.noise[:1], output_type="latent", num_latent_inference_steps=count)
    given = latents or made
    return made, pipe.decode(given.latents, given.level, num_inference_steps=count, noise=bench.decoder_noise[:1])


def _rows(latents):
    return latents.latents.flatten(1).numpy()


def levels(bench):
    """Very quiet and very loud: a texture scales with its level, latents do not depend on it."""
    pipe, reference = bench.pipe, bench.reference
    made = pipe(RATINGS, latents=bench.noise, output_type="latent")
    for number in (-12.0, -8.0, -4.0, 0.0, 3.0):
        out = pipe.decode(made.latents, torch.full_like(made.level, number), noise=bench.decoder_noise)
        scaled = reference.textures * np.exp(number - reference.level.astype(np.float64))[:, None]
        case = f"ln RMS of {number:g}"
        yield Row(case, "waveform against the scaled reference", relative(out.textures, scaled), SAME, "")
        yield Row(case, "RMS of the texture against its level", level_error(out), SAME_DB, "dB")
    textures = reference.textures.astype(np.float64)
    plain = pipe.encode(textures, reference.sampling_rate)
    for scale in (1e-6, 1e-3, 1e3, 1e6):
        coded = pipe.encode(scale * textures, reference.sampling_rate)
        error = np.abs((coded.level - plain.level).numpy() - math.log(scale)).max()
        yield Row(f"times {scale:g}", "latents of the encoder", relative(_rows(coded), _rows(plain)), SAME, "")
        yield Row(f"times {scale:g}", "level of the encoder", float(DECIBEL * error), SAME_DB, "dB")


def lengths(bench):
    """Generated from 0.05 s to ten minutes; reconstructed at lengths that fit nothing."""
    pipe = bench.pipe
    rate = pipe.feature_extractor.delivery_rate
    for seconds in (0.05, 0.1, 1.0, SEGMENT_SECONDS, 1.7, 3.3333, 10.0, *(() if bench.quick else (60.0, 600.0))):
        out = pipe(RATINGS[:1], duration_s=seconds, generator=bench.generator())
        yield from _delivered(f"generated, {seconds:g} s", out, round(seconds * rate))
        if seconds >= 10:
            parts = out.textures[0, : out.textures.shape[1] // 5 * 5].reshape(5, -1)
            drift = nine_band_error_db(parts[-1], parts[0], rate)
            case = f"generated, {seconds:g} s"
            yield Row(case, "last fifth against the first, nine-band", float(drift), FELT_DB, "dB")
    texture = pipe(RATINGS[:1], duration_s=5.0, generator=bench.generator()).textures[0]
    for samples in (2, 3, 61, 997, 7919, SEGMENT_SAMPLES - 1, SEGMENT_SAMPLES, SEGMENT_SAMPLES + 1, 49_999):
        piece = texture[:samples]
        out = pipe.reconstruct(piece, rate, generator=bench.generator())
        yield from _delivered(f"reconstructed, {samples} samples", out, samples)


def _delivered(case, out, samples):
    yield Row(case, "samples too many or too few", abs(out.textures.shape[-1] - samples), 0, "")
    yield Row(case, "RMS of the texture against its level", level_error(out), SAME_DB, "dB")


def inputs(bench):
    """Recordings that are none: reconstructed at their level, or refused."""
    pipe, samples = bench.pipe, SEGMENT_SAMPLES
    rate = pipe.feature_extractor.delivery_rate
    time = np.arange(samples) / rate
    noise = np.random.default_rng(bench.seed).standard_normal(samples)
    low, high = BAND_HZ
    given = {
        "one impulse": np.eye(1, samples, samples // 2)[0],
        "square wave of 100 Hz, full scale": np.sign(np.sin(2 * np.pi * 100 * time + 0.1)),
        "clipped noise": np.clip(10 * band_pass(noise, rate), -1, 1),
        **{f"tone of {hertz:g} Hz": np.sin(2 * np.pi * hertz * time) for hertz in (low, high - 1, high)},
        "white noise": noise,
        "noise with an offset": band_pass(noise, rate) + 100.0,
    }
    for name, signal in given.items():
        out = pipe.reconstruct(signal, rate, generator=bench.generator())
        wanted = level(_low_passed(signal, rate, pipe.feature_extractor.sampling_rate / 2))
        away = abs(DECIBEL * (level(out.textures[0]) - wanted))
        yield Row(name, "level against that below half the working rate", float(away), 0.5, "dB")
    flat = {"silence": np.zeros(samples), "a constant": np.full(samples, 0.7), "one sample": np.ones(1)}
    for name, signal in flat.items():
        out = pipe.reconstruct(signal, rate, generator=bench.generator())
        loudest = np.abs(out.textures).max() if len(out.textures[0]) == len(signal) else math.nan
        yield Row(name, "largest value of its reconstruction", float(loudest), 0.0, "N")
    bad = {"NaN": np.where(time == time[7], np.nan, noise), "infinity": np.where(time == time[7], np.inf, noise)}
    for name, signal in {**bad, "no samples": np.zeros(0)}.items():
        yield Row(name, "accepted, not refused by a ValueError", _accepted(pipe, signal, rate), 0, "")


def _low_passed(signal, rate, edge):
    """What lies above 0 Hz and below an edge."""
    spectrum, frequencies = np.fft.rfft(signal), np.fft.rfftfreq(len(signal), 1 / rate)
    return np.fft.irfft(spectrum * ((frequencies > 0) & (frequencies < edge)), n=len(signal))


def _accepted(pipe, signal, rate):
    try:
        pipe.encode(signal, rate)
    except ValueError:
        return 0
    return 1


def sampling_rates(bench):
    """The same vibration, sampled at many rates: the same latents. Tones, so that no resampling of ours is needed."""
    pipe, rng = bench.pipe, np.random.default_rng(bench.seed)
    tones = np.geomspace(BAND_HZ[0], 0.9 * BAND_HZ[1], 60) * rng.uniform(0.99, 1.01, 60)
    phases, deliver = rng.uniform(0, 2 * np.pi, 60), pipe.feature_extractor.delivery_rate

    def sampled(rate):
        time = np.arange(round(SEGMENT_SECONDS * rate)) / rate
        return sum(np.sin(2 * np.pi * tone * time + phase) / tone for tone, phase in zip(tones, phases, strict=True))

    reference = pipe.encode(sampled(deliver), deliver)
    for rate in (2500, 5000, 44_100, 48_000):
        coded = pipe.encode(sampled(rate), rate)
        away = DECIBEL * float((coded.level - reference.level).abs().max())
        yield Row(f"{rate} Hz", "level against that at the delivery rate", away, HALF_DB, "dB")
        out, wanted = (pipe.decode(one.latents, one.level, generator=bench.generator()) for one in (coded, reference))
        bands = nine_band_error_db(out.textures, wanted.textures, deliver).max()
        yield Row(f"{rate} Hz", "reconstructions, nine-band error", float(bands), HALF_DB, "dB")
    below = int(2 * BAND_HZ[1]) - 1
    yield Row(f"{below} Hz", "accepted, not refused by a ValueError", _accepted(pipe, sampled(deliver), below), 0, "")
