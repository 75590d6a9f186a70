"""Which adapters there are, by dotted name, and how a SUBJECT string is taken apart."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from importlib import import_module
from importlib.metadata import entry_points
from typing import Any

from truemean.errors import InputError, InputTypeError, UnknownName

__all__ = ["ADAPTERS", "LOAD_SCENE", "Adapter", "adapters", "check_call", "parse", "read_number", "resolve"]


@dataclass(frozen=True, slots=True)
class Adapter:
    """Where an adapter is (``module:name``), how its subjects are written, and what they need.

    ``package`` is the distribution on PyPI that ``extra`` brings; for anything else ``probe`` names a function that
    gives its version, None where it is missing, and ``get`` says how to get it.
    """

    factory: str
    form: str
    help: str
    package: str = ""
    extra: str = ""
    probe: str = ""
    get: str = "built in"

    @property
    def how(self) -> str:
        """How to get what it runs."""
        return f"pip install 'truemean[{self.extra}]'" if self.extra else self.get


ADAPTERS: dict[str, Adapter] = {
    "python": Adapter(
        "truemean.adapters.callables:load_callable",
        "python:MODULE:NAME or python:FILE.py:NAME",
        "a function f(pixel, seeds), f(pixel, seed) or f(pixel, draw), an object with run(pixel, seeds), or its class",
    ),
    "plan": Adapter(
        "truemean.oracle.simulate:PlanEstimator",
        "plan:NAME?param=value",
        "a sampling plan of the catalogue, run as an estimator",
    ),
    "exec": Adapter(
        "truemean.adapters.processes:load_process",
        "exec:COMMAND",
        "a program in any language that speaks the line protocol of docs/protocol.md",
    ),
    "lib": Adapter(
        "truemean.adapters.libraries:load_library",
        "lib:PATH:SYMBOL",
        "a function of a shared library, as adapters/c/truemean.h declares it, in a process of its own",
    ),
    "images": Adapter(
        "truemean.adapters.images:Images",
        "images:DIR?scene=SCENE, images:GLOB?against=DIR",
        "renders of one scene with different seeds, as EXR, PFM, NPY, PNG or PPM files",
    ),
    "raysect": Adapter(
        "truemean.adapters.raysect:Raysect",
        "raysect[:SCENE]?min_samples=4",
        "the ray tracer raysect, adaptive when min_samples is given",
        package="raysect",
        extra="raysect",
    ),
    "mitsuba": Adapter(
        "truemean.adapters.mitsuba:Mitsuba",
        "mitsuba[:SCENE]?sampler=independent",
        "the renderer Mitsuba 3, unbiased; with pilot=4 a two-stage plan that is built on it",
        package="mitsuba",
        extra="mitsuba",
    ),
    "povray": Adapter(
        "truemean.adapters.povray:Povray",
        "povray[:SCENE]?method=1",
        "the ray tracer POV-Ray and its anti-aliasing; it has no seed, a replicate is a position",
        probe="truemean.adapters.povray:installed",
        get="apt-get install povray",
    ),
    "cycles": Adapter(
        "truemean.adapters.cycles:Cycles",
        "cycles[:SCENE]?samples=16",
        "the renderer of Blender, adaptive when adaptive_threshold is given",
        package="bpy",
        extra="cycles",
    ),
    "vegas": Adapter(
        "truemean.adapters.vegas:Vegas",
        "vegas[:SCENE]?nitn=5&neval=100",
        "the adaptive integrator vegas, on the pixels of a scene",
        package="vegas",
        extra="vegas",
    ),
    "gsl": Adapter(
        "truemean.adapters.gsl:Gsl",
        "gsl[:SCENE]?method=vegas",
        "the integrators PLAIN, MISER and VEGAS of the GNU Scientific Library, on the pixels of a scene",
        probe="truemean.adapters.gsl:installed",
        get="apt-get install libgsl27",
    ),
}
ENTRY_POINTS = "truemean.adapters"
LOAD_SCENE = "truemean.oracle.scene:load_scene"


def adapters() -> dict[str, Adapter]:
    """Ours, and those that installed packages bring under the entry point ``truemean.adapters``; ours come first.

    An entry point ``name = "module:factory"`` serves subjects ``name:rest?option=value``: the factory is called with
    ``rest`` and the options as strings, and returns an estimator.
    """
    found = {
        point.name: Adapter(
            point.value,
            f"{point.name}[:...]",
            f"from the package {point.dist.name if point.dist else '?'}",
            package=point.dist.name if point.dist else "",
            get="installed",
        )
        for point in entry_points(group=ENTRY_POINTS)
    }
    return {**ADAPTERS, **{name: adapter for name, adapter in found.items() if name not in ADAPTERS}}


def parse(subject: str) -> tuple[str, str, dict[str, str]]:
    """``(scheme, rest, options)`` of ``scheme:rest?option=value&option=value``, options after the last ``?``.

    >>> parse("plan:kirk-arvo?n=4&eps=0")
    ('plan', 'kirk-arvo', {'n': '4', 'eps': '0'})
    """
    if not isinstance(subject, str):
        raise InputTypeError(
            f"subject={subject!r} (type={type(subject).__name__}) is not a string: "
            "write 'scheme:rest?option=value', or use the estimator itself without load"
        )
    head, mark, query = subject.strip().rpartition("?")
    scheme, _, rest = (head if mark else query).partition(":")
    query = query if mark else ""
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
