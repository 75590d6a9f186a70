"""SUBJECT strings: what they load, and the error of each that can't be meant."""

from __future__ import annotations

import inspect
import sys
import textwrap

import numpy as np
import pytest

import truemean
from truemean.adapters import asking, available, load
from truemean.adapters.registry import ADAPTERS, LOAD_SCENE, parse, read_number, resolve
from truemean.errors import InputError, InputTypeError, MissingExtra, SubjectError, UnknownName
from truemean.subject import as_estimator

SEEDS = np.arange(5)
SUBJECTS = """
    import numpy as np
    from dataclasses import dataclass
    from truemean.subject import Costed

    def half(pixel, seeds, by=2):
        return np.asarray(seeds) / by

    half.rounding = 1e-3

    def needy(pixel, seeds, n):
        return np.asarray(seeds) * n

    @dataclass(frozen=True)
    class Scaled:
        factor: float = 3

        def run(self, pixel, seeds):
            return np.asarray(seeds) * self.factor

    class Unready(Scaled):
        def __init__(self):
            raise RuntimeError("no device")

    ready = Scaled(5)
    number = 7

    def one(pixel, seed, by=2):
        return seed / by

    def costly(pixel, seeds):
        return Costed(np.asarray(seeds) / 2, np.asarray(seeds) % 3)

    def one_costly(pixel, seed):
        return Costed(seed / 2, seed % 3)

    def mean(pixel, draw, n=2, scale=1.0):
        return scale * draw(n).mean()

    mean.declares = ("fixed", {"n": 2})
    mean.order = "no order"

    def first(draw, *, below=1):
        return draw() if below == 1 else draw() / below

    def never(X, samples):
        return 0.0

    class Asks:
        def __init__(self, n=3):
            self.n = n

        def __call__(self, draw):
            return sum(draw() for _ in range(self.n)) / 4

    class Scalar:
        def __call__(self, pixel, seed):
            return seed / 2

    asks = Asks(2)
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The current directory, holding a module of subjects and two that can't be imported."""
    (tmp_path / "subjects_of_load.py").write_text(textwrap.dedent(SUBJECTS))
    (tmp_path / "crashes_on_load.py").write_text("1 / 0\n")
    (tmp_path / "exits_on_load.py").write_text("raise SystemExit(1)\n")
    (tmp_path / "imports_nothing_real.py").write_text("import no_such_library\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.path", [*sys.path])
    yield tmp_path
    for name in ("subjects_of_load", "crashes_on_load", "imports_nothing_real", "truemean_subject_subjects_of_load"):
        sys.modules.pop(name, None)


@pytest.mark.parametrize("place", ["subjects_of_load", "subjects_of_load.py", "./subjects_of_load.py"])
@pytest.mark.parametrize(
    ("name", "factor"),
    [
        ("half", 0.5),
        ("half?by=4", 0.25),
        ("half?by=1/2", 2),
        ("needy?n=6", 6),
        ("Scaled", 3),
        ("Scaled?factor=1e1", 10),
        ("ready", 5),
        ("one", 0.5),
        ("one?by=4", 0.25),
        ("costly", 0.5),
        ("one_costly", 0.5),
        ("Scalar", 0.5),
    ],
)
def test_python_subjects(folder, place, name, factor):
    estimates = load(f"python:{place}:{name}").run(None, SEEDS)
    assert estimates.tolist() == (SEEDS * factor).tolist()


@pytest.mark.parametrize("name", ["half", "half?by=4"])
def test_a_functions_attributes_stay_visible(folder, name):
    subject = load(f"python:subjects_of_load:{name}")
    assert (subject.name, subject.rounding) == ("half", 1e-3)


