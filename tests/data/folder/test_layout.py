"""layout.toml: what is written is what is read, and what is wrong is named by key."""

import copy
import textwrap
import tomllib

import pytest

from tactile_diffusers.data.folder import layout as layout_module
from tactile_diffusers.data.folder import layout_text, load_layout
from tactile_diffusers.data.folder.sources import Pattern

EXAMPLE = textwrap.dedent(layout_module.__doc__.split("\n\n", 1)[1].split("\n\nThe classes below")[0])


@pytest.fixture
def load(tmp_path):
    def load(text):
        (tmp_path / "layout.toml").write_text(text, encoding="utf-8")
        return load_layout(tmp_path / "layout.toml")

    return load


def test_the_documented_example(load):
    layout = load(EXAMPLE)
    force, stage = layout.files
    assert layout.source == "our tribometer, 2024" and layout.licence == "CC BY 4.0"
    assert force.pattern.names == ("surface", "explorer", "trial") and force.kind == "csv"
    assert force.rate == 10_000 and force.force.normal_sign == -1 and force.force.columns == ("Fx", "Fy", "Fz")
    assert force.columns == ("t", "Fx", "Fy", "Fz") and force.channels == ("force",)
    assert stage.rate is None and stage.time.scale == 1e-3 and stage.position.scale == 1.0
    assert (layout.velocity.window, layout.velocity.order) == (0.05, 2)
    assert layout.ratings.is_turned("roughness") and layout.ratings.missing == ["", "NA"]
    assert layout.surface_names == {"Sandpaper P80": "12"} and layout.path.name == "layout.toml"


@pytest.mark.parametrize("unit, scale", [("N", 1.0), ("mN", 1e-3), ("gf", 9.80665e-3), ("1", 1.0)])
def test_units_one_axis_and_indices(load, unit, scale):
    layout = load(EXAMPLE.replace('unit = "N"', f'unit = "{unit}"').replace('unit = "mm"', 'unit = "cm"'))
    assert layout.files[0].force.scale == scale and layout.files[1].position.scale == 10.0
    force, position = (
        next(line for line in EXAMPLE.splitlines() if line.startswith(name)) for name in ("force", "pos")
    )
    text = EXAMPLE.replace(force, f'lateral = {{ column = 0, unit = "{unit}", scale = 2.5 }}')
    layout = load(text.replace(position, 'velocity = { x = 3, unit = "m/s" }'))
    assert layout.files[0].lateral.columns == (0,) and layout.files[0].lateral.scale == 2.5 * scale
    assert layout.files[1].velocity.columns == (3,) and layout.files[1].velocity.scale == 1000.0


#: What stands in the example -> what stands there instead, and how it is refused.
FAULTS = {
    'unit = "ms"': ('unit = "min"', r"`\[\[files\]\] 2, time.unit` = 'min': Input should be 's', 'ms' or 'us'"),
    'pattern = "{surface}/P{explorer}_{trial}_force': ('pattern = "/{surface}_force', "1, pattern` = .*relative path"),
    'pattern = "{surface}/P{explorer}_{trial}_stage': ('pattern = "../{surface}_stage', "2, pattern.*without '..'"),
    "{surface}/P{explorer}_{trial}_force": ("P{explorer}_{trial}_force", r"must hold \{surface\}"),
    "P{explorer}_{trial}_stage": ("P{explorer_{trial}_stage", "brace without its partner"),
    "_force.csv": ("_force.bin", "1, kind`: Input should be 'csv', 'hdf5'"),
    "rate = 10000": ("rate = 0", "rate` = 0: Input should be greater than 0"),
    "normal_sign = -1": ("normal_sign = 2", "normal_sign` = 2: Input should be 1 or -1"),
    "offset = 0.0": ("offset = nan", "offset` = nan: Input should be a finite number"),
    "order = 2": ("order = 0", "`velocity.order` = 0"),
    "rate = 10000 ": ("rte = 10000 ", "rte` = 10000: is no key of a layout, did you mean `rate`"),
    "rate = 10000   ": ('delimiter = ", "', "delimiter` = ', '"),
    'z = "Fz"': ('z = "Fx"', "force`: the columns .* must differ"),
    ', z = "Fz"': ("", "force.z`: Field required"),
    "position = ": ("velocit = ", "velocit`: is no key of a layout, did you mean `velocity`"),
    'position = { x = "px", y = "py", unit = "mm" }': ("", "give `force`, `lateral`, `position` or `velocity`"),
    "version = 1": ("version = 2", "`version` = 2: Input should be 1"),
    'source = "our': ('source = "TODO our', "`source` = 'TODO our tribometer, 2024' is still to be filled in"),
    'x = "px"': ('x = "TODO"', r"`\[\[files\]\] 2, position.x` = 'TODO' is still to be filled in"),
    'form = "long"': ('form = "wide"', r"needs \{axis\}"),
    "scale = [0, 8]": ("scale = [8, 0]", "`scale` must be the smallest and the largest"),
    'high = "smooth"': ('high = "soft"', "axes.roughness: `words` must be smooth and rough, `high` one of them"),
    'rater = "participant"': ("", "`rater` is missing"),
    'format = "tactile-layout"': ("format = tactile", "cannot be read as TOML"),
    'time = { column = "t", unit = "s" }': ('sheet = "a"', "`sheet` is for xlsx, not for csv"),
}


