"""Reading JSON that people write: every number is taken as written, and an error names the place, the value there and the way out."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import Any

from truemean.errors import InputError, SceneError, UnknownName
from truemean.oracle.exact import exact_number

__all__ = ["check_keys", "placed", "read_json", "read_list", "read_number", "read_value", "read_whole"]


@contextmanager
def placed(place: str | Path) -> Iterator[None]:
    """InputErrors raised inside become SceneErrors that begin with the place.

    >>> with placed("mine.json"):
    ...     read_number("1/0", "background")
    Traceback (most recent call last):
    truemean.errors.SceneError: mine.json: background='1/0' is not an exact number: write an integer, 'p/q' or '0.875'
    """
    try:
        yield
    except InputError as error:
        raise SceneError(f"{place}: {error}") from None


def read_json(path: Path, example: Path, missing: str) -> Any:
    """What a file says, its decimals as strings; SceneError, with ``missing`` as the way out where no file is."""
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise SceneError(f"no file is called {str(path)!r}; {missing}") from None
    except (OSError, UnicodeDecodeError) as error:
        raise SceneError(f"{path}: can't be read ({error}): give a JSON file in UTF-8, such as {example}") from None
    with placed(path):
        try:
            return json.loads(text, parse_float=str, parse_constant=str, object_pairs_hook=_distinct)
        except SceneError:
            raise
        except (ValueError, RecursionError) as error:
            raise SceneError(f"is not JSON ({error}): start from {example}") from None


def check_keys(data: Any, where: str, required: Iterable[str], optional: Iterable[str] = ()) -> None:
    """SceneError unless ``data`` is an object with the required keys and no unknown one."""
    if not isinstance(data, Mapping):
        raise SceneError(f"{where}={data!r:.80} is not an object: write {{...}} with {', '.join(required)}")
    known = (*required, *optional)
    for key in data:
        if key not in known:
            raise SceneError(f"{where}: {UnknownName('key', str(key), known)}")
    for key in required:
        if key not in data:
            raise SceneError(f"{where}={data!r:.80} has no {key!r}: it needs {', '.join(required)}")


def read_list(raw: Any, where: str, wanted: str, length: int | None = None) -> Sequence[Any]:
    """A list, of the given length if any; SceneError for anything else."""
    if not isinstance(raw, list | tuple) or length not in (None, len(raw)):
        raise SceneError(f"{where}={raw!r:.80} is not {wanted}")
    return raw


def read_whole(raw: Any, where: str, of: str) -> int:
    """A positive integer; SceneError for anything else, such as a size of 0 pixels."""
    if not isinstance(raw, int) or isinstance(raw, bool) or raw < 1:
        raise SceneError(f"{where}={raw!r:.80} must be a positive whole number{of}")
    return raw


def read_number(raw: Any, where: str) -> Fraction:
    """A number as it is written: an integer, a decimal or ``"p/q"``; SceneError for a binary float."""
    if isinstance(raw, int | str | Fraction) and not isinstance(raw, bool):
        try:
            return exact_number(raw)
        except InputError:
            pass
    raise SceneError(f"{where}={raw!r:.80} is not an exact number: write an integer, 'p/q' or '0.875'")


def read_value(raw: Any, where: str) -> Any:
    """A value of a pixel: a number, or three for a colour."""
    if isinstance(raw, list | tuple):
        colour = read_list(raw, where, "a colour: write three numbers [red, green, blue]", 3)
        return tuple(read_number(channel, f"{where}[{i}]") for i, channel in enumerate(colour))
    return read_number(raw, where)


def _distinct(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise SceneError(f"the name {key!r} comes twice in one object: keep one of them, or rename it")
        found[key] = value
    return found
