"""From many names to few patterns: "sliding/texture_01/P1_force.csv", .. to "sliding/{surface}/P{explorer}_force.csv".

Everything here is a guess from names alone (recipe), and is reported as one.
"""

import re
from collections import defaultdict
from dataclasses import dataclass, field

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
_LITERAL_WORDS = {*_CONTENT_OF_WORD, *OTHER_WORDS, *(word for word in _FIELD_OF_WORD if len(word) > 1)}
_JOINERS = "-_ +&,()"
#: Numbers (with a decimal point), words (parts of camelCase apart), single other characters.
_TOKEN = re.compile(r"\d+(?:\.\d+)?|[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[^\W\d_]|.", re.DOTALL)
#: In the classes of tokens: words that may vary with what joins them, and numbers that touch them.
_WORD_RUN = re.compile(r"#?@([-_ +&,()]*@)*#?")
_LAST_WORD = re.compile(r"([A-Za-z]+)[-_ ]*$")
_EXTENSION = re.compile(r"(.*?)(\.[A-Za-z]\w*)?", re.DOTALL)


@dataclass
class NameField:
    """A part of names that varies: `bare` is its value in each name.

    The text `before` and `after` it is part of the value if `whole`. The words beside it give a `hint`, a key of
    `FIELD_WORDS` or "condition"; `role` is its name in the pattern, "" = not decided.
    """

    bare: list[str]
    before: str = ""
    after: str = ""
    whole: bool = False
    hint: str | None = None
    role: str = ""

    @property
    def values(self):
        """The value in each name."""
        return [f"{self.before}{value}{self.after}" for value in self.bare] if self.whole else self.bare

    @property
    def distinct(self):
        """Values, each once, "9" before "10"."""
        parts = {value: re.split(r"(\d+)", value) for value in self.values}
        return sorted(parts, key=lambda value: [(p.isdigit(), int(p) if p.isdigit() else p) for p in parts[value]])

    @property
    def text(self):
        """As it stands in the pattern."""
        name = f"{{{self.role or 'part'}}}"
        return name if self.whole else f"{_literal(self.before)}{name}{_literal(self.after)}"

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
        return "".join(_literal(item) if isinstance(item, str) else item.text for item in self.items)

    @property
    def words(self):
        """Words of the parts that do not vary, lower case."""
        return words_of(" ".join(item for item in self.items if isinstance(item, str)))

    def by_value(self, varying):
        """One group for each value of a field."""
        parts = defaultdict(list)
        for name, value in zip(self.names, varying.bare, strict=True):
            parts[value].append(name)
        return [_make_group(names) for names in parts.values()]


def _literal(text):
    """Text in a pattern: what has a meaning there becomes "*", which matches anything."""
    return re.sub(r"[{}*\\]", "*", text)


def words_of(text):
    """Words of a text, camelCase apart, lower case: `list[str]`."""
    return [token.lower() for token in _TOKEN.findall(text) if token[0].isalpha()]


def content_of(words):
    """What a file holds by its words: the key of `CONTENT_WORDS` of the last known word, or `None`."""
    return next((_CONTENT_OF_WORD[word] for word in reversed(words) if word in _CONTENT_OF_WORD), None)


def group_names(names):
    """Groups names (paths of files, or of places inside a file) of the same kind, in the order of the first."""
    groups = defaultdict(list)
    for name in names:
        groups[_skeleton(name)].append(name)
    return [_make_group(members) for members in groups.values()]


def _components(name):
    """Tokens of each component of a path, and the extension."""
    stem, extension = _EXTENSION.fullmatch(name).groups("")
    return [_TOKEN.findall(component) for component in stem.split("/")], extension


def _classes(tokens):
    """One character a token: "#" a number, "@" a word that may vary, "w" one that does not, else itself."""
    classes = ""
    for token, following in zip(tokens, [*tokens[1:], "."], strict=False):
        if token[0].isdigit():
            classes += "#"
        elif not token[0].isalpha():
            classes += token
        elif token.lower() in _LITERAL_WORDS or (len(token) == 1 and following[0].isdigit()):
            classes += "w"
        else:
            classes += "w" if classes[-1:] == "#" and token.lower() in UNIT_WORDS else "@"  # 10000Hz
    return classes


def _chunks(tokens):
    """Tokens, where words that may vary with what joins them, and numbers that touch them, are one; their classes."""
    classes, chunks, end = _classes(tokens), [], 0
    for run in _WORD_RUN.finditer(classes):
        chunks += tokens[end : run.start()] + ["".join(tokens[run.start() : run.end()])]
        end = run.end()
    return chunks + tokens[end:], _WORD_RUN.sub("@", classes)


