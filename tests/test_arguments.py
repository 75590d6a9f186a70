"""What the command line reads: every form of PLAN, PIXEL, --set and --range, and the error of each that can't be meant."""

import json
import sys
from fractions import Fraction
from pathlib import Path

import pytest

from truemean.arguments import check_destination, read_pixel, read_pixels, read_plan, read_range
from truemean.conformance import standard_pixels
from truemean.conformance.declared import plan_errors
from truemean.errors import InputError, PlanError, UnknownName
from truemean.oracle import Pixel, derive
from truemean.oracle.scene import load_scene

PLANS = """
from truemean.oracle import plan
from sibling_of_plans import NAMES

@plan
def two_means(X, n, label="plain", eps=0):
    S = X.draw(n)
    return (S.mean() + X.draw(n).mean()) / 2

def divides(X, n=2):
    S = X.draw(n)
    if S.range() <= 0:
        return S.mean()
    return 1 / (n - 2)

def looks_too_far(X, n=2):
    return X.draw(n).statistic(lambda values: values[n])

number = 3
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The current directory, with plans of a reader's own."""
    (tmp_path / "plans_of_a_reader.py").write_text(PLANS)
    (tmp_path / "sibling_of_plans.py").write_text("NAMES = ()")
    (tmp_path / "not_python.py").write_text("def f(X:")
    (tmp_path / "crashes.py").write_text("1 / 0")
    (tmp_path / "exits.py").write_text("raise SystemExit(1)")
    (tmp_path / "needs.py").write_text("import no_such_library")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.path", [*sys.path])
    yield tmp_path
    for name in ("plans_of_a_reader", "sibling_of_plans"):
        sys.modules.pop(name, None)


@pytest.mark.parametrize(
    ("text", "settings", "params"),
    [
        ("kirk-arvo", [], {"n": 4, "eps": 0}),
        ("kirk-arvo?n=8", ["eps=0.1"], {"n": 8, "eps": Fraction(1, 10)}),
        ("kirk-arvo", [" n = 5 ", "eps=-1/3"], {"n": 5, "eps": Fraction(-1, 3)}),
        ("fixed?n=2", [], {"n": 2}),
    ],
)
def test_parameters_come_from_the_plan_and_from_set(text, settings, params):
    assert read_plan(text, settings)[1] == params


def test_a_value_is_text_where_the_default_is():
    assert read_plan("kirk-arvo-unbiased", ["area=1/3"])[1]["area"] == "1/3"


@pytest.mark.parametrize("place", ["plans_of_a_reader.py", "plans_of_a_reader", "./plans_of_a_reader.py"])
def test_a_plan_of_the_readers_own(place, folder):
    plan, params = read_plan(f"{place}:two_means", ["n=3", "label=4"])
    assert (plan.name, params) == ("two-means", {"n": 3, "label": "4", "eps": 0})
    assert derive(plan, Pixel.two("1/4"), **params).variance == Fraction(3, 16) / 6


def test_a_plan_imports_its_neighbours_from_any_directory(folder, monkeypatch):
    (folder / "elsewhere").mkdir()
    monkeypatch.chdir(folder / "elsewhere")
    assert read_plan("../plans_of_a_reader.py:divides")[1] == {"n": 2}


