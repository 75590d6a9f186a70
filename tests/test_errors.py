"""The error tree: drawn, exported, picklable, and grouped by exit code."""

import copy
import inspect
import pickle
import re
from typing import NamedTuple

import numpy as np
import pytest

from truemean import errors

CLASSES = {
    name: value
    for name, value in vars(errors).items()
    if inspect.isclass(value) and issubclass(value, errors.TruemeanError)
}
ARGUMENTS = {errors.UnknownName: ("plan", "kirk-avro", ["kirk-arvo", "fixed"])}
EXIT_CODES = {errors.InputError: 2, errors.SubjectError: 4}


class Drawn(NamedTuple):
    """One line of the tree in the module's docstring."""

    parent: str | None
    builtin: str | None
    meaning: str


def drawn_tree():
    """Name -> line of the docstring's tree; a line's depth is where its name starts."""
    tree, above = {}, []
    for line in (errors.__doc__ or "").splitlines():
        if not (match := re.match(r"    ((?:[|`]-- |[| ]   )*)(\w+)(?: \((\w+)\))?(?: {2,}(.*))?$", line)):
            continue
        depth = len(match[1]) // 4
        above[depth:] = [match[2]]
        tree[match[2]] = Drawn(above[depth - 1] if depth else None, match[3], match[4] or "")
    return tree


def make(cls):
    return cls(*ARGUMENTS.get(cls, (f"a message of {cls.__name__}",)))


def exit_code(name):
    """The code that the drawn tree promises: that of the line itself or of the nearest line above it."""
    line = drawn_tree()[name]
    code = re.search(r"exit code (\d+)", line.meaning)
    return int(code[1]) if code else line.parent and exit_code(line.parent)


def test_the_drawn_tree_is_the_tree():
    bases = {name: [base.__name__ for base in cls.__bases__] for name, cls in CLASSES.items()}
    drawn = {name: [base for base in (line.parent, line.builtin) if base] for name, line in drawn_tree().items()}
    assert drawn == bases | {"TruemeanError": []}
    assert errors.TruemeanError.__bases__ == (Exception,)


def test_all_errors_are_exported():
    assert [*sorted(CLASSES), "raised"] == errors.__all__


@pytest.mark.parametrize("cls", CLASSES.values(), ids=CLASSES)
def test_an_error_survives_processes(cls):
    error = make(cls)
    for twin in (pickle.loads(pickle.dumps(error)), copy.copy(error)):
        assert type(twin) is cls
        assert (str(twin), vars(twin)) == (str(error), vars(error))


@pytest.mark.parametrize("cls", CLASSES.values(), ids=CLASSES)
def test_an_error_belongs_to_one_exit_code(cls):
    groups = [code for group, code in EXIT_CODES.items() if issubclass(cls, group)]
    promised = exit_code(cls.__name__)
    assert groups == ([] if promised is None else [promised])


@pytest.mark.parametrize("cls", CLASSES.values(), ids=CLASSES)
def test_an_error_says_what_it_is_in_one_sentence(cls):
    assert re.fullmatch(r"[A-Z0-9][^\n]*\.", inspect.getdoc(cls) or "")


@pytest.mark.parametrize(
    ("name", "known", "message"),
    [
        ("kirk-avro", ["fixed", "kirk-arvo"], "no plan is called 'kirk-avro'; did you mean kirk-arvo?"),
        ("zzz", ["fixed", "kirk-arvo"], "no plan is called 'zzz'; known: fixed, kirk-arvo"),
    ],
)
def test_an_unknown_name_meets_the_nearest_ones(name, known, message):
    assert str(errors.UnknownName("plan", name, known)) == message


def test_what_a_readers_code_raised_is_told_with_its_own_line():
    try:
        np.broadcast_to(np.zeros(2), 3)
    except ValueError as error:
        error.add_note("on the first look")
        told = errors.raised(error)
    assert re.fullmatch(r"ValueError: .*\(.*test_errors.py, line \d+\); on the first look", told)
