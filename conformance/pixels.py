"""The standard pixels: small populations, each of which stresses one thing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from types import MappingProxyType

from truemean.errors import InputError, UnknownName
from truemean.oracle.pixel import Pixel

__all__ = ["SETS", "StandardPixel", "pixel_by_name", "standard_pixels"]


@dataclass(frozen=True, slots=True)
class StandardPixel:
    """A pixel and one line on what it stresses."""

    pixel: Pixel
    stresses: str


GREEN = Fraction(2126, 7152)  # as luminous as pure red, by the weights of Rec. 709
GREY = Fraction(2126, 10000)

SETS: Mapping[str, Mapping[str, StandardPixel]] = MappingProxyType(
    {
        "standard": {
            "thin": StandardPixel(Pixel.two("1/64"), "a thin white line: most pilots miss it"),
            "eighth": StandardPixel(Pixel.two("1/8"), "the paper's pixel: white on one eighth"),
            "quarter": StandardPixel(Pixel.two("1/4"), "white on one quarter"),
            "half": StandardPixel(Pixel.two("1/2"), "an edge through the middle: biases cancel by symmetry"),
            "three-quarters": StandardPixel(Pixel.two("3/4"), "white on three quarters: bias of the other sign"),
            "seven-eighths": StandardPixel(Pixel.two("7/8"), "mirror image of eighth"),
            "gap": StandardPixel(Pixel.two("63/64"), "mirror image of thin: a thin black line"),
            "three-tones": StandardPixel(
                Pixel({0: "1/2", "1/2": "1/4", 1: "1/4"}), "a middle tone: pilots that agree are not the only easy ones"
            ),
            "eight-tones": StandardPixel(
                Pixel({Fraction(i, 7): Fraction(8 - i, 36) for i in range(8)}),
                "texture: many tones, darker ones larger",
            ),
            "equal-luminance": StandardPixel(
                Pixel({(1, 0, 0): "1/2", (0, GREEN, 0): "1/4", (GREY, GREY, GREY): "1/4"}),
                "colours of equal luminance: contrast measured on luminance sees none",
            ),
            "constant": StandardPixel(Pixel({"3/8": 1}), "one tone: every estimate must be this value"),
        },
        "hard": {
            "offset": StandardPixel(
                Pixel({10**8: "7/8", 10**8 + 1: "1/8"}), "contrast 1 on top of 10^8: cancellation in sums of squares"
            ),
            "rare-bright": StandardPixel(
                Pixel({0: "999/1000", 1000: "1/1000"}), "a firefly: almost every replicate sees only black"
            ),
            "nearly-equal": StandardPixel(
                Pixel({"0.5": "7/8", "0.500001": "1/8"}), "contrast 10^-6: thresholds and 8 bit outputs see none"
            ),
        },
    }
)


def standard_pixels(name: str = "standard") -> dict[str, Pixel]:
    """The pixels X of a set, ``"standard"`` or ``"hard"``: name -> Pixel; UnknownName for any other.

    >>> standard_pixels("hard")["rare-bright"].mean
    Fraction(1, 1)
    """
    if name not in SETS:
        raise UnknownName("set of pixels", name, SETS)
    return {short: standard.pixel for short, standard in SETS[name].items()}


def pixel_by_name(name: str) -> Pixel:
    """The pixel X called ``"set:name"`` on the command line; UnknownName or InputError for any other.

    >>> pixel_by_name("standard:thin").mean
    Fraction(1, 64)
    """
    where, colon, short = name.partition(":")
    if not colon:
        raise InputError(f"pixel={name!r} names no set: write 'standard:{name}' or 'hard:{name}'")
    pixels = standard_pixels(where)
    if short not in pixels:
        raise UnknownName(f"pixel of the set {where!r}", short, pixels)
    return pixels[short]