@pytest.mark.parametrize(
    ("text", "settings", "kind", "message"),
    [
        ("kirk-avro", [], UnknownName, "'kirk-avro'; did you mean kirk-arvo"),
        ("", [], UnknownName, "no plan is called ''"),
        ("kirk-arvo", ["m=4"], UnknownName, "parameter of plan kirk-arvo is called 'm'"),
        ("kirk-arvo", ["rows=4"], UnknownName, "is called 'rows'"),
        ("kirk-arvo", ["n"], InputError, "--set 'n' is not name=value"),
        ("kirk-arvo", ["n="], InputError, "--set 'n=' is not name=value"),
        ("kirk-arvo", ["n=4", "n=5"], InputError, "--set 'n=5': n is given twice"),
        ("kirk-arvo?n=4", ["n=5"], InputError, "n is given twice"),
        ("kirk-arvo", ["n=4.5.6"], InputError, "n='4.5.6' is not a number"),
        ("kirk-arvo", ["n=1/0"], InputError, "n='1/0' is not a number"),
        ("plans_of_a_reader.py", [], InputError, "write plans_of_a_reader.py:my_plan"),
        ("plans_of_a_reader.py:two_mean", [], UnknownName, "did you mean two_means"),
        ("plans_of_a_reader.py:two_means", [], InputError, "needs n"),
        ("plans_of_a_reader.py:number", [], InputError, "is not a function of X"),
        ("no_such_file.py:f", [], InputError, "no_such_file.py"),
        ("no_such_module:f", [], InputError, "no_such_module"),
        ("not_python.py:f", [], PlanError, r"'not_python.py:f' can't be imported: SyntaxError.*line 1"),
        (
            "crashes.py:f",
            [],
            PlanError,
            r"can't be imported: ZeroDivisionError: division by zero \(.*crashes.py, line 1\)",
        ),
        (
            "crashes:f",
            [],
            PlanError,
            r"can't be imported: ZeroDivisionError: division by zero \(.*crashes.py, line 1\)",
        ),
        ("exits.py:f", [], PlanError, r"can't be imported: SystemExit: 1 \(.*exits.py, line 1\)"),
        ("needs.py:f", [], PlanError, r"No module named 'no_such_library' \(.*needs.py, line 1\)"),
    ],
)
def test_a_plan_that_cannot_be_read(text, settings, kind, message, folder):
    with pytest.raises(kind, match=message):
        read_plan(text, settings)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("divides", r"plan 'divides' raised ZeroDivisionError.*plans_of_a_reader.py, line 14\); .*range\(S1\) > 0"),
        ("looks_too_far", r"plan 'looks-too-far' raised IndexError.*plans_of_a_reader.py, line 17"),
    ],
)
def test_a_plan_that_raises_is_told_with_its_line(name, message, folder):
    plan, params = read_plan(f"plans_of_a_reader.py:{name}")
    with pytest.raises(PlanError, match=message), plan_errors(plan):
        _ = derive(plan, Pixel.two("1/4"), **params).bias


def test_what_truemean_itself_raises_is_not_blamed_on_a_plan(folder):
    for name in ("kirk-arvo", "plans_of_a_reader.py:divides"):
        plan, _ = read_plan(name)
        with pytest.raises(ZeroDivisionError), plan_errors(plan):
            _ = 1 // 0


@pytest.mark.parametrize(
    ("text", "pixel"),
    [
        ("0:7/8,1:1/8", Pixel.two("1/8")),
        (" 0 : 0.875 , 1 : .125 ", Pixel.two("1/8")),
        ("1:1/8,0:3/8,0:1/2", Pixel({1: "1/8", 0: "7/8"})),
        ("1/2:1", Pixel({"1/2": 1})),
        ("-0.5:1/2,-1e-3:1/2", Pixel({"-1/2": "1/2", "-0.001": "1/2"})),
        ("(1,0,0):1/2,(0,1,0):1/2", Pixel({(1, 0, 0): "1/2", (0, 1, 0): "1/2"})),
        ("(1/2, -1):1", Pixel({("1/2", -1): 1})),
        ("standard:thin", standard_pixels()["thin"]),
        ("hard:offset", standard_pixels("hard")["offset"]),
        ("scenes:wedge#7,0", load_scene("wedge").pixel(7, 0)),
    ],
)
def test_a_pixel(text, pixel):
    assert read_pixel(text).law == pixel.law


