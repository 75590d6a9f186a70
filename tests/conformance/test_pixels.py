"""The standard pixels are what their lines say, and a reader's own are read as written or refused with the place."""

import json
from fractions import Fraction
from itertools import pairwise

import pytest
from jsonschema import Draft202012Validator

from truemean.conformance import load_pixels, pixel_by_name, standard_pixels
from truemean.conformance.pixels import SCENES, SETS, VECTORS
from truemean.errors import InputError, SceneError, UnknownName
from truemean.oracle import Pixel, derive
from truemean.oracle.plans import catalogue
from truemean.oracle.scene import load_scene

SCHEMA = json.loads((VECTORS / "pixels.schema.json").read_text(encoding="utf-8"))
SHIPPED = sorted(VECTORS.glob("[!p]*.json"))


def test_the_first_set():
    pixels = standard_pixels()
    white = [
        pixels[name].mean for name in ("thin", "eighth", "quarter", "half", "three-quarters", "seven-eighths", "gap")
    ]
    assert white == [Fraction(w) for w in ("1/64", "1/8", "1/4", "1/2", "3/4", "7/8", "63/64")]
    assert [len(pixels[name].values) for name in ("three-tones", "eight-tones", "constant")] == [3, 8, 1]


def test_colours_of_equal_luminance():
    colours = standard_pixels()["equal-luminance"].values
    assert len({2126 * r + 7152 * g + 722 * b for r, g, b in colours}) == 1
    assert len(colours) > 1


def test_the_hard_set():
    hard = standard_pixels("hard")
    assert min(hard["offset"].values) == 10**8
    assert dict(hard["rare-bright"].law) == {0: Fraction(999, 1000), 1000: Fraction(1, 1000)}
    assert hard["nearly-equal"].scale == Fraction(1, 10**6)


def test_pixels_near_the_thresholds_of_renderers():
    hard = standard_pixels("hard")
    dark, *bright = hard["near-threshold"].values
    for differ in (lambda b: b - dark, lambda b: (b - dark) / (b + dark)):
        below, above = map(differ, bright)
        assert Fraction("0.299") <= below < Fraction("0.3") < above <= Fraction("0.301")
    X = hard["near-noise"]
    assert 1.96 * (X.variance / 32) ** 0.5 / X.mean == pytest.approx(0.05, rel=1e-3)


def test_pixels_beyond_the_unit_cube():
    hard = standard_pixels("hard")
    assert max(hard["highlight"].values) > 1
    assert [channel < 0 for channel in hard["out-of-gamut"].values[1]] == [True, False, True]
    assert max(map(max, hard["out-of-gamut"].values)) > 1
    assert min(hard["negative"].values) < 0
    assert max(hard["negative"].values) > 1
    assert hard["negative"].mean > 0


def test_all_grey_levels_of_8_bits():
    levels = {Fraction(k, 255): Fraction(1, 256) for k in range(256)}
    assert dict(standard_pixels("hard")["greys"].law) == levels


@pytest.mark.parametrize("name", SETS)
def test_a_plan_with_a_fresh_second_stage_is_unbiased_on_every_set(name):
    for X in standard_pixels(name).values():
        assert derive(catalogue["discard-pilot"], X, p=2, n1=1, n2=2).expectation == X.mean


# -- scenes ---------------------------------------------------------------------------------------


def bright(name):
    """How much of each pixel of a scene is not background."""
    scene = load_scene(name)
    return {place: 1 - X.law.get(scene.background, Fraction(0)) for place, X in scene.pixels().items()}


def integral(heights):
    """The area under straight lines between points ``(x, height)``, by the trapezoid rule."""
    return sum(((x1 - x0) * (h0 + h1) / 2 for (x0, h0), (x1, h1) in pairwise(heights)), Fraction(0))


def test_the_isolated_pixel_alone_is_bright():
    covered = bright("isolated-pixel")
    assert {place: part for place, part in covered.items() if part} == {(1, 1): 2 * Fraction(1, 8) ** 2}
    assert load_scene("isolated-pixel").pixel(1, 1).mean == Fraction(1, 4)