@pytest.mark.parametrize(
    ("subject", "error", "words"),
    [
        (7, InputTypeError, ["subject=7", "type=int", "scheme:rest"]),
        ("", InputError, ["subject=''", "names no adapter"]),
        ("?n=4", InputError, ["subject='?n=4'", "names no adapter"]),
        ("pyton:a:b", UnknownName, ["adapter", "'pyton'", "did you mean python"]),
        ("raysect?n", InputError, ["option 'n'", "'option=value'"]),
        ("raysect?n=", InputError, ["option 'n='", "'option=value'"]),
        ("raysect?=4", InputError, ["option '=4'", "'option=value'"]),
        ("raysect?passes=1&passes=2", InputError, ["'passes'", "twice"]),
        (
            "raysect?min_sample=4",
            UnknownName,
            ["option of adapter raysect", "'min_sample'", "did you mean min_samples"],
        ),
        ("python", InputError, ["adapter python", "missing a required argument"]),
        ("plan", InputError, ["adapter plan", "missing a required argument"]),
        ("plan:kirk-arvoo", UnknownName, ["'kirk-arvoo'", "kirk-arvo"]),
        ("plan:kirk-arvo?m=4", UnknownName, ["'m'", "n"]),
        ("python:half", InputError, ["'half'", "MODULE:NAME"]),
        ("python::half", InputError, ["':half'", "MODULE:NAME"]),
        ("python:no_such_module:f", InputError, ["no module 'no_such_module'", "looked for in"]),
        ("python:no_such_module.sub:f", InputError, ["no module 'no_such_module'", "looked for in"]),
        ("python:no_such_file.py:f", InputError, ["no file 'no_such_file.py'", "path/to/file.py:name"]),
        (
            "python:crashes_on_load:f",
            SubjectError,
            ["'python:crashes_on_load:f'", "ZeroDivisionError: ", "crashes_on_load.py, line 1)"],
        ),
        (
            "python:crashes_on_load.py:f",
            SubjectError,
            ["ZeroDivisionError: division by zero (", "crashes_on_load.py, line 1)"],
        ),
        ("python:exits_on_load.py:f", SubjectError, ["SystemExit: 1 (", "exits_on_load.py, line 1)"]),
        ("python:subjects_of_load:Unready", SubjectError, ["RuntimeError: no device (", "subjects_of_load.py, line"]),
        ("python:imports_nothing_real:f", SubjectError, ["imports_nothing_real", "no_such_library"]),
        ("python:subjects_of_load:halve", UnknownName, ["object of subjects_of_load", "'halve'", "did you mean half"]),
        ("python:subjects_of_load:half?bye=3", UnknownName, ["option of subjects_of_load:half", "'bye'", "by"]),
        ("python:subjects_of_load:needy", InputError, ["subjects_of_load:needy", "missing a required argument: 'n'"]),
        ("python:subjects_of_load:Scaled?n=3", UnknownName, ["option of subjects_of_load:Scaled", "'n'", "factor"]),
        ("python:subjects_of_load:ready?n=3", InputError, ["is an object and takes no options", "{'n': 3}"]),
        ("python:subjects_of_load:number", InputTypeError, ["is 7 (type=int)", "f(pixel, seeds)", "f(pixel, draw)"]),
        ("python:subjects_of_load:one?bye=3", UnknownName, ["option of subjects_of_load:one", "'bye'", "by"]),
        ("python:subjects_of_load:half?paths=3", UnknownName, ["'paths'", "by"]),
        ("python:subjects_of_load:mean?paths=0", InputError, ["paths=0", "from 1 up"]),
        ("python:subjects_of_load:mean?paths=many", InputError, ["paths='many'", "from 1 up"]),
        ("python:subjects_of_load:mean?order=any", InputError, ["order='any'", "sequence, blocks, all"]),
        ("python:subjects_of_load:mean?m=3", UnknownName, ["option of mean", "'m'", "n"]),
        ("python:subjects_of_load:first?above=3", UnknownName, ["option of first", "'above'", "below"]),
        ("python:subjects_of_load:asks?n=3", UnknownName, ["option of Asks", "'n'"]),
        ("python:truemean.adapters.reference:KirkArvo?n=0", InputError, ["n=0", "from 1 up"]),
        ("python:truemean.adapters.reference:KirkArvo?n=4.5", InputError, ["n=4.5", "whole number"]),
        ("python:truemean.adapters.reference:KirkArvo?eps=-1", InputError, ["eps=-1", "from 0 up"]),
        ("python:truemean.adapters.reference:KirkArvoUnbiased?area=1", InputError, ["area=1", "between 0 and 1"]),
        ("python:truemean.adapters.reference:KirkArvoUnbiased?n2=few", InputError, ["n2='few'", "whole number"]),
    ],
)
def test_errors_name_the_thing_its_value_and_the_way_out(folder, subject, error, words):
    with pytest.raises(error) as raised:
        load(subject)
    assert [word for word in words if word not in str(raised.value)] == []


