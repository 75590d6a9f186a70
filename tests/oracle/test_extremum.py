"""Certified extrema against dense rational grids, closed forms, mpmath, and each other."""

import random
from collections import Counter
from fractions import Fraction
from itertools import combinations_with_replacement, product
from math import comb, factorial, prod
from typing import Any

import mpmath
import pytest
from flint import ctx
from hypothesis import given
from hypothesis import strategies as st

from truemean.errors import InputError, InputTypeError
from truemean.oracle.branching import _negative_semidefinite
from truemean.oracle.extremum import Extremum, below, supremum, supremum_ratio, supremum_simplex

F = Fraction
HALF: Any = 0.5  # of a type that is refused
rationals = st.fractions(min_value=-3, max_value=3, max_denominator=12)
univariate = st.lists(rationals, max_size=7)


def kirk_arvo(n):
    """w^n(1-w) - w(1-w)^n, ascending: the bias on a pixel of two values."""
    found = [F(0)] * (n + 2)
    for power, factor in ((n, 1), (n + 1, -1)):
        found[power] += factor
    for j in range(n + 1):
        found[j + 1] -= comb(n, j) * (-1) ** j
    return found


def at(coefficients, w):
    return sum((c * w**i for i, c in enumerate(coefficients)), F(0))


def at_point(terms, point):
    return sum((c * prod(w**e for w, e in zip(point, powers, strict=True)) for powers, c in terms.items()), F(0))


def simplex_grid(k, size):
    for counts in product(range(size + 1), repeat=k - 1):
        if sum(counts) <= size:
            yield (*(F(c, size) for c in counts), F(size - sum(counts), size))


def lifted(coefficients, k, which=0):
    """The polynomial of one of k weights."""
    return {tuple(i if j == which else 0 for j in range(k)): c for i, c in enumerate(coefficients) if c}


def random_form(k, degree, seed):
    """Small at the corners, wild elsewhere."""
    generator, found = random.Random(seed), {}
    for chosen in combinations_with_replacement(range(k), degree):
        powers = tuple(Counter(chosen)[i] for i in range(k))
        size = factorial(degree) // prod(map(factorial, powers))
        found[powers] = F(0 if max(powers) == degree else generator.randint(-99, 99) * size, 100)
    return found


def check(found, value, grid, digits=30, absolute=True):
    """What an ``Extremum`` promises, against values on a grid."""
    size = abs if absolute else lambda x: x
    assert found.lower <= size(value(found.point)) <= found.upper
    assert found.value_sign == (value(found.point) > 0) - (value(found.point) < 0)
    assert all(size(value(point)) <= found.upper for point in grid)
    if absolute:
        assert found.upper - found.lower <= min(1, found.lower) / 10**digits
    else:
        assert found.upper - found.lower <= F(1, 10**digits)


# -- one variable ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("coefficients", "value", "point", "sign"),
    [
        ([0, 1, -1], F(1, 4), F(1, 2), 1),
        ([0, -1, 1], F(1, 4), F(1, 2), -1),
        ([0, 0, 1, -1], F(4, 27), F(2, 3), 1),
        ([0, 2], F(2), F(1), 1),
        ([1, -2], F(1), F(0), 1),
        ([-3, 1], F(3), F(0), -1),
        ([F(-5, 7)], F(5, 7), F(0), -1),
        ([1, -8, 8], F(1), F(0), 1),
        ([-1, 18, -48, 32], F(1), F(0), -1),
        ([], F(0), F(0), 0),
        ([0, 0, 0], F(0), F(0), 0),
    ],
)
def test_a_rational_supremum_is_exact(coefficients, value, point, sign):
    assert supremum(coefficients) == Extremum(value, value, True, (point,), sign)


@pytest.mark.parametrize("n", [*range(2, 13), 64])
def test_kirk_arvo_against_mpmath(n):
    p = kirk_arvo(n)
    found = supremum(p, digits=40)
    with mpmath.workdps(80):
        slope = [mpmath.mpf(int(i * c)) for i, c in enumerate(p)][1:]
        bracket = mpmath.mpf(1) / (2 * n + 2), mpmath.mpf(3) / (2 * n + 2)
        w = mpmath.findroot(lambda x: mpmath.polyval(slope[::-1], x), bracket, solver="illinois")
        best = abs(w**n * (1 - w) - w * (1 - w) ** n)
        low, high = (mpmath.mpf(x.numerator) / x.denominator for x in (found.lower, found.upper))
        assert low < best < high
    assert found.attained
    assert found.point[0] < F(1, 2)
    assert found.value_sign == -1
    check(found, lambda point: at(p, point[0]), [(F(i, 300),) for i in range(301)], digits=40)


