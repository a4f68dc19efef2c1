"""From many names to few patterns: "sliding/texture_01/P1_force.csv", .. to "sliding/{surface}/P{explorer}_force.csv".

A name is cut into numbers, words and single characters. Names that differ only in numbers and in words without a known
meaning are of one kind, and each part that differs between them is a field. The word before a field, or the folder
that it is in, says what it is. Everything here is a guess from names alone (recipe), and is reported as one.
"""

import re
from collections import defaultdict
from dataclasses import dataclass, field
from os.path import commonprefix

#: What a varying part of a name probably is, by the word before it; plurals count too.
FIELD_WORDS = {
    "surface": "surface surf texture tex material mat sample specimen stimulus stim s".split(),
    "explorer": "explorer participant subject subj sub user finger person rater p".split(),
    "trial": "trial rep repeat repetition run take block session t r".split(),
}
#: Words of units: a number before one is a condition of the trial, such as a speed.
UNIT_WORDS = "hz khz n mn gf mm cm um mms mmps ms s deg rpm".split()
#: Words that say what a file holds: two files that differ in them are of two kinds.
CONTENT_WORDS = {
    "force": "force forces ft ati loadcell load nano wrench".split(),
    "lateral": "lateral friction tangential shear".split(),
    "torque": "torque torques moment".split(),
    "position": "position positions pos stage track tracking trajectory mocap displacement".split(),
    "velocity": "velocity velocities vel speed".split(),
    "acceleration": "acceleration acc accel accelerometer imu".split(),
    "sound": "audio sound mic microphone".split(),
    "ratings": "rating ratings answers questionnaire perception perceptual scores".split(),
}
#: Words of the stage of an experiment or of a kind of exploration: never the name of a surface.
OTHER_WORDS = (
    "data raw processed filtered calibrated signal signals sensor sensors recording recordings record motion "
    "sliding slide static tapping tap pressing press pressure contact stroke circular free x y z".split()
)
_FIELD_OF_WORD = {word: role for role, words in FIELD_WORDS.items() for word in words}
_CONTENT_OF_WORD = {word: content for content, words in CONTENT_WORDS.items() for word in words}
_FIXED_WORDS = {*_CONTENT_OF_WORD, *OTHER_WORDS, *(word for word in _FIELD_OF_WORD if len(word) > 1)}
#: Numbers (with a decimal point), words (parts of camelCase apart), single other characters.
_TOKEN = re.compile(r"\d+(?:\.\d+)?|[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[^\W\d_]|.", re.DOTALL)
#: In the kinds of tokens: words that may vary with what joins them, and numbers that touch them, are one name.
_NAME = re.compile(r"#?@([-_ +&,()]*@)*#?")
_EXTENSION = re.compile(r"(.*?)(\.[A-Za-z]\w*)?", re.DOTALL)


@dataclass(eq=False)
class NameField:
    """A part of names that varies: its value in each name, and the `word` before it.

    `hint` is what the words beside it say, a key of `FIELD_WORDS` or "condition"; `role` is its name in the pattern,
    "" = not decided.
    """

    values: list[str]
    word: str = ""
    hint: str | None = None
    role: str = ""

    @property
    def distinct(self):
        """Values, each once, "9" before "10"."""
        parts = {value: re.split(r"(\d+)", value) for value in self.values}
        return sorted(parts, key=lambda value: [(p.isdigit(), int(p) if p.isdigit() else p) for p in parts[value]])

    def __str__(self):
        distinct = self.distinct
        return f"{', '.join(distinct[:3])}{', ..' * (len(distinct) > 3)} ({len(distinct)} values)"


@dataclass
class NameGroup:
    """Names of one kind: `items` are literal texts and `NameField`s, `names` the names themselves."""

    names: list[str]
    items: list = field(default_factory=list)

    @property
    def fields(self):
        return [item for item in self.items if isinstance(item, NameField)]

    @property
    def pattern(self):
        """The text of a `Pattern`; "*" stands for fields without a role and for characters with a meaning there."""
        text = ""
        for item in self.items:
            if isinstance(item, str):
                text += re.sub(r"[{}\\]", "*", item)
            else:
                text += f"{{{item.role}}}" if item.role else "*"
        return text

    @property
    def words(self):
        """Words of the parts that do not vary, lower case."""
        return words_of(" ".join(item for item in self.items if isinstance(item, str)))

    def by_value(self, varying):
        """One group for each value of a field."""
        return _grouped(zip(varying.values, self.names, strict=True))


def words_of(text):
    """Words of a text, camelCase apart, lower case: `list[str]`."""
    return [token.lower() for token in _TOKEN.findall(text) if token[0].isalpha()]


def content_of(words):
    """What a file holds by its words: the key of `CONTENT_WORDS` of the last known word, or `None`."""
    return next((_CONTENT_OF_WORD[word] for word in reversed(words) if word in _CONTENT_OF_WORD), None)


def group_names(names):
    """Groups names (paths of files, or of places inside a file) of the same kind, in the order of the first."""
    return _grouped((_kind_of_name(name), name) for name in names)


def _grouped(keyed):
    groups = defaultdict(list)
    for key, name in keyed:
        groups[key].append(name)
    return [_named_group(names) for names in groups.values()]


def _split(name):
    """The components of a path, and the extension."""
    stem, extension = _EXTENSION.fullmatch(name).groups("")
    return stem.split("/"), extension


