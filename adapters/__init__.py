"""What makes a sampler or a renderer runnable: ``load("scheme:rest?option=value")`` gives an estimator.

An adapter sees `truemean.subject` and `truemean.errors` only. What it needs of the oracle (plans,
scenes) is reached through the dotted names of `truemean.adapters.registry`.
"""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version
from typing import Any, NamedTuple

from truemean import __version__
from truemean.adapters.registry import ADAPTERS, check_call, parse, resolve
from truemean.errors import SubjectError, TruemeanError, UnknownName, raised
from truemean.subject import as_estimator

__all__ = ["Available", "available", "load"]


class Available(NamedTuple):
    """One adapter: ``version`` of what it runs, None when that is not installed, and ``how`` to get it."""

    name: str
    version: str | None
    how: str
    help: str


def load(subject: str) -> Any:
    """The estimator that SUBJECT names: ``scheme:rest?option=value&option=value``.

    ``rest`` and the options are the arguments of the adapter. Raises UnknownName for an unknown
    adapter or option, InputError for a subject that can't be read, MissingExtra when the adapter's
    package is not installed, SubjectError with the line when the subject's own code fails while it is loaded.

    >>> load("python:truemean.adapters.reference:KirkArvo?n=8").n
    8
    """
    scheme, rest, options = parse(subject)
    if scheme not in ADAPTERS:
        raise UnknownName("adapter", scheme, ADAPTERS)
    factory = resolve(ADAPTERS[scheme].factory)
    arguments = (rest,) if rest else ()
    check_call(f"adapter {scheme}", factory, arguments, options)
    try:
        return as_estimator(factory(*arguments, **options))
    except TruemeanError:
        raise
    except (Exception, SystemExit) as error:
        raise SubjectError(f"subject={subject!r} can't be loaded: {raised(error)}") from error


def available() -> list[Available]:
    """Every adapter, installed or not, in the order of the registry.

    >>> [adapter.name for adapter in available()]
    ['python', 'plan', 'raysect']
    """
    return [
        Available(name, _installed(adapter.package), adapter.how, f"{adapter.form}: {adapter.help}")
        for name, adapter in ADAPTERS.items()
    ]


def _installed(package: str) -> str | None:
    if package == "truemean":
        return __version__
    try:
        return version(package)
    except PackageNotFoundError:
        return None