def test_the_sign_of_mirrored_maxima_is_told_apart_on_request():
    p = kirk_arvo(8)
    signed, mirrored = supremum(p, absolute=False), supremum([-c for c in p], absolute=False)
    assert signed.point[0] > F(1, 2) > mirrored.point[0]
    assert signed.value_sign == mirrored.value_sign == 1
    assert max(signed.lower, mirrored.lower, supremum(p).lower) <= min(signed.upper, mirrored.upper, supremum(p).upper)


@given(univariate)
def test_a_dense_grid_stays_below(p):
    check(supremum(p, digits=25), lambda point: at(p, point[0]), [(F(i, 64),) for i in range(65)], digits=25)


@given(univariate)
def test_a_dense_grid_stays_below_with_its_sign(p):
    grid = [(F(i, 64),) for i in range(65)]
    check(supremum(p, 9, absolute=False), lambda point: at(p, point[0]), grid, digits=9, absolute=False)


def test_a_signed_supremum_can_be_zero_at_an_irrational_point():
    found = supremum([F(-1, 4), 0, 1, 0, -1], absolute=False)
    assert found.lower <= 0 <= found.upper
    assert found.upper - found.lower < F(1, 10**30)
    assert abs(found.point[0] ** 2 - F(1, 2)) < F(1, 10**10)


def test_a_rational_value_at_irrational_points_is_enclosed():
    found = supremum([0, 0, 4, 0, -4])
    assert found.lower < 1 < found.upper
    assert abs(found.point[0] ** 2 - F(1, 2)) < F(1, 10**10)


# -- where 0 is left out -----------------------------------------------------------------------------


@pytest.mark.parametrize("n", [2, 3, 8, 20])
def test_the_relative_bias_of_kirk_arvo_has_a_limit(n):
    found = supremum_ratio(kirk_arvo(n), [0, 1])
    assert (found.lower, found.upper, found.attained, found.value_sign) == (1, 1, False, -1)
    (w,) = found.point
    assert w > 0
    assert 1 - F(1, 10**30) <= abs(at(kirk_arvo(n), w) / w) < 1
    assert found == supremum(kirk_arvo(n)[1:], open_at_zero=True)


def test_a_limit_that_something_attains_is_attained():
    assert supremum([1, -2], open_at_zero=True) == Extremum(F(1), F(1), True, (F(1),), -1)
    assert supremum([F(1, 2)], open_at_zero=True) == Extremum(F(1, 2), F(1, 2), True, (F(1),), 1)
    assert supremum([1, -1], open_at_zero=True).attained is False


def test_a_limit_that_only_an_irrational_point_attains():
    p = [F(1), 0, -1, 0, 4, 0, -4]
    assert supremum(p).point == (0,)
    found = supremum(p, open_at_zero=True)
    assert found.attained
    assert found.lower < 1 < found.upper
    assert abs(found.point[0] ** 2 - F(1, 2)) < F(1, 10**10)
    check(found, lambda point: at(p, point[0]), [(F(i, 64),) for i in range(1, 65)])


@given(univariate, st.lists(st.fractions(0, 2, max_denominator=5), min_size=1, max_size=3))
def test_a_ratio_stays_below_on_a_grid(num, den):
    den = [den[0] + F(1, 7), *den[1:]]
    found = supremum_ratio(num, den, digits=12)
    check(found, lambda point: at(num, point[0]) / at(den, point[0]), [(F(i, 32),) for i in range(33)], digits=12)


def test_a_ratio_with_a_common_factor_is_that_without():
    num, den = [0, 1, F(-5, 2), 1], [0, 2, 1]
    assert supremum_ratio(num, den, digits=20).upper == supremum_ratio(num[1:], den[1:], digits=20).upper
    assert supremum_ratio(num, num[:2]).upper == supremum(num[1:]).upper
    assert supremum_ratio([], [0, 1]).upper == 0
    assert supremum_ratio(kirk_arvo(5), [0, 1], absolute=False).lower < supremum_ratio(kirk_arvo(5), [0, 1]).lower


# -- below -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("coefficients", "value"),
    [
        ([0, 1, -1], F(1, 4)),
        ([0, 0, 1, -1], F(4, 27)),
        ([1, -8, 8], F(1)),
        ([0, 0, 4, 0, -4], F(1)),
        ([0, 0, -4, 0, 4], F(1)),
        ([F(1, 3)], F(1, 3)),
        ([], F(0)),
    ],
)
def test_touching_the_tolerance_is_below_it(coefficients, value):
    assert below(coefficients, value)
    assert not below(coefficients, value - F(1, 10**40))
    assert below(coefficients, value + F(1, 10**40))


