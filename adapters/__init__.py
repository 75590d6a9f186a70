"""What makes a sampler or a renderer runnable: ``load("scheme:rest?option=value")`` gives an estimator.

An adapter sees `truemean.subject` and `truemean.errors` only. What it needs of the oracle (plans,
scenes) is reached through the dotted names of `truemean.adapters.registry`. Packages add adapters of their own under
the entry point ``truemean.adapters``.
"""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version
from typing import Any, NamedTuple

from truemean import __version__
from truemean.adapters.callables import asking
from truemean.adapters.crew import Crew
from truemean.adapters.registry import Adapter, adapters, check_call, parse, resolve
from truemean.errors import InputError, SubjectError, TruemeanError, UnknownName, raised
from truemean.subject import as_estimator

__all__ = ["Available", "asking", "available", "load"]


class Available(NamedTuple):
    """One adapter: ``version`` of what it runs, None when that is not installed, and ``how`` to get it."""

    name: str
    version: str | None
    how: str
    help: str


def load(subject: str, *, jobs: int = 0, timeout: float = 600) -> Any:
    """The estimator that SUBJECT names: ``scheme:rest?option=value&option=value``.

    ``rest`` and the options are the arguments of the adapter. With ``jobs`` it is run in so many processes of its own,
    where it may crash, or hang for ``timeout`` seconds, without harm. Raises UnknownName for an unknown
    adapter or option, InputError for a subject that can't be read, MissingExtra when the adapter's
    package is not installed, SubjectError with the line when the subject's own code fails while it is loaded.

    >>> load("python:truemean.adapters.reference:KirkArvo?n=8").n
    8
    """
    scheme, rest, options = parse(subject)
    known = adapters()
    if scheme not in known:
        raise UnknownName("adapter", scheme, known)
    factory = _factory(scheme, known[scheme])
    arguments = (rest,) if rest else ()
    check_call(f"adapter {scheme}", factory, arguments, options)
    try:
        estimator = as_estimator(factory(*arguments, **options))
    except TruemeanError:
        raise
    except (Exception, SystemExit) as error:
        raise SubjectError(f"subject={subject!r} can't be loaded: {raised(error)}") from error
    if not (isinstance(jobs, int) and jobs >= 0):
        raise InputError(f"jobs={jobs!r} is no number of processes: give a whole number from 0 up")
    return Crew(subject, estimator, jobs, timeout) if jobs else estimator


def _factory(scheme: str, adapter: Adapter) -> Any:
    try:
        return resolve(adapter.factory)
    except (ImportError, AttributeError) as error:
        raise InputError(
            f"adapter {scheme}, {adapter.factory} of {adapter.help}, can't be imported: {error}; install it again"
        ) from error


def available() -> list[Available]:
    """Every adapter, installed or not, in the order of the registry, then those of other packages.

    >>> [adapter.name for adapter in available()][:5]
    ['python', 'plan', 'exec', 'lib', 'images']
    """
    return [
        Available(name, _installed(adapter), adapter.how, f"{adapter.form}: {adapter.help}")
        for name, adapter in adapters().items()
    ]


def _installed(adapter: Adapter) -> str | None:
    if adapter.probe:
        found: str | None = resolve(adapter.probe)()
        return found
    try:
        return version(adapter.package) if adapter.package else __version__
    except PackageNotFoundError:
        return None
