"""Which adapters there are, by dotted name, and how a SUBJECT string is taken apart."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from importlib import import_module
from typing import Any

from truemean.errors import InputError, InputTypeError, UnknownName

__all__ = ["ADAPTERS", "LOAD_SCENE", "Adapter", "check_call", "parse", "read_number", "resolve"]


@dataclass(frozen=True, slots=True)
class Adapter:
    """Where an adapter is (``module:name``), how its subjects are written, and what they need."""

    factory: str
    form: str
    help: str
    package: str = "truemean"

    @property
    def how(self) -> str:
        """How to get what it runs."""
        return "built in" if self.package == "truemean" else f"pip install 'truemean[{self.package}]'"


ADAPTERS: dict[str, Adapter] = {
    "python": Adapter(
        "truemean.adapters.callables:load_callable",
        "python:MODULE:NAME or python:FILE.py:NAME",
        "a function f(pixel, seeds), an object with run(pixel, seeds), or a class of such objects",
    ),
    "plan": Adapter(
        "truemean.oracle.simulate:PlanEstimator",
        "plan:NAME?param=value",
        "a sampling plan of the catalogue, run as an estimator",
    ),
    "raysect": Adapter(
        "truemean.adapters.raysect:Raysect",
        "raysect[:SCENE]?min_samples=4",
        "the ray tracer raysect, adaptive when min_samples is given",
        package="raysect",
    ),
}
LOAD_SCENE = "truemean.oracle.scene:load_scene"


def parse(subject: str) -> tuple[str, str, dict[str, str]]:
    """``(scheme, rest, options)`` of ``scheme:rest?option=value&option=value``.

    >>> parse("plan:kirk-arvo?n=4&eps=0")
    ('plan', 'kirk-arvo', {'n': '4', 'eps': '0'})
    """
    if not isinstance(subject, str):
        raise InputTypeError(
            f"subject={subject!r} (type={type(subject).__name__}) is not a string: "
            "write 'scheme:rest?option=value', or use the estimator itself without load"
        )
    head, _, query = subject.strip().partition("?")
    scheme, _, rest = head.partition(":")
    if not scheme:
        raise InputError(f"subject={subject!r} names no adapter: write 'scheme:rest?option=value', such as {_forms()}")
    options: dict[str, str] = {}
    for item in query.split("&") if query else ():
        option, equals, value = item.partition("=")
        if not (option and equals and value):
            raise InputError(f"option {item!r} of subject={subject!r} is not 'option=value'")
        if option in options:
            raise InputError(f"option {option!r} is given twice in subject={subject!r}: give it once")
        options[option] = value
    return scheme, rest, options


def resolve(dotted: str) -> Any:
    """The object that ``module:name`` stands for.

    >>> resolve("fractions:Fraction")(1, 2)
    Fraction(1, 2)
    """
    module, _, name = dotted.partition(":")
    return getattr(import_module(module), name)


def check_call(what: str, factory: Callable[..., Any], arguments: tuple[Any, ...], options: Mapping[str, Any]) -> None:
    """UnknownName or InputError, in words of the subject, unless ``factory(*arguments, **options)`` can be called."""
    try:
        signature = inspect.signature(factory)
    except ValueError:  # compiled code may have none
        return
    kinds = [parameter.kind for parameter in signature.parameters.values()]
    if inspect.Parameter.VAR_KEYWORD not in kinds:
        named = list(signature.parameters)[len(arguments) :]
        for option in options:
            if option not in named:
                raise UnknownName(f"option of {what}", option, named or ["none, it takes no options"])
    try:
        signature.bind(*arguments, **options)
    except TypeError as error:
        raise InputError(f"{what} can't be called: {error}; it takes {signature}") from None


def read_number(value: Any) -> Any:
    """The number that the text of an option stands for, an int where it is whole; other text as it is.

    >>> read_number("4"), read_number("1e9"), read_number("1/4"), read_number("tile")
    (4, 1000000000.0, 0.25, 'tile')
    """
    if not isinstance(value, str):
        return value
    for read in (int, lambda text: float(Fraction(text))):
        try:
            return read(value)
        except (ValueError, ZeroDivisionError, OverflowError):
            continue
    return value


def _forms() -> str:
    return ", ".join(repr(adapter.form) for adapter in ADAPTERS.values())