def test_the_slanted_edge_covers_trapezoids():
    def covered(x, y):
        """Right of the edge at 7/4 + y/11, from column x on: the width is cut off at 0 and at 1."""
        cuts = sorted({y, y + 1, *(c for c in (11 * (x - Fraction(7, 4)), 11 * (x - Fraction(3, 4))) if y < c < y + 1)})
        return integral([(c, min(1, max(0, x + 1 - Fraction(7, 4) - c / 11))) for c in map(Fraction, cuts)])

    assert bright("slanted-edge") == {(x, y): covered(x, y) for y in range(6) for x in range(4)}
    whole = integral([(Fraction(y), Fraction(9, 4) - Fraction(y, 11)) for y in (0, 6)])
    assert sum(bright("slanted-edge").values()) == whole
    tones = [X.values for X in standard_pixels("scenes").values() if Fraction(1, 5) in X.values]
    assert tones == [(Fraction(1, 5), Fraction(4, 5))] * 7


def test_the_checker_board_is_out_of_step_with_every_pixel():
    def even(start, corner):
        """How much of [start, start + 1] lies in every other interval of length 3/4, from the corner on."""
        ends = [(corner + Fraction(3, 2) * k, corner + Fraction(3, 2) * k + Fraction(3, 4)) for k in range(-3, 4)]
        return sum(max(Fraction(0), min(start + 1, high) - max(start, low)) for low, high in ends)

    expected = {}
    for y in range(2):
        for x in range(3):
            a, b = even(x, Fraction(1, 5)), even(y, Fraction(1, 3))
            expected[x, y] = a * b + (1 - a) * (1 - b)
    assert bright("checker") == expected
    assert len(set(expected.values())) == 6


def test_the_wedge_narrows_to_a_point():
    end = Fraction(57, 8)
    heights = [Fraction(7, 8) * (1 - x / end) for x in map(Fraction, range(8))]
    sections = [(h0 + h1) / 2 for h0, h1 in pairwise(heights)]
    tip = heights[-1] * (end - 7) / 2
    assert list(bright("wedge").values()) == [*sections, tip]
    assert sum(bright("wedge").values()) == Fraction(7, 8) * end / 2
    assert 0 < tip < Fraction(1, 1000)


def test_the_set_of_scenes_holds_each_law_that_an_edge_makes_once():
    pixels = standard_pixels("scenes")
    assert {name.partition("#")[0] for name in pixels} == set(SCENES)
    assert len(pixels) == 22
    for scene in SCENES:
        own = [X for name, X in pixels.items() if name.startswith(f"{scene}#")]
        assert len({frozenset(X.law.items()) for X in own}) == len(own)
        laws = {frozenset(X.law.items()) for X in load_scene(scene).pixels().values() if len(X.values) > 1}
        assert len(laws) == len(own)


@pytest.mark.parametrize("name", standard_pixels("scenes"))
def test_a_pixel_of_a_scene_keeps_its_geometry(name):
    scene, _, place = name.partition("#")
    X = pixel_by_name(f"scenes:{name}")
    own = load_scene(scene).pixel(*map(int, place.split(",")))
    assert dict(X.law) == dict(own.law)
    assert [dict(quarter.law) for quarter in X.quadrants()] == [dict(quarter.law) for quarter in own.quadrants()]


# -- sets and names -------------------------------------------------------------------------------


def test_every_pixel_says_what_it_stresses():
    lines = [standard.stresses for pixels in SETS.values() for standard in pixels.values()]
    assert len(set(lines)) == len(lines)
    assert all(line and "\n" not in line for line in lines)


def test_names():
    assert pixel_by_name("hard:offset") is standard_pixels("hard")["offset"]
    with pytest.raises(UnknownName, match="did you mean thin"):
        pixel_by_name("standard:thinn")
    with pytest.raises(UnknownName, match="hard"):
        standard_pixels("harder")
    with pytest.raises(InputError, match="standard:thin"):
        pixel_by_name("thin")
    with pytest.raises(UnknownName, match=r"pixel of '.*hard.json' is called 'ofset'; did you mean offset"):
        pixel_by_name(f"{VECTORS / 'hard.json'}:ofset")
    assert pixel_by_name(f"{VECTORS / 'hard.json'}:offset").law == pixel_by_name("hard:offset").law