def _skeleton(name):
    """What names of one kind share. A folder whose name may vary matches any other."""
    (*folders, stem), extension = _components(name)
    shape = ["@" if set(_classes(tokens)) & set("#@") else "".join(tokens) for tokens in folders]
    chunks, classes = _chunks(stem)
    fixed = [chunk for chunk, kind in zip(chunks, classes, strict=True) if kind == "w"]
    return tuple(shape), classes, tuple(fixed), extension


def _make_group(names):
    rows = [_components(name) for name in names]
    count = len(rows[0][0])
    items, parent = [], ""
    for place in range(count):
        is_folder = place < count - 1
        part = _component_items([components[place] for components, _ in rows], is_folder, parent)
        parent = part[0] if len(part) == 1 and isinstance(part[0], str) else ""
        items += [*part, "/" if is_folder else rows[0][1]]
    return NameGroup(names, items)


def _component_items(rows, is_folder, parent):
    """Items of one component of the paths; `parent` is the name of the folder it is in, "" where that varies."""
    if len({_classes(row) for row in rows}) > 1:
        rows = [_chunks(row)[0] for row in rows]
    if len({len(row) for row in rows}) > 1:
        rows = [["".join(row)] for row in rows]
    items = []
    for column in zip(*rows, strict=True):
        known = column[0][0].isdigit() and items and isinstance(items[-1], str) and _field_word(items[-1])
        if known or len(set(column)) > 1:
            items = _appended(items, NameField(list(column)))
        elif items and isinstance(items[-1], str):
            items[-1] += column[0]
        else:
            items.append(column[0])
    fields = [i for i, item in enumerate(items) if isinstance(item, NameField)]
    for i in fields:
        _look_beside(items, i, parent)
    if is_folder and len(fields) == 1:  # a folder's name is a name as a whole
        (i,), varying = fields, items[fields[0]]
        varying.before, varying.after = "".join(items[:i]) + varying.before, "".join(items[i + 1 :])
        varying.whole = True
        return [varying]
    return items


def _field_word(text):
    """Match of the last word of a text if it is one of `FIELD_WORDS` (one letter only if it ends the text)."""
    found = _LAST_WORD.search(text)
    word = found.group(1).lower() if found else ""
    known = word in _FIELD_OF_WORD and (len(word) > 1 or found.group(0) == found.group(1))
    return found if known else None


def _appended(items, new):
    """Appends a field; joins it with the one before if they touch, or one follows from the other ("0007-glass")."""
    between = items[-1] if items and isinstance(items[-1], str) else ""
    rest = items[:-1] if between else items
    if not rest or between.strip(_JOINERS):
        return [*items, new]
    pairs = list(zip(rest[-1].bare, new.bare, strict=True))
    if between and len(set(pairs)) > max(len(set(rest[-1].bare)), len(set(new.bare))):
        return [*items, new]
    return _appended(rest[:-1], NameField([f"{first}{between}{second}" for first, second in pairs]))


def _look_beside(items, i, parent):
    """Sets the hint of a field from the words beside it."""
    varying, after = items[i], items[i + 1] if i + 1 < len(items) else ""
    if i and isinstance(items[i - 1], str) and (found := _field_word(items[i - 1])):
        varying.hint, varying.before = _FIELD_OF_WORD[found.group(1).lower()], found.group(0)
        items[i - 1] = items[i - 1][: found.start()]
    elif isinstance(after, str) and after[:1].isalpha() and words_of(after)[0] in UNIT_WORDS:
        varying.hint = "condition"
    elif parent and (words := words_of(parent)):
        varying.hint = _FIELD_OF_WORD.get(words[-1]) or _FIELD_OF_WORD.get(words[-1].removesuffix("s"))


def assign_roles(fields):
    """Decides which field is the surface, the explorer and the trial; what is left are parts of the trial.

    Sets the `role` of each; returns what was only guessed.
    """
    doubts, roles = [], {}
    for item in sorted(fields, key=lambda item: len((words_of(item.before) or [""])[-1]) == 1):  # whole words first
        if item.hint in FIELD_WORDS and item.hint not in roles:
            roles[item.hint] = item
        elif item.hint == "surface" and item.before.lower() == "s":  # S1 beside a texture is a subject
            roles.setdefault("explorer", item)
    rest = [item for item in fields if not any(item is other for other in roles.values())]
    free = [item for item in rest if item.hint is None]
    if "surface" not in roles and free:
        surface = max(free, key=lambda item: (not "".join(item.distinct).isdigit(), len(item.distinct)))
        roles["surface"] = surface
        rest = [item for item in rest if item is not surface]
        doubts.append(f"{surface} taken as the surface: it has the most values, or words")
    for role, item in roles.items():
        item.role = role
    parts = [item for item in fields if any(item is other for other in (*rest, roles.get("trial")))]
    for number, item in enumerate(parts, 1):
        item.role = "trial" if len(parts) == 1 else f"trial.{number}"
    if rest:
        doubts.append(f"{'; '.join(map(str, rest))} taken as the trial: no word says what it is")
    return doubts