@given(univariate, rationals)
def test_below_agrees_with_the_supremum(p, tolerance):
    found = supremum(p)
    if tolerance < found.lower:
        assert not below(p, tolerance)
        assert not below(p, tolerance, near=found.point[0])
    if tolerance >= found.upper:
        assert below(p, tolerance, near=F(1, 3))


def test_below_draws_the_line_where_the_enclosure_does():
    for n in range(2, 9):
        found = supremum(kirk_arvo(n))
        assert below(kirk_arvo(n), found.upper)
        assert not below(kirk_arvo(n), found.lower)


# -- several variables -------------------------------------------------------------------------------


@pytest.mark.parametrize("k", [2, 3, 4, 5])
def test_the_product_of_all_weights(k):
    found = supremum_simplex({(1,) * k: F(1)}, k)
    assert found == Extremum(F(1, k**k), F(1, k**k), True, (F(1, k),) * k, 1)


@pytest.mark.parametrize("k", [1, 3, 4])
@pytest.mark.parametrize("value", [F(0), F(-2, 3), F(5)])
def test_a_constant_is_its_supremum(k, value):
    found = supremum_simplex({(0,) * k: value}, k)
    assert (found.lower, found.upper, found.complete) == (abs(value), abs(value), True)
    assert found.value_sign == (value > 0) - (value < 0)
    assert supremum_simplex({}, k).upper == 0


@pytest.mark.parametrize(("k", "degree", "size"), [(3, 3, 40), (3, 9, 30), (4, 5, 14), (5, 4, 9)])
@pytest.mark.parametrize("seed", range(3))
def test_a_dense_grid_of_the_simplex_stays_below(k, degree, size, seed):
    terms = random_form(k, degree, seed)
    found = supremum_simplex(terms, k)
    assert found.complete
    check(found, lambda point: at_point(terms, point), simplex_grid(k, size))


@given(st.dictionaries(st.tuples(*[st.integers(0, 2)] * 3), rationals, max_size=5), st.booleans())
def test_any_small_polynomial_stays_below_on_a_grid(terms, absolute):
    found = supremum_simplex(terms, 3, digits=12, budget=100_000, absolute=absolute)
    size = abs if absolute else lambda x: x
    assert found.lower <= size(at_point(terms, found.point)) <= found.upper
    assert max(size(at_point(terms, point)) for point in simplex_grid(3, 12)) <= found.upper
    assert not found.complete or found.upper - found.lower <= F(1, 10**12) * max(1, found.upper)


@pytest.mark.parametrize("k", [2, 3, 4])
@pytest.mark.parametrize("p", [kirk_arvo(2), kirk_arvo(5), [0, 1, -1], [0, 0, 1, -1], [0, F(1, 2), 0, -1]])
def test_a_lifted_polynomial_has_the_supremum_of_the_unlifted(k, p):
    flat, found = supremum(p), supremum_simplex(lifted(p, k), k)
    assert found.complete
    assert max(flat.lower, found.lower) <= min(flat.upper, found.upper)
    assert sum(found.point) == 1
    assert min(found.point) >= 0
    check(found, lambda point: at_point(lifted(p, k), point), [])


@pytest.mark.parametrize("k", [3, 4])
def test_of_tied_points_the_first_is_named(k):
    terms = {tuple((2, 1)[(i, j).index(m)] if m in (i, j) else 0 for m in range(k)): F(1) for i, j in pairs(k)}
    found = supremum_simplex(terms, k)
    assert found.complete
    assert list(found.point) == sorted(found.point)
    check(found, lambda point: at_point(terms, point), simplex_grid(k, 12))


def pairs(k):
    return [(i, j) for i in range(k) for j in range(k) if i != j]


def test_mirrored_maxima_on_edges():
    terms = {(4, 1, 0): F(1), (1, 4, 0): F(-1), (0, 2, 3): F(1, 50)}
    found, flat = supremum_simplex(terms, 3), supremum(kirk_arvo(4))
    assert max(flat.lower, found.lower) <= min(flat.upper, found.upper)
    assert found.point[0] < F(1, 2)
    assert found.value_sign == -1