def test_sets_are_read_when_first_looked_at(run, tmp_path):
    code = (
        "from pathlib import Path\n"
        "read = []\n"
        "text = Path.read_text\n"
        "Path.read_text = lambda path, *a, **k: read.append(path.name) or text(path, *a, **k)\n"
        "from truemean.conformance.pixels import SETS\n"
        "assert list(SETS) == ['standard', 'hard', 'scenes'] and 'hard' in SETS and len(SETS) == 3\n"
        "SETS['hard'], SETS['hard']\n"
        "print([name for name in read if name.endswith('.json')])"
    )
    assert run("-c", code, cwd=tmp_path).stdout.strip() == "['hard.json']"


# -- files ----------------------------------------------------------------------------------------


def described(**changes):
    """A file of one pixel, with changes."""
    pixels = {"thin": {"law": [[0, "63/64"], [1, "1/64"]], "stresses": "a thin line"}}
    return {"schema": "truemean-pixels/1", "name": "mine", "version": 2, "pixels": pixels, **changes}


def of_law(law, **more):
    return described(pixels={"thin": {"law": law, **more}})


@pytest.fixture
def written(tmp_path):
    """Writes a pixel file, from data or from text."""

    def write(content, name="mine.json"):
        file = tmp_path / name
        file.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
        return file

    return write


@pytest.mark.parametrize("file", SHIPPED, ids=lambda file: file.stem)
def test_a_shipped_file_follows_the_schema_and_is_its_set(file):
    data = json.loads(file.read_text(encoding="utf-8"))
    Draft202012Validator(SCHEMA).validate(data)
    read = SETS[data["name"]]
    assert (read.name, read.version) == (file.stem, data["version"]) == (file.stem, 1)
    assert {name: X.law for name, X in load_pixels(file).items()} == {n: X.law for n, X in read.pixels().items()}
    assert list(data["pixels"]) == list(read)


def test_every_set_but_that_of_scenes_is_a_file():
    assert {file.stem for file in SHIPPED} == set(SETS) - {"scenes"}
    Draft202012Validator.check_schema(SCHEMA)


@pytest.mark.parametrize(
    ("law", "pixel"),
    [
        ([[0, "63/64"], [1, "1/64"]], Pixel.two("1/64")),
        ([["0.1", 0.7], [0.2, "3e-1"]], Pixel({"1/10": "7/10", "1/5": "3/10"})),
        ([[1, "1/4"], [0, "1/2"], ["1.0", "1/4"]], Pixel({1: "1/2", 0: "1/2"})),
        ([["-7/3", 1]], Pixel({"-7/3": 1})),
        ([[[1, "0.5", "-1/3"], ".5"], [[0, 0, 1e3], "0.5"]], Pixel({(1, "1/2", "-1/3"): "1/2", (0, 0, 1000): "1/2"})),
    ],
)
def test_numbers_are_taken_as_written(law, pixel, written):
    data = of_law(law)
    Draft202012Validator(SCHEMA).validate(data)
    (X,) = load_pixels(written(data)).values()
    assert list(X.law.items()) == list(pixel.law.items())


def test_a_line_on_what_a_pixel_stresses_may_be_left_out(written):
    data = described(pixels={"b": {"law": [[1, 1]]}, "a": {"law": [[0, 1]], "stresses": "black"}})
    data |= {"$schema": "pixels.schema.json"}
    Draft202012Validator(SCHEMA).validate(data)
    assert list(load_pixels(str(written(data)))) == ["b", "a"]


