"""``python:module:name`` and ``python:path/to/file.py:name``: an estimator in the reader's own Python."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable
from functools import partial, update_wrapper
from importlib import import_module
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import ModuleType
from typing import Any

from truemean.adapters.exhaustive import Asking, replay_of
from truemean.adapters.registry import check_call, read_number
from truemean.errors import InputError, InputTypeError, UnknownName
from truemean.subject import argument_names

__all__ = ["asking", "load_callable"]


def load_callable(target: str, /, **options: Any) -> Any:
    """The estimator called ``name`` in a module or a file, ``target`` being ``place:name``.

    A function ``f(pixel, seeds)`` or ``f(pixel, seed)`` gets the options as keyword arguments of every call and keeps
    its attributes; so does one that asks for its samples, ``f(pixel, draw)`` or ``f(draw)``, but for ``paths`` and
    ``order``, which say how it is enumerated. A class is instantiated with the options; an object with ``run`` takes
    none. Options that read as numbers are given as numbers. The current directory is importable.

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


def asking(function: Callable[..., Any], *, paths: Any = 300_000, order: str = "sequence", **options: Any) -> Asking:
    """An estimator made of a function that asks for its samples, ``f(pixel, draw)`` or ``f(draw)``.

    Its law is found exactly by answering every request in every way, with at most ``paths`` runs on a pixel; beyond
    that it is judged by sampled answers. ``order`` is which order of its samples makes a difference: the whole
    ``sequence``, none within ``blocks`` asked for at once by ``draw(n)``, or none in ``all`` of them. Attributes of the function
    stay visible. Raises InputError for options that can't be meant.

    >>> from truemean.oracle import Pixel
    >>> asking(lambda draw: (draw() + draw()) / 2).exact(Pixel.two("1/4")).law
    {Fraction(0, 1): Fraction(9, 16), Fraction(1, 2): Fraction(3, 8), Fraction(1, 1): Fraction(1, 16)}
    """
    if not callable(function):
        raise InputTypeError(
            f"function={function!r:.80} (type={type(function).__name__}) can't ask: give f(pixel, draw) or f(draw)"
        )
    before = ("draw",) if argument_names(function)[:1] == ["draw"] else ("pixel", "draw")
    name = getattr(function, "__name__", type(function).__name__)
    check_call(name, function, before, options)
    estimator = Asking(replay_of(function, **options), name=name, paths=paths, order=order)
    for attribute, value in getattr(function, "__dict__", {}).items():
        # What is known of its runs is not the function's to say.
        if not attribute.startswith("_") and (attribute == "name" or not hasattr(estimator, attribute)):
            setattr(estimator, attribute, value)
    return estimator


def _configured(target: str, thing: Any, options: dict[str, Any]) -> Any:
    if inspect.isclass(thing):
        check_call(target, thing, (), options)
        return _configured(target, thing(**options), {})
    if callable(getattr(thing, "run", None)):
        if options:
            raise InputError(f"{target} is an object and takes no options, but got {options}: name its class instead")
        return thing
    if not callable(thing):
        raise InputTypeError(
            f"{target} is {thing!r:.80} (type={type(thing).__name__}): "
            "name a function f(pixel, seeds) or f(pixel, draw), an object with run(pixel, seeds) or a class of such objects"
        )
    if "draw" in argument_names(thing)[:2]:
        return asking(thing, **options)
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
