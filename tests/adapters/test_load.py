"""SUBJECT strings: what they load, and the error of each that can't be meant."""

from __future__ import annotations

import inspect
import sys
import textwrap

import numpy as np
import pytest

import truemean
from truemean.adapters import available, load
from truemean.adapters.registry import ADAPTERS, LOAD_SCENE, parse, read_number, resolve
from truemean.errors import InputError, InputTypeError, MissingExtra, SubjectError, UnknownName

SEEDS = np.arange(5)
SUBJECTS = """
    import numpy as np
    from dataclasses import dataclass

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
        ("python:subjects_of_load:number", InputTypeError, ["is 7 (type=int)", "f(pixel, seeds)"]),
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
    missing = available()[-1]
    assert (missing.version, missing.how) == (None, "pip install 'truemean[no-such-package]'")


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
    }