TWICE = '{"schema": "truemean-pixels/1", "name": "mine", "version": 1, "pixels": {"a": {"law": []}, "a": {"law": []}}}'
FAULTS = {
    "not JSON": ("{", ("is not JSON", "line 1", "standard.json")),
    "deep": ("[" * 100_000, ("is not JSON", "standard.json")),
    "a name twice": (TWICE, ("'a' comes twice", "rename it")),
    "no object": ([1], ("file=[1]", "not an object", "version")),
    "other schema": (described(schema="truemean-pixels/9"), ("schema='truemean-pixels/9'", "truemean-pixels/1")),
    "a scene": ({"schema": "truemean-scene/1", "width": 2}, ("is a scene", "FILE#x,y")),
    "missing key": ({"schema": "truemean-pixels/1", "name": "mine", "pixels": {}}, ("no 'version'", "it needs schema")),
    "unknown key": (described(pixel=1), ("no key is called 'pixel'", "did you mean pixels")),
    "no pixels": (described(pixels={}), ("pixels={} holds no pixel", '"law"')),
    "a list of pixels": (described(pixels=[1]), ("pixels=[1] holds no pixel", '"law"')),
    "version 0": (described(version=0), ("version=0", "positive whole number, such as 1")),
    "version of text": (described(version="1.0"), ("version='1.0'", "positive whole number")),
    "no name": (described(name=""), ("name=''", "without blanks")),
    "a name with a colon": (described(pixels={"a:b": {"law": [[0, 1]]}}), ("name of a pixel='a:b'", "without blanks")),
    "no description": (described(pixels={"thin": 7}), ("pixel 'thin': description=7", "not an object", "law")),
    "no law": (described(pixels={"thin": {"stresses": "x"}}), ("pixel 'thin'", "no 'law'")),
    "key of a pixel": (of_law([[0, 1]], stress="x"), ("pixel 'thin'", "'stress'", "did you mean stresses")),
    "two lines": (of_law([[0, 1]], stresses="a\nb"), ("pixel 'thin': stresses='a\\nb'", "not one line")),
    "no line": (of_law([[0, 1]], stresses=None), ("pixel 'thin': stresses=None", "leave it out")),
    "empty law": (of_law([]), ("pixel 'thin': law=[] holds no value", "[[value, weight], ...]")),
    "an object": (of_law({"0": 1}), ("law={'0': 1}", "list of pairs")),
    "no pair": (of_law([[0]]), ("law[0]=[0]", "[value, weight]")),
    "a triple": (of_law([[0, "1/2", 1]]), ("law[0]=[0, '1/2', 1]", "[value, weight]")),
    "too little": (of_law([[0, "1/2"], [1, "1/4"]]), ("pixel 'thin': ", "sum to 3/4, not to 1", "add the missing 1/4")),
    "too much": (of_law([[0, 0.5], [1, 0.75]]), ("sum to 5/4, not to 1", "take away 1/4")),
    "negative": (of_law([[0, "-1/2"], [1, "3/2"]]), ("law[0][1]=", "is negative", "between 0 and 1")),
    "NaN": (of_law([[float("nan"), 1]]), ("law[0][0]='NaN'", "write an integer, 'p/q'")),
    "infinite weight": (of_law([[0, float("inf")]]), ("law[0][1]='Infinity'", "write an integer, 'p/q'")),
    "1/0": (of_law([["1/0", 1]]), ("law[0][0]='1/0'", "write an integer, 'p/q'")),
    "true": (of_law([[0, True]]), ("law[0][1]=True", "write an integer, 'p/q'")),
    "two channels": (of_law([[[1, 0], 1]]), ("law[0][0]=[1, 0]", "[red, green, blue]")),
    "bad channel": (of_law([[[1, 0, "x"], 1]]), ("law[0][0][2]='x'", "write an integer, 'p/q'")),
    "mixed kinds": (of_law([[0, "1/2"], [[1, 0, 0], "1/2"]]), ("law[1][0]=[1, 0, 0] beside law[0][0]=0", "throughout")),
}
BY_LAW = ("too little", "too much")  # which no schema can tell


@pytest.mark.parametrize("fault", FAULTS)
def test_an_unusable_file_is_named_with_pixel_place_value_and_way_out(fault, written):
    content, fragments = FAULTS[fault]
    file = written(content)
    with pytest.raises(SceneError) as caught:
        load_pixels(file)
    message = str(caught.value)
    assert message.startswith(f"{file}: ")
    assert [part for part in fragments if part not in message] == []
    assert "\n" not in message


@pytest.mark.parametrize("fault", [name for name, (data, _) in FAULTS.items() if not isinstance(data, str)])
def test_the_schema_refuses_what_is_refused(fault):
    data = json.loads(json.dumps(FAULTS[fault][0]), parse_constant=str)
    assert Draft202012Validator(SCHEMA).is_valid(data) == (fault in BY_LAW)


def test_a_file_that_is_missing_or_no_text(tmp_path):
    with pytest.raises(SceneError, match=r"no file is called '.*none.json'; give a pixel file such as .*standard.json"):
        load_pixels(tmp_path / "none.json")
    (tmp_path / "bytes.json").write_bytes(b"\xff\xfe\x00")
    for path in (tmp_path / "bytes.json", tmp_path):
        with pytest.raises(InputError, match=r"can't be read .*UTF-8"):
            load_pixels(path)
