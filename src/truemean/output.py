"""What the command line leaves behind: JSON with its provenance, files, whole directories, and text."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout
from decimal import Decimal, localcontext
from fractions import Fraction
from pathlib import Path
from typing import Any

from flint import fmpz
from rich.console import Console
from rich.text import Text

from truemean.errors import InputError

__all__ = [
    "command_line",
    "console",
    "decimal",
    "replaced",
    "shortened",
    "working",
    "write_json",
    "write_text",
]

WIDE = 120  # columns where there is no terminal to ask
DIGITS = 24  # of an integer, before it is shortened on the terminal


class _Console(Console):
    def on_broken_pipe(self) -> None:
        """The reader, such as ``head``, has seen enough: what follows is for nobody, the exit code still counts."""
        self.quiet = True
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def console(*, stderr: bool = False) -> Console:
    """Standard output (or error) for people; nothing in a text is markup."""
    stream = sys.stderr if stderr else sys.stdout
    width = None if stream.isatty() or "COLUMNS" in os.environ else WIDE
    return _Console(stderr=stderr, width=width, markup=False, highlight=False, emoji=False)


@contextmanager
def working(text: str) -> Iterator[Callable[[str], None]]:
    """Tell on the terminal what is being done; what a reader's code prints meanwhile is no output of ours."""
    with console(stderr=True).status(Text(text)) as status, redirect_stdout(sys.stderr):
        yield lambda now: status.update(Text(now))


# -- numbers --------------------------------------------------------------------------------------


def shortened(value: int | Fraction) -> str:
    """``p/q`` with the first and last digits of long integers, for people.

    >>> shortened(Fraction(-1197, 16384)), shortened(Fraction(10**30 + 1, 3))
    ('-1197/16384', '10000000{...15 digits...}00000001/3')
    """
    numerator, denominator = value.as_integer_ratio()
    return _short(numerator) + (f"/{_short(denominator)}" if denominator != 1 else "")


def decimal(value: Any, digits: int = 10) -> str:
    """The value in so many significant digits, however small it is; None is a dash.

    >>> decimal(Fraction(1, 3)), decimal(Fraction(1, 10**400)), decimal(0.25), decimal(None)
    ('0.3333333333', '1e-400', '0.25', '-')
    """
    if value is None:
        return "-"
    if isinstance(value, Fraction) and not _float(value) and value:
        with localcontext(prec=digits, Emax=10**9, Emin=-(10**9)):
            return str(Decimal(value.numerator) / Decimal(value.denominator)).lower()
    return f"{float(value):.{digits}g}"


def _short(integer: int) -> str:
    return str(integer) if abs(integer) < 10**DIGITS else str(fmpz(integer).str(condense=DIGITS // 3))


def _float(value: Fraction) -> float | None:
    try:
        return float(value)
    except OverflowError:
        return None


# -- files ----------------------------------------------------------------------------------------


def command_line() -> str:
    """The command as it can be typed again."""
    return shlex.join(["truemean", *sys.argv[1:]])


def write_json(file: str, data: Mapping[str, Any]) -> None:
    """``data`` with command, commit and versions; ``-`` is standard output."""
    from truemean.conformance.provenance import commit, versions

    made = {"command": command_line(), "commit": commit(), "versions": {**data.get("versions", {}), **versions()}}
    write_text(file, json.dumps({**data, **made}, indent=1, ensure_ascii=False, allow_nan=False) + "\n")


def write_text(file: str, text: str) -> None:
    """``text`` in UTF-8 into a file, or as it is on standard output where that is ``-``."""
    if file == "-":
        console().out(text, end="", highlight=False)
        return
    try:
        Path(file).write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{file!r} can't be written ({error.strerror}): give another file") from error


@contextmanager
def replaced(directory: Path, mark: str) -> Iterator[Path]:
    """A new directory that takes the place of ``directory`` as a whole, once it is complete.

    InputError, before anything is done, for one that is neither empty nor a former result, which holds
    the file ``mark``.
    """
    final = directory.resolve()
    _check_replaceable(directory, final, mark)
    new, old = (final.with_name(f".{final.name}.{os.getpid()}.{what}") for what in ("new", "old"))
    try:
        new.mkdir(parents=True)
    except OSError as error:
        raise InputError(
            f"--out {str(directory)!r} can't be made ({error.strerror}): give another directory"
        ) from error
    try:
        yield new
        if final.exists():
            final.rename(old)
        new.rename(final)
    finally:
        if old.exists() and not final.exists():
            old.rename(final)
        for rest in (new, old):
            shutil.rmtree(rest, ignore_errors=True)


def _check_replaceable(directory: Path, final: Path, mark: str) -> None:
    if not final.exists() or (final.is_dir() and ((final / mark).is_file() or not any(final.iterdir()))):
        return
    what = f"a directory without {mark}, hence no former report" if final.is_dir() else "a file"
    raise InputError(f"--out {str(directory)!r} is {what}, and would be replaced: give a new directory, or remove it")