def _pieces(text):
    """Pieces of a text and their kinds: "#" a number, "@" a name that may vary, "w" a fixed word, else itself."""
    tokens, kinds = _TOKEN.findall(text), ""
    for token, following in zip(tokens, [*tokens[1:], "."], strict=False):
        word = token.lower()
        if token[0].isdigit():
            kinds += "#"
        elif not token[0].isalpha():
            kinds += token
        elif word in _FIXED_WORDS or (len(token) == 1 and following[0].isdigit()):
            kinds += "w"
        else:
            kinds += "w" if kinds[-1:] == "#" and word in UNIT_WORDS else "@"  # 10000Hz
    pieces, end = [], 0
    for run in _NAME.finditer(kinds):
        pieces += tokens[end : run.start()] + ["".join(tokens[run.start() : run.end()])]
        end = run.end()
    return pieces + tokens[end:], _NAME.sub("@", kinds)


def _kind_of_name(name):
    """What names of one kind share. A folder whose name may vary matches any other."""
    (*folders, stem), extension = _split(name)
    pieces, kinds = _pieces(stem)
    fixed = tuple(piece for piece, kind in zip(pieces, kinds, strict=True) if kind == "w")
    return tuple("@" if set("#@") & set(_pieces(f)[1]) else f for f in folders), kinds, fixed, extension


def _named_group(names):
    rows, items, parent = [_split(name) for name in names], [], ""
    columns = list(zip(*(components for components, _ in rows), strict=True))
    for place, column in enumerate(columns):
        is_folder = place < len(columns) - 1
        items += [*_items(column, is_folder, parent), "/" if is_folder else rows[0][1]]
        parent = column[0] if len(set(column)) == 1 else ""
    return NameGroup(names, items)


def _items(texts, is_folder, parent):
    """Literal texts and fields of one component of the paths, in a folder called `parent` ("" if that varies)."""
    inherited = next(
        (_FIELD_OF_WORD.get(w) or _FIELD_OF_WORD.get(w.removesuffix("s")) for w in words_of(parent)[-1:]), None
    )
    rows, items = [_pieces(text) for text in texts], []
    if len({kinds for _, kinds in rows}) > 1:
        return [NameField(list(texts), hint=inherited)]
    columns = list(zip(*(pieces for pieces, _ in rows), strict=True))
    for column, kind, (following, *_) in zip(columns, rows[0][1], [*columns[1:], [""]], strict=False):
        before = items[-1] if items and isinstance(items[-1], str) else ""
        word = _field_word(before)
        if len(set(column)) > 1 or (kind == "#" and word):
            shared = re.match(r"(.*[-_ ])?", commonprefix(column)).group()  # such as "mystudy_" of "mystudy_felt"
            if shared:
                items[len(items) - bool(before) :] = [before + shared]
                column = [text.removeprefix(shared) for text in column]
            ending = _shared_ending(column)
            column = [text.removesuffix(ending) for text in column]
            condition = "condition" if following.lower() in UNIT_WORDS else inherited
            items.append(NameField(list(column), word, _FIELD_OF_WORD.get(word, condition)))
            items += [ending] * bool(ending)
        elif before:
            items[-1] += column[0]
        else:
            items.append(column[0])
    fields = [item for item in items if isinstance(item, NameField)]
    main = max(fields, key=lambda item: len(set(item.values)), default=None)
    if is_folder and main and len(set(texts)) == len(set(main.values)):  # one name, such as texture_01 or 0007-glass
        return [NameField(list(texts), main.word, main.hint)]
    return items


def _shared_ending(texts):
    """What all names end with, from a separator on, such as "_Kraft" of "Glas_Kraft"; "" of a single name."""
    if len(set(texts)) < 2:
        return ""
    shared = commonprefix([text[::-1] for text in texts])[::-1]
    return re.search(r"([-_ ].*)?$", shared).group()


def _field_word(text):
    """The last word of a text if it is one of `FIELD_WORDS` (a letter must end the text), else ""."""
    word, joined = re.search(r"([A-Za-z]*)([-_ ]*)$", text).groups()
    return word.lower() if word.lower() in _FIELD_OF_WORD and (len(word) > 1 or not joined) else ""


def assign_roles(fields):
    """Decides which field is the surface, the explorer and the trial; what is left are parts of the trial.

    Sets the `role` of each; returns what was only guessed.
    """

    def likeness(item):
        free, worded = item.hint is None, not "".join(item.distinct).isdigit()
        return item.hint == "surface" and item.word != "s", free and worded, item.word == "s", free, len(item.distinct)

    doubts, rest = [], list(fields)
    surface = max(rest, key=likeness, default=None)
    if surface is not None and surface.hint in ("surface", None):
        surface.role = "surface"
        rest.remove(surface)
        if surface.hint is None:
            doubts.append(f"{surface} taken as the surface: it has the most values, or words")
    persons = [item for item in rest if item.hint == "explorer" or item.word == "s"]  # S1 beside a texture is a subject
    if persons:
        explorer = max(persons, key=lambda item: len(item.word))
        explorer.role = "explorer"
        rest.remove(explorer)
    for number, item in enumerate(rest, 1):
        item.role = "trial" if len(rest) == 1 else f"trial.{number}"
    unknown = [item for item in rest if item.hint != "trial"]
    if unknown:
        doubts.append(f"{'; '.join(map(str, unknown))} taken as the trial: no word says what it is")
    return doubts
