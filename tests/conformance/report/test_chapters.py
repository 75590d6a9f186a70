"""What the chapters say is what an independent formula says."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest
from tests.oracle.catalogue_cases import OF_A_SCENE

from truemean.conformance.report import charts, curves, speed
from truemean.oracle import Pixel
from truemean.oracle.plans import catalogue

EIGHTHS = [Fraction(i, 8) for i in range(1, 8)]


def eq_6(law, n):
    """The bias of Fig. 1: the sum of omega_i^n (I_i - I)."""
    mean = sum(weight * value for value, weight in law.items())
    return sum(weight**n * (value - mean) for value, weight in law.items())


def read(number):
    return Fraction(number["exact"])


def test_figs_3_and_4_are_eq_6(built):
    section = built.data["sections"]["bias"]
    assert [Fraction(omega) for omega in section["omega_1"]] == EIGHTHS
    assert section["n"] == list(range(1, 33))
    for curve, omega_1 in zip(section["curves"], EIGHTHS, strict=True):
        expected = [eq_6({0: omega_1, 1: 1 - omega_1}, n) for n in range(1, 33)]
        assert [read(b) for b in curve["bias"]] == expected
        assert [read(b) for b in curve["percent"]] == [100 * b / (1 - omega_1) for b in expected]


def test_fig_5_is_eq_6_in_every_pixel_and_its_unbiased_image_is_the_truth(built):
    section = built.data["sections"]["images"]
    assert read(section["largest_unbiased_bias"]) == 0
    assert len(section["biased_pixels"]) > 40
    for pixel in section["biased_pixels"]:
        white = read(pixel["true_mean"])
        assert read(pixel["bias"]) == eq_6({0: 1 - white, 1: white}, section["n"])


def test_every_plan_is_tabled_on_every_pixel(built):
    table = built.data["sections"]["plans"]["table"]
    pixels = list(dict.fromkeys(entry["pixel"] for entry in table))
    assert len(pixels) == 10 + 3 + 1
    assert [(e["pixel"], e["plan"]) for e in table] == [(pixel, plan) for pixel in pixels for plan in catalogue]
    assert {e["plan"] for e in table if "missing" in e} == {*OF_A_SCENE}
    for plan in OF_A_SCENE:
        assert [e["pixel"] for e in table if e["plan"] == plan and "missing" not in e] == ["tile#4,1"]
    found = {(e["plan"], e["pixel"]): e for e in table if "missing" not in e}
    assert read(found["kirk-arvo", "eighth"]["bias"]) == Fraction(-1197, 16384)
    assert all(read(e["bias"]) == 0 for (plan, _), e in found.items() if catalogue[plan].unbiased)
    biased = [plan for plan in catalogue if catalogue[plan].unbiased is False]
    assert all(read(found[plan, "tile#4,1" if plan in OF_A_SCENE else "eighth"]["bias"]) < 0 for plan in biased)


def test_cost_against_error_has_every_plan_at_every_pilot(built):
    points = built.data["sections"]["plans"]["cost_error"]
    assert set(points) == set(catalogue)
    for line in points.values():
        assert [point["pilot"] for point in line] == [2, 4, 8, 16, 32]
        costs = [read(point["cost"]) for point in line]
        assert costs == sorted(set(costs))


@pytest.mark.parametrize("weight", speed.PIXELS)
def test_the_naive_formulas_are_those_of_the_paper(weight):
    pixel = Pixel.two(weight)
    exact = eq_6(pixel.law, 5)
    assert speed.exact_bias(pixel, 5) == exact
    for formula in speed.NAIVE.values():
        assert speed.digits(formula(*pixel.arrays(), 5), exact) > 12


@pytest.mark.parametrize(("weight", "n", "method", "why"), speed.FAILURES)
def test_where_a_naive_formula_fails_the_engine_is_exact_and_its_float_bound_holds(weight, n, method, why):
    exact, approx, naive = speed.failure(weight, n, method)
    assert exact == eq_6({0: 1 - Fraction(weight), 1: Fraction(weight)}, n)
    assert speed.digits(naive, exact) < 6, why
    assert abs(Fraction(approx.value) - exact) <= Fraction(approx.error)


def test_the_engine_is_timed_at_every_n_and_always_exact(built):
    for weight, measured in built.data["sections"]["speed"]["measured"].items():
        assert {(m["method"], m["n"]) for m in measured} == {
            (method, 2**power) for method in speed.METHODS for power in range(2, 13)
        }, weight
        assert {m["digits"] for m in measured if m["method"] == "engine: exact"} == {"all"}
        assert all(m["seconds"] > 0 for m in measured)
        assert {m["digits"] for m in measured if m["n"] == 4096 and m["method"] in speed.NAIVE} == {0.0}


@pytest.mark.parametrize(
    ("value", "truth", "right"),
    [
        (0.125, Fraction(1, 8), 16),
        (0.0, Fraction(1, 8), 0),
        (math.nan, Fraction(1), 0),
        (1e-20, Fraction(1, 10**800), 0),
    ],
)
def test_digits_at_the_ends(value, truth, right):
    assert speed.digits(value, truth) == right


def test_a_drawing_repeats_itself_and_shares_no_id_with_another():
    one, again, other = (charts.inline_svg(curves.absolute(4), name) for name in ("a", "a", "b"))
    assert one == again
    assert 'id="a-' in one
    assert 'id="a-' not in other
    assert "var(--ink)" in one
