"""Every error of truemean, one tree.

::

    TruemeanError
    |-- InputError (ValueError)            wrong use or unreadable input: exit code 2
    |   |-- InputTypeError (TypeError)     right place, wrong type
    |   |-- UnknownName (KeyError)         no such plan, parameter, adapter, pixel (nearest names given)
    |   |-- MissingExtra                   an optional package is not installed (says how to get it)
    |   |-- AssumptionError                a symbol's assumptions contradict its use (says what to declare)
    |   |-- SceneError                     a scene or pixel file that can't be used
    |   |   `-- NeedsScene                 the plan asks for geometry, the pixel has none
    |   `-- PlanError                      the plan can't be derived as written
    |       |-- NotDeterministic           the plan's path depends on something other than its draws
    |       |-- UndefinedValue             0/0 on some row, and no policy declared
    |       |-- UndecidedTie               a comparison that no precision decides
    |       |-- NotExact                   an irrational estimate asked for in exact arithmetic
    |       |-- NoClosedForm               no formula in the symbols (says which of them to make concrete)
    |       `-- RowBudgetExceeded          more rows than allowed (says what asked for them)
    |-- SubjectError                       the estimator under test broke: exit code 4
    |-- TooManyPaths                       code with more paths than its budget: judged by sampled replicates
    `-- Unsupported                        an estimator declines a pixel: the case is skipped

Every message names the thing, its value and the way out.
"""

from __future__ import annotations

import sys
import traceback
from collections.abc import Iterable
from difflib import get_close_matches
from types import FrameType

__all__ = [
    "AssumptionError",
    "InputError",
    "InputTypeError",
    "MissingExtra",
    "NeedsScene",
    "NoClosedForm",
    "NotDeterministic",
    "NotExact",
    "PlanError",
    "RowBudgetExceeded",
    "SceneError",
    "SubjectError",
    "TooManyPaths",
    "TruemeanError",
    "UndecidedTie",
    "UndefinedValue",
    "UnknownName",
    "Unsupported",
    "raised",
]


class TruemeanError(Exception):
    """Root of all errors raised on purpose; catch it to catch them all."""


class InputError(TruemeanError, ValueError):
    """Wrong use or unreadable input: change the argument that the message names."""


class InputTypeError(InputError, TypeError):
    """An argument of a type that can't be meant, such as a float for an exact weight."""


class UnknownName(InputError, KeyError):
    """A name that nothing is registered under; the message lists the nearest ones."""

    def __init__(self, what: str, name: str, known: Iterable[str]) -> None:
        self.what, self.name, self.known = what, name, tuple(known)
        near = get_close_matches(name, self.known, n=3, cutoff=0.4)
        hint = "did you mean " + " or ".join(near) + "?" if near else "known: " + ", ".join(self.known)
        super().__init__(f"no {what} is called {name!r}; {hint}")

    def __str__(self) -> str:
        return str(self.args[0])

    def __reduce__(self) -> tuple[type[UnknownName], tuple[str, str, tuple[str, ...]]]:
        return type(self), (self.what, self.name, self.known)


class MissingExtra(InputError):
    """An optional package is missing; the message holds the line that installs it."""


class AssumptionError(InputError):
    """A symbol is declared to be what it can't be here; the message says how to declare it."""


class SceneError(InputError):
    """A scene or pixel file that can't be read or that describes nothing renderable."""


class NeedsScene(SceneError):
    """The plan asks for geometry (quadrants, positions) and the pixel has none."""


class PlanError(InputError):
    """The plan can't be derived as written; the message says what to write instead."""


class NotDeterministic(PlanError):
    """Given the same draws the plan did something else: use X.coin or X.pick for its own choices."""


class UndefinedValue(PlanError):
    """A statistic is 0/0 on some row; declare ``undefined=`` on the statistic or the plan."""


class UndecidedTie(PlanError):
    """Two sides of a comparison agree to every precision tried and can't be proved equal."""


class NotExact(PlanError):
    """The estimate is irrational, so exact arithmetic can't return it: use another arithmetic."""


class NoClosedForm(PlanError):
    """A decision has no formula in the symbols left open: make one of them concrete."""


class RowBudgetExceeded(PlanError):
    """The plan looks at more than the row budget allows; the message names what asked for it."""


class SubjectError(TruemeanError):
    """The estimator under test crashed, hung or returned something that is no estimate."""


class TooManyPaths(TruemeanError):
    """Raised by an estimator that asks for its samples, where to answer in every way takes more runs than allowed."""


class Unsupported(TruemeanError):
    """Raised by an estimator for a pixel that it can't render; the case is skipped, not failed."""


def raised(error: BaseException) -> str:
    """What a reader's own code raised, and where: the innermost line of it that is no library's.

    >>> raised(ZeroDivisionError("division by zero"))
    'ZeroDivisionError: division by zero'
    """
    lines = [
        f" ({frame.f_code.co_filename}, line {line})"
        for frame, line in traceback.walk_tb(error.__traceback__)
        if not _is_library(frame)
    ]
    notes = "".join(f"; {note}" for note in getattr(error, "__notes__", ()))
    return f"{type(error).__name__}: {error}{''.join(lines[-1:])}{notes}"


def _is_library(frame: FrameType) -> bool:
    package = str(frame.f_globals.get("__name__", "")).partition(".")[0]
    return package in {"truemean", *sys.stdlib_module_names} or "site-packages" in frame.f_code.co_filename