def test_without_raysect_the_error_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "raysect.optical", None)
    with pytest.raises(MissingExtra, match=r"pip install 'truemean\[raysect\]'"):
        load("raysect")


def test_options_are_read_by_whoever_takes_them():
    assert parse("plan:kirk-arvo?n=4&eps=1/10") == ("plan", "kirk-arvo", {"n": "4", "eps": "1/10"})
    assert parse("python:a/b.py:f?x=a:b=c") == ("python", "a/b.py:f", {"x": "a:b=c"})
    assert [read_number(text) for text in ("4", "0.5", "1/0", "nan", "name")] == [4, 0.5, "1/0", "nan", "name"]


@pytest.mark.parametrize("dotted", [*(adapter.factory for adapter in ADAPTERS.values()), LOAD_SCENE])
def test_every_dotted_name_of_the_registry_resolves(dotted):
    assert callable(resolve(dotted))


def test_plans_are_subjects_and_the_engine_reads_their_parameters():
    subject = load("plan:kirk-arvo?n=3&eps=1/2")
    X = resolve("truemean.oracle.pixel:Pixel").two("1/8")
    estimates = subject.run(X, np.arange(200))
    assert set(np.unique(estimates)) == {0, 0.125}
    assert np.array_equal(estimates[50:60], subject.run(X, np.arange(50, 60)))


def test_available_lists_every_adapter_and_how_to_get_it(monkeypatch):
    versions = {adapter.name: adapter.version for adapter in available()}
    assert list(versions) == list(ADAPTERS)
    assert versions["python"] == versions["plan"] == truemean.__version__
    assert all(adapter.help for adapter in available())
    monkeypatch.setitem(
        ADAPTERS, "raysect", resolve("dataclasses:replace")(ADAPTERS["raysect"], package="no-such-package")
    )
    missing = next(adapter for adapter in available() if adapter.name == "raysect")
    assert (missing.version, missing.how) == (None, "pip install 'truemean[raysect]'")


def test_options_of_raysect_have_the_defaults_that_its_docstring_states():
    parameters = inspect.signature(resolve(ADAPTERS["raysect"].factory)).parameters
    defaults = {name: parameter.default for name, parameter in parameters.items()}
    assert defaults == {
        "scene": "tile",
        "pixel_samples": 4,
        "passes": None,
        "min_samples": None,
        "cutoff": 0,
        "ratio": 1e9,
        "fraction": 1,
        "sampler": "mono",
    }


# -- code that asks for its samples ---------------------------------------------------------------------


def means(name):
    X = resolve("truemean.oracle.pixel:Pixel").two("1/8")
    found = load(f"python:subjects_of_load:{name}").exact(X)
    return sum(outcome * mass for outcome, mass in found.law.items()), found.cost, found.how


@pytest.mark.parametrize(
    ("name", "mean", "cost", "how"),
    [
        ("mean", 1, 2, "4 sequences"),
        ("mean?n=3&scale=2", 2, 3, "8 sequences"),
        ("mean?order=blocks&paths=4", 1, 2, "4 counts"),
        ("mean?order=all", 1, 2, "4 counts"),
        ("first", 1, 1, "2 sequences"),
        ("first?below=2", 0.5, 1, "2 sequences"),
        ("asks", 0.5, 2, "4 sequences"),
        ("Asks?n=4", 1, 4, "16 sequences"),
    ],
)
def test_code_that_asks_has_an_exact_law(folder, name, mean, cost, how):
    found = means(name)
    assert found[1:] == (cost, f"{how} of answers")
    assert abs(found[0] - resolve("fractions:Fraction")(mean) / 8) < 1e-15