@pytest.mark.parametrize("old", FAULTS)
def test_faults_are_named(load, old):
    new, message = FAULTS[old]
    assert old.strip() in EXAMPLE
    with pytest.raises(ValueError, match=f"(?s)layout.toml.*{message}"):
        load(EXAMPLE.replace(old.strip(), new.strip(), 1))


def test_all_faults_are_named_at_once(load):
    with pytest.raises(ValueError, match="(?s)unit` = 'min'.*\n.*window` = -1"):
        load(EXAMPLE.replace('"ms"', '"min"').replace("window = 0.05", "window = -1"))


def test_channels_must_make_a_recording(load):
    force, _, rest = EXAMPLE.partition("[[files]]                  #")[2].partition("[[files]]")
    head, stage = EXAMPLE.split("[[files]]", 1)[0], "[[files]]" + rest.split("[velocity]")[0]
    counts = stage + 'lateral = { column = "f", unit = "1" }\n'
    for text, message in (
        (stage, "neither `force` nor `lateral`"),
        ("[[files]] #" + force, "the sliding direction is unknown"),
        (stage + 'velocity = { x = "a", unit = "m/s" }', "`position` and `velocity` exclude each other"),
        (counts + stage + 'lateral = { column = "g", unit = "N" }\n', "keep counts and newtons in two layouts"),
    ):
        with pytest.raises(ValueError, match=message):
            load(head + text)


@pytest.mark.parametrize(
    "pattern, path, fields",
    [
        ("{surface}/P{explorer}_{trial}.csv", "wood/P1_07.csv", {"surface": "wood", "explorer": "1", "trial": "07"}),
        ("{surface}/*_{surface}.csv", "a/x_a.csv", {"surface": "a"}),
        ("{surface}/*_{surface}.csv", "a/x_b.csv", None),
        ("{surface}.csv", "a/b.csv", None),
        ("{surface}_{trial.speed}_*_{trial.repeat}.csv", "3_40_x_0.csv", {"surface": "3", "trial": "40_0"}),
        ("a+({surface}).csv", "a+(b).csv", {"surface": "b"}),
        ("{surface}.csv", ".csv", None),
    ],
)
def test_patterns(pattern, path, fields):
    assert Pattern(pattern).match(path) == fields


ODD_VALUES = (None, True, -1, 10**300, float("nan"), "", "x", "..", "{", [], [1], ["a"], {}, {"a": 1}, [{}])


def places(value, path=()):
    """Paths of all keys and items inside nested tables."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for name, item in items:
        yield (*path, name)
        yield from places(item, (*path, name))


CONTENT = tomllib.loads(EXAMPLE)


@pytest.mark.parametrize("path", list(places(CONTENT)), ids=str)
def test_any_odd_value_is_accepted_or_named(tmp_path, monkeypatch, path):
    """Whatever stands in a layout: a layout, or a ValueError that names the file; never another exception."""
    (tmp_path / "layout.toml").write_text("")
    for value in ODD_VALUES:
        content = copy.deepcopy(CONTENT)
        *parents, last = path
        inner = content
        for name in parents:
            inner = inner[name]
        inner[last] = value
        if value is None:  # TOML has none: the key is not there
            del inner[last]
        monkeypatch.setattr(layout_text.tomllib, "loads", lambda text, content=content: content)
        try:
            assert load_layout(tmp_path / "layout.toml").files
        except ValueError as error:
            assert "layout.toml" in str(error)
