"""``python:module:name`` and ``python:path/to/file.py:name``: an estimator in the reader's own Python."""

from __future__ import annotations

import inspect
import sys
from functools import partial, update_wrapper
from importlib import import_module
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import ModuleType
from typing import Any

from truemean.adapters.registry import check_call, read_number
from truemean.errors import InputError, InputTypeError, UnknownName

__all__ = ["load_callable"]


def load_callable(target: str, /, **options: Any) -> Any:
    """The estimator called ``name`` in a module or a file, ``target`` being ``place:name``.

    A function ``f(pixel, seeds)`` gets the options as keyword arguments of every call and keeps its
    attributes; a class is instantiated with them; an object with ``run`` takes none. Options that
    read as numbers are given as numbers. The current directory is importable.

    >>> load_callable("truemean.adapters.reference:KirkArvo", n="8")
    KirkArvo(n=8, eps=0)
    """
    place, _, name = target.rpartition(":")
    if not (place and name):
        raise InputError(f"python subject {target!r} is not MODULE:NAME or FILE.py:NAME: write 'python:my_module:f'")
    module = _import(place)
    if not hasattr(module, name):
        raise UnknownName(f"object of {place}", name, [n for n in vars(module) if not n.startswith("_")])
    return _configured(target, getattr(module, name), {key: read_number(text) for key, text in options.items()})


def _configured(target: str, thing: Any, options: dict[str, Any]) -> Any:
    if inspect.isclass(thing):
        check_call(target, thing, (), options)
        return thing(**options)
    if callable(getattr(thing, "run", None)):
        if options:
            raise InputError(f"{target} is an object and takes no options, but got {options}: name its class instead")
        return thing
    if not callable(thing):
        raise InputTypeError(
            f"{target} is {thing!r:.80} (type={type(thing).__name__}): "
            "name a function f(pixel, seeds), an object with run(pixel, seeds) or a class of such objects"
        )
    check_call(target, thing, ("pixel", "seeds"), options)
    return update_wrapper(partial(thing, **options), thing) if options else thing


def _import(place: str) -> ModuleType:
    """The module at a dotted name or a path; InputError when there is none."""
    path = Path(place)
    is_file = path.suffix == ".py"
    if is_file and not path.is_file():
        raise InputError(f"there is no file {place!r} in {Path.cwd()}: write python:path/to/file.py:name")
    folder = str(path.resolve().parent if is_file else Path.cwd())
    if folder not in sys.path:
        sys.path.insert(0, folder)
    try:
        return _run_file(path) if is_file else import_module(place)
    except ModuleNotFoundError as error:
        if not f"{place}.".startswith(f"{error.name}."):
            raise
        raise InputError(
            f"there is no module {error.name!r}, looked for in {folder} and among the installed ones: "
            "write python:package.module:name or python:path/to/file.py:name"
        ) from None


def _run_file(path: Path) -> ModuleType:
    module = ModuleType(f"truemean_subject_{path.stem}")
    module.__file__ = str(path.resolve())
    sys.modules[module.__name__] = module
    SourceFileLoader(module.__name__, module.__file__).exec_module(module)
    return module