def test_what_a_function_says_of_itself_hides_nothing_of_its_estimator(folder):
    subject = load("python:subjects_of_load:mean")
    assert (subject.name, subject.declares, subject.order) == ("mean", ("fixed", {"n": 2}), "sequence")
    assert load("python:subjects_of_load:asks").name == "Asks"


@pytest.mark.parametrize("name", ["costly", "one_costly"])
def test_costs_come_with_the_estimates(folder, name):
    subject, pixel = load(f"python:subjects_of_load:{name}"), object()
    assert subject.costs(pixel, SEEDS) is None
    subject.run(pixel, SEEDS)
    assert subject.costs(pixel, SEEDS).tolist() == [0, 1, 2, 0, 1]
    assert subject.costs(object(), SEEDS) is None
    assert subject.costs(pixel, SEEDS[1:]) is None


@pytest.mark.parametrize(
    ("function", "error", "words"),
    [
        (7, InputTypeError, ["function=7", "type=int", "f(pixel, draw)"]),
        (lambda: 1, InputError, ["can't be called"]),
        (lambda draw, n: 1, InputError, ["missing a required argument: 'n'"]),
        (lambda draw, pixel: 1, InputError, ["missing a required argument: 'pixel'"]),
    ],
    ids=["number", "no arguments", "an option missing", "wrong order"],
)
def test_what_can_not_ask(function, error, words):
    with pytest.raises(error) as raised:
        asking(function)
    assert [word for word in words if word not in str(raised.value)] == []


def test_a_function_that_asks_is_wrapped_before_it_is_judged():
    with pytest.raises(InputTypeError, match=r"asks for its samples: wrap it, truemean\.adapters\.asking\(f\)"):
        as_estimator(lambda pixel, draw: draw())


# -- adapters of other packages -----------------------------------------------------------------------------


@pytest.fixture
def plug_in(tmp_path, monkeypatch):
    """A distribution on the path that brings adapters, one of them under a name of ours."""
    (tmp_path / "their_renderer.py").write_text(
        "import numpy as np\n\ndef make(scene='none', *, samples='4'):\n"
        "    return lambda pixel, seeds: np.asarray(seeds) * int(samples) + len(scene)\n"
    )
    info = tmp_path / "their_renderer-2.5.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: their-renderer\nVersion: 2.5\n")
    (info / "entry_points.txt").write_text(
        "[truemean.adapters]\ntheirs = their_renderer:make\npython = their_renderer:make\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    yield
    sys.modules.pop("their_renderer", None)


def test_adapters_of_other_packages_are_listed_after_ours(plug_in):
    listed = available()
    assert [adapter.name for adapter in listed] == [*ADAPTERS, "theirs"]
    assert listed[-1] == ("theirs", "2.5", "installed", "theirs[:...]: from the package their-renderer")


def test_adapters_of_other_packages_are_loaded_with_their_options(plug_in):
    assert load("theirs").run(None, SEEDS).tolist() == (SEEDS * 4 + 4).tolist()
    assert load("theirs:ab?samples=10").run(None, SEEDS).tolist() == (SEEDS * 10 + 2).tolist()
    with pytest.raises(UnknownName, match=r"option of adapter theirs is called 'sample'; did you mean samples"):
        load("theirs?sample=10")


def test_ours_are_not_replaced_by_theirs(plug_in):
    assert load("python:truemean.adapters.reference:KirkArvo").n == 4
    with pytest.raises(UnknownName, match="adapter is called 'their'; did you mean theirs"):
        load("their:ab")
