"""The standard pixels are what their lines say."""

from fractions import Fraction

import pytest

from truemean.conformance import pixel_by_name, standard_pixels
from truemean.conformance.pixels import SETS
from truemean.errors import InputError, UnknownName


def test_the_first_set():
    pixels = standard_pixels()
    white = [
        pixels[name].mean for name in ("thin", "eighth", "quarter", "half", "three-quarters", "seven-eighths", "gap")
    ]
    assert white == [Fraction(w) for w in ("1/64", "1/8", "1/4", "1/2", "3/4", "7/8", "63/64")]
    assert [len(pixels[name].values) for name in ("three-tones", "eight-tones", "constant")] == [3, 8, 1]


def test_colours_of_equal_luminance():
    colours = standard_pixels()["equal-luminance"].values
    assert len({2126 * r + 7152 * g + 722 * b for r, g, b in colours}) == 1
    assert len(colours) > 1


def test_the_hard_set():
    hard = standard_pixels("hard")
    assert min(hard["offset"].values) == 10**8
    assert dict(hard["rare-bright"].law) == {0: Fraction(999, 1000), 1000: Fraction(1, 1000)}
    assert hard["nearly-equal"].scale == Fraction(1, 10**6)


def test_every_pixel_says_what_it_stresses():
    lines = [standard.stresses for pixels in SETS.values() for standard in pixels.values()]
    assert len(set(lines)) == len(lines)
    assert all(line and "\n" not in line for line in lines)


def test_names():
    assert pixel_by_name("hard:offset") is standard_pixels("hard")["offset"]
    with pytest.raises(UnknownName, match="did you mean thin"):
        pixel_by_name("standard:thinn")
    with pytest.raises(UnknownName, match="hard"):
        standard_pixels("harder")
    with pytest.raises(InputError, match="standard:thin"):
        pixel_by_name("thin")