@pytest.mark.parametrize(
    "terms",
    [
        {(0, 0, 0): F(1), (2, 0, 0): F(-1), (0, 2, 0): F(-1), (0, 1, 0): F(2, 3)},
        {(0, 0, 0): F(1), (3, 0, 0): F(-1), (1, 1, 0): F(-1), (0, 2, 0): F(-1), (0, 1, 0): F(2, 3)},
    ],
)
def test_a_face_that_the_slope_does_not_push_onto(terms):
    found = supremum_simplex(terms, 3)
    assert found.lower == found.upper == F(10, 9)
    assert found.point == (0, F(1, 3), F(2, 3))


def test_a_hundred_digits():
    terms = random_form(3, 5, seed=3)
    found, short = supremum_simplex(terms, 3, digits=100), supremum_simplex(terms, 3, digits=10)
    assert short.lower <= found.lower <= found.upper <= short.upper
    check(found, lambda point: at_point(terms, point), [], digits=100)


def test_what_floats_cannot_separate_is_enclosed_but_incomplete():
    third = F(1, 3)
    terms = Counter({(0, 0, 0): F(1)})
    for i in range(2):
        for j in range(5):
            terms[tuple(j if m == i else 0 for m in range(3))] -= comb(4, j) * (-third) ** (4 - j)
    found = supremum_simplex(terms, 3, budget=200_000)
    assert not found.complete
    assert found.lower <= 1 <= found.upper < 1 + F(1, 10**4)


def test_no_budget_still_gives_bounds():
    terms = random_form(3, 6, seed=5)
    wide, narrow = supremum_simplex(terms, 3, budget=0), supremum_simplex(terms, 3)
    assert not wide.complete
    assert wide.lower <= narrow.upper
    assert narrow.lower <= wide.upper
    assert wide.lower <= abs(at_point(terms, wide.point)) <= wide.upper


def test_the_signed_supremum_over_the_simplex():
    found = supremum_simplex({(1, 1, 0): F(1), (0, 0, 0): F(-1)}, 3, absolute=False)
    assert (found.lower, found.upper, found.value_sign) == (F(-3, 4), F(-3, 4), -1)
    assert found.point == (F(1, 2), F(1, 2), 0)


@given(st.lists(st.lists(st.integers(-3, 3), min_size=3, max_size=3), min_size=3, max_size=3))
def test_the_elimination_knows_a_semidefinite_matrix(rows):
    matrix = [[F(rows[i][j] + rows[j][i]) for j in range(3)] for i in range(3)]

    def minor(kept):
        part = [[-matrix[i][j] for j in kept] for i in kept]
        return mpmath.matrix([[int(x) for x in row] for row in part])

    minors = [[i for i in range(3) if mask >> i & 1] for mask in range(1, 8)]
    expected = all(round(float(mpmath.det(minor(kept)))) >= 0 for kept in minors)
    assert _negative_semidefinite(matrix) == expected


# -- manners -----------------------------------------------------------------------------------------


def test_the_precision_is_left_as_it_was():
    before, ctx.prec = ctx.prec, 71
    try:
        supremum(kirk_arvo(6))
        below(kirk_arvo(6), F(1, 20))
        supremum_simplex({(2, 1, 0): F(1)}, 3)
        assert ctx.prec == 71
    finally:
        ctx.prec = before


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: supremum([HALF]), InputTypeError, "coefficients: 0.5 isn't rational"),
        (lambda: supremum([1], digits=0), InputError, "digits: 0"),
        (lambda: supremum_ratio([1], []), InputError, "den: []"),
        (lambda: supremum_ratio([1], [1, -1]), InputError, "den: [1, -1] isn't positive"),
        (lambda: supremum_ratio([1], [F(1, 4), -1, 1]), InputError, "den: [1/4, -1, 1] isn't positive"),
        (lambda: supremum_ratio([1], [1, 0, -4, 0, 4]), InputError, "isn't positive"),
        (lambda: supremum_ratio([1], [0, 1]), InputError, "num: [1] has fewer factors w than den"),
        (lambda: supremum_simplex({(1, 0): F(1)}, 3), InputError, "terms: (1, 0) isn't an exponent for k = 3"),
        (lambda: supremum_simplex({(1, -1): F(1)}, 2), InputError, "terms: (1, -1)"),
        (lambda: supremum_simplex({(1, 1): HALF}, 2), InputTypeError, "terms: 0.5"),
        (lambda: below([1], HALF), InputTypeError, "tolerance: 0.5"),
        (lambda: below([1], F(1), near=F(2)), InputError, "near: 2 is outside"),
    ],
)
def test_what_cannot_be_meant_is_refused(call, error, message):
    with pytest.raises(error) as refused:
        call()
    assert message in str(refused.value)
