"""Reading what is written on the command line: PLAN, PIXEL, --set, --range and the places to write to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

from truemean.adapters.registry import parse
from truemean.conformance.pixels import SETS, load_pixels, pixel_by_name, standard_pixels
from truemean.errors import InputError
from truemean.oracle.exact import exact_number, exact_weight
from truemean.oracle.pixel import Pixel, Value
from truemean.oracle.plan import Plan
from truemean.oracle.plans import find_plan
from truemean.oracle.scene import load_scene, shipped_scenes

__all__ = [
    "check_destination",
    "read_pixel",
    "read_pixels",
    "read_plan",
    "read_range",
    "read_tolerances",
    "read_values",
]

PIXEL_FORMS = (
    "'0:7/8,1:1/8', '(1,0,0):1/2,(0,1,0):1/2', 'standard:thin', 'pixels.json:name', 'scene.json#12,7' or 'symbolic:2'"
)


def read_plan(text: str, settings: Sequence[str] = ()) -> tuple[Plan, dict[str, Any]]:
    """The plan that PLAN names and all its parameters, from ``PLAN?name=value`` and from ``--set name=value``.

    PLAN is a name of the catalogue, ``FILE.py:FUNCTION`` or ``MODULE:FUNCTION``; the current directory is
    importable. UnknownName, InputError or PlanError for what can't be read.

    >>> plan, params = read_plan("kirk-arvo?eps=1/4", ["n=8"])
    >>> plan.name, params
    ('kirk-arvo', {'n': 8, 'eps': Fraction(1, 4)})
    >>> read_plan("kirk-arvo", ["n=n"])[1]
    {'n': n, 'eps': 0}
    """
    plan = find_plan(text.partition("?")[0].strip())
    params: dict[str, Any] = dict(parse(text)[2])
    for setting in settings:
        name, equals, value = (part.strip() for part in setting.partition("="))
        if not (name and equals and value):
            raise InputError(f"--set {setting!r} is not name=value: write --set n=4")
        if name in params:
            raise InputError(f"--set {setting!r}: {name} is given twice, give it once")
        params[name] = value
    return plan, plan.bind({name: _number_or_symbol(plan, name, value) for name, value in params.items()})


def _number_or_symbol(plan: Plan, name: str, value: str) -> Any:
    """A word that is no number is a symbol, unless the parameter is a word by default."""
    parameter = plan.signature.parameters.get(name)
    if not value.isidentifier() or parameter is None:
        return value
    if isinstance(parameter.default, str) and not parameter.default[:1].isdigit():
        return value
    from sympy import Symbol

    return Symbol(value)


def read_pixel(text: str) -> Pixel:
    """The pixel X that PIXEL stands for: values with weights, one of a set or of a pixel file, of a scene, or a symbolic one.

    >>> read_pixel("0:7/8, 1:0.125"), read_pixel("(1,0,0):1/2,(0,1,0):1/2").channels
    (Pixel({0: 7/8, 1: 1/8}), 3)
    >>> read_pixel("standard:thin"), read_pixel("tile#4,0")
    (Pixel({0: 63/64, 1: 1/64}), Pixel({0: 15/16, 1: 1/16}))
    """
    written = text.strip()
    try:
        where, colon, _ = written.partition(":")
        if ".json:" in written or (colon and where in SETS):
            return pixel_by_name(written)
        if "#" in written:
            return _scene_pixel(written)
        if written.startswith("symbolic:"):
            return _symbolic_pixel(written.removeprefix("symbolic:"))
        if written[:1].isalpha() and ":" in written:
            return pixel_by_name(written)
        return Pixel(_read_law(written))
    except InputError as error:
        raise InputError(f"pixel {text!r}: {error}") from error


def read_pixels(texts: Sequence[str]) -> dict[str, Pixel] | None:
    """Pixels by name, each text being a set (``standard``, ``hard``, ``scenes``), a pixel file, ``SCENE#*`` or a PIXEL.

    None for no text at all; InputError where one name would stand for two different pixels.

    >>> list(read_pixels(["scenes", "0:1/2,1:1/2"]))[-2:]
    ['wedge#7,0', '0:1/2,1:1/2']
    >>> len(read_pixels(["tile#*"]))
    64
    """
    pixels: dict[str, Pixel] = {}
    for text in texts:
        for name, pixel in _read_several(text).items():
            if name in pixels and pixels[name].law != pixel.law:
                raise InputError(
                    f"--pixels {text!r}: {pixel!r} is called {name!r} like {pixels[name]!r}: rename one, or judge it apart"
                )
            pixels[name] = pixel
    return pixels or None


def _read_several(text: str) -> dict[str, Pixel]:
    if text in SETS:
        return standard_pixels(text)
    if text.endswith("#*"):
        scene, name = load_scene(text[:-2]), text[:-2]
        places = [(x, y) for y in range(scene.height) for x in range(scene.width)]
        return {f"{name}#{x},{y}": scene.pixel(x, y) for x, y in places}
    return load_pixels(text) if text.endswith(".json") else {text: read_pixel(text)}


def read_range(text: str | None) -> tuple[Any, Any] | None:
    """``lo,hi`` as two numbers, either of which may be infinite.

    >>> read_range("-1,3/2"), read_range("-inf,inf")
    ((Fraction(-1, 1), Fraction(3, 2)), (-inf, inf))
    """
    if text is None:
        return None
    low, comma, high = text.partition(",")
    if not comma:
        raise InputError(f"--range {text!r} is not lo,hi: write --range 0,1")
    return _read_end(low), _read_end(high)


def read_tolerances(texts: Sequence[str]) -> str | dict[str, str]:
    """One tolerance for all pixels, or one by pixel, from ``SIZE`` and ``PIXEL=SIZE``.

    >>> read_tolerances(["1%"]), read_tolerances(["1%", "thin=5%"])
    ('1%', {'*': '1%', 'thin': '5%'})
    """
    by_pixel: dict[str, str] = {}
    for text in texts:
        name, equals, size = text.rpartition("=")
        name = name if equals else "*"
        if not (name and size):
            raise InputError(
                f"--tolerance {text!r} is not SIZE or PIXEL=SIZE: write --tolerance 1% --tolerance thin=5%"
            )
        if name in by_pixel:
            raise InputError(f"--tolerance {text!r}: {'all pixels have' if name == '*' else name + ' has'} one already")
        by_pixel[name] = size
    return by_pixel["*"] if list(by_pixel) == ["*"] else by_pixel


def read_values(text: str | None) -> list[Value] | None:
    """Values of a pixel, colours in parentheses.

    >>> read_values("0,1/2")
    [Fraction(0, 1), Fraction(1, 2)]
    """
    return None if text is None else [_read_value(part.strip()) for part in _split(text)]


def check_destination(option: str, file: str | Path | None) -> None:
    """InputError now, rather than after the work, if nothing can be written to ``file``."""
    if file is None or str(file) == "-":
        return
    path = Path(file)
    if path.is_dir():
        raise InputError(f"{option} {str(file)!r} is a directory: give the name of a file")
    if not path.parent.is_dir():
        raise InputError(f"{option} {str(file)!r} is in no directory that exists: make {str(path.parent)!r} first")


def _read_end(text: str) -> Any:
    infinite = text.strip().lstrip("+-").lower() in ("inf", "infinity")
    return float(text) if infinite else exact_number(text, "--range")


def _symbolic_pixel(text: str) -> Pixel:
    """``2`` or ``k`` for so many open values, ``2,ordered`` for ascending ones, ``values=0,1`` for open weights only."""
    if text.startswith("values="):
        values = [exact_number(value, "value") for value in text.removeprefix("values=").split(",")]
        return Pixel.symbolic(len(values), values=values)
    count, _, order = text.partition(",")
    if order not in ("", "ordered") or not (count.isdigit() or count.isidentifier()):
        raise InputError(f"{text!r} is no symbolic pixel: write symbolic:2, symbolic:3,ordered or symbolic:values=0,1")
    if count.isdigit():
        return Pixel.symbolic(int(count), ordered=bool(order))
    from sympy import Symbol

    return Pixel.symbolic(Symbol(count), ordered=bool(order))


def _scene_pixel(text: str) -> Pixel:
    scene, _, position = text.rpartition("#")
    try:
        x, y = (int(part) for part in position.split(","))
    except ValueError:
        raise InputError(f"{position!r} is not x,y: write e.g. {next(iter(shipped_scenes()))}#0,0") from None
    return load_scene(scene).pixel(x, y)


def _read_law(text: str) -> Mapping[Value, Fraction]:
    law: dict[Value, Fraction] = {}
    for item in _split(text):
        value, colon, weight = item.rpartition(":")
        if not (colon and value.strip()):
            raise InputError(f"{item!r} is not value:weight; a pixel is written {PIXEL_FORMS}")
        intensity = _read_value(value.strip())
        law[intensity] = law.get(intensity, Fraction(0)) + exact_weight(weight, f"weight of {value.strip()}")
    return law


def _read_value(text: str) -> Value:
    if text.startswith("(") and text.endswith(")"):
        return tuple(exact_number(channel, "value") for channel in text[1:-1].split(","))
    return exact_number(text, "value")


def _split(text: str) -> list[str]:
    """The parts between those commas that are in no parentheses."""
    parts, depth = [""], 0
    for character in text:
        depth += (character == "(") - (character == ")")
        if character == "," and not depth:
            parts.append("")
        else:
            parts[-1] += character
    return parts