def test_a_pixel_of_a_scene(folder):
    (folder / "own.json").write_text(
        '{"schema": "truemean-scene/1", "width": 2, "height": 1, "background": 0, "polygons": '
        '[{"value": 1, "vertices": [[1, 0], [2, 0], [1, 1]]}]}'
    )
    assert read_pixel("own.json#1,0").mean == Fraction(1, 2)
    assert read_pixel("tile#4,0").law == load_scene("tile").pixel(4, 0).law
    assert len(read_pixel("tile#4,0").quadrants()) == 4


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "'' is not value:weight; a pixel is written"),
        ("0", "'0' is not value:weight"),
        ("0:1/2,,1:1/2", "'' is not value:weight"),
        ("0:1/2", "sum to 1/2, not to 1"),
        ("0:-1/2,1:3/2", "is negative"),
        ("0:half,1:1/2", "weight of 0='half' is not a number"),
        ("(1,0:1/2,(0,1):1/2", "is not a number"),
        ("(1,0):1/2,0:1/2", "mix scalars and colours"),
        ("nan:1", "no set of pixels is called 'nan'"),
        ("0:nan", "is not a number"),
        ("standard", "'standard:thin'"),
        ("standard:thn", "did you mean thin"),
        ("standrd:thin", "did you mean standard"),
        ("scenes:wedge#8,0", "did you mean wedge#"),
        ("none.json:thin", "no file is called 'none.json'; give a pixel file such as"),
        ("tile#4", "'4' is not x,y"),
        ("tile#8,0", "outside scene 'tile'"),
        ("tilo#1,1", "did you mean tile"),
    ],
)
def test_a_pixel_that_cannot_be_read(text, message):
    with pytest.raises(InputError, match=message) as caught:
        read_pixel(text)
    assert repr(text) in str(caught.value)


def test_pixels_are_sets_and_single_ones():
    assert read_pixels([]) is None
    assert list(read_pixels(["hard", "0:1/2,1:1/2"])) == [*standard_pixels("hard"), "0:1/2,1:1/2"]
    assert list(read_pixels(["scenes", "tile#4,0"])) == [*standard_pixels("scenes"), "tile#4,0"]


def pixel_file(name, **laws):
    text = json.dumps({"schema": "truemean-pixels/1", "name": name, "version": 1, "pixels": laws})
    Path(f"{name}.json").write_text(text, encoding="utf-8")


def test_pixels_of_a_file_of_ones_own(folder):
    pixel_file("mine", dim={"law": [[0, "3/4"], ["0.1", "1/4"]]}, thin={"law": [[0, "63/64"], [1, "1/64"]]})
    assert list(read_pixels(["./mine.json", "hard:offset"])) == ["dim", "thin", "hard:offset"]
    assert read_pixel("mine.json:dim").law == read_pixels([str(folder / "mine.json")])["dim"].law
    assert read_pixel(f"{folder / 'mine.json'}:thin").law == Pixel.two("1/64").law
    assert len(read_pixels(["standard", "mine.json", "standard"])) == 12
    with pytest.raises(InputError, match=r"pixel of 'mine.json' is called 'dym'; did you mean dim"):
        read_pixel("mine.json:dym")
    Path("mine.json").write_text("{", encoding="utf-8")
    with pytest.raises(InputError, match=r"mine.json: is not JSON"):
        read_pixels(["mine.json"])


def test_two_pixels_of_one_name_are_not_mixed_up(folder):
    pixel_file("other", thin={"law": [[0, "1/2"], [1, "1/2"]]})
    with pytest.raises(
        InputError, match=r"--pixels 'other.json': Pixel.*1/2.* is called 'thin' like .*63/64.*: rename"
    ):
        read_pixels(["standard", "other.json"])


def test_a_scene_is_not_taken_for_a_pixel_file(folder):
    scene = {"schema": "truemean-scene/1", "width": 1, "height": 1, "background": 0, "polygons": []}
    Path("own.json").write_text(json.dumps(scene), encoding="utf-8")
    assert read_pixel("own.json#0,0").law == {0: 1}
    with pytest.raises(InputError, match=r"own.json: schema='truemean-scene/1' is a scene: .* FILE#x,y"):
        read_pixels(["own.json"])


@pytest.mark.parametrize(("text", "message"), [("1", "is not lo,hi"), ("0,x", "--range='x'"), ("", "is not lo,hi")])
def test_a_range(text, message):
    assert read_range(None) is None
    assert read_range("0,1.5") == (0, Fraction(3, 2))
    with pytest.raises(InputError, match=message):
        read_range(text)


def test_a_destination_is_checked_before_the_work(tmp_path):
    for file in (None, "-", tmp_path / "new.json"):
        check_destination("--json", file)
    with pytest.raises(InputError, match=r"--json .*is a directory"):
        check_destination("--json", tmp_path)
    with pytest.raises(InputError, match=r"--json .*in no directory that exists"):
        check_destination("--json", tmp_path / "none" / "new.json")
