"""What becomes of a bias as samples grow, held against the exact numbers at large n."""

from fractions import Fraction

import pytest
import sympy
from sympy import Symbol

from truemean.errors import InputError, NoClosedForm
from truemean.oracle import Pixel, derive
from truemean.oracle.plans import catalogue

n = Symbol("n")
FIG_1, POOLED = catalogue["kirk-arvo"], catalogue["two-stage-pooled"]
PIXELS = {
    "two": Pixel.two("1/4"),
    "three": Pixel({0: "1/2", 1: "1/3", 5: "1/6"}),
    "window": Pixel({0: "1/8", 1: "1/2", 2: "3/8"}),
}


def shrunk(X, n=4):
    return X.draw(n).sum() / (n + 1)


def halved(X, n=4):
    return X.draw(n).mean() / 2


def clipped(X, n=4, t=0):
    S = X.draw(n)
    return S.mean() if S.max() <= t else X.true_mean()


CASES = [
    (FIG_1, "two", {}),
    (FIG_1, "three", {}),
    (FIG_1, "window", {"eps": 1}),
    (POOLED, "two", {"m": 12}),
    (clipped, "window", {"t": 1}),
]


@pytest.mark.parametrize(("plan", "pixel", "params"), CASES)
def test_the_leading_term_leads(plan, pixel, params):
    """The exact bias over the leading term tends to 1, at the pace of the next largest W."""
    found = derive(plan, PIXELS[pixel], n=n, **params).rates()
    assert found.limit == 0
    assert found.consistent
    (symbol,) = found.leading.free_symbols
    distances = []
    for size in (40, 80):
        exact = derive(plan, PIXELS[pixel], n=size, **params).bias
        leading = found.leading.subs(symbol, size)
        distances.append(abs(Fraction(exact) / Fraction(int(leading.p), int(leading.q)) - 1))
    assert distances[1] < Fraction(2, 5)
    assert distances[1] <= distances[0] * Fraction(9, 10) or distances[1] == 0


def test_the_rate_is_the_largest_weight_that_misses_a_value():
    assert derive(FIG_1, PIXELS["two"], n=n).rates().rate == sympy.Rational(3, 4)
    assert derive(FIG_1, PIXELS["window"], n=n, eps=1).rates().rate == sympy.Rational(7, 8)


def test_powers_of_n_and_limits_that_are_not_zero():
    assert derive(shrunk, PIXELS["two"], n=n).rates().leading.subs(Symbol("n", integer=True, positive=True), 100) == (
        sympy.Rational(-1, 400)
    )
    constant = derive(halved, PIXELS["two"], n=n).rates()
    assert (constant.limit, constant.consistent) == (sympy.Rational(-1, 8), False)
    second = derive(POOLED, PIXELS["two"], n=2, m=Symbol("m")).rates("m")
    assert not second.consistent
    assert second.limit == sympy.Rational(1, 16) * sympy.Rational(3, 4) - sympy.Rational(9, 16) / 4


def test_with_open_weights_the_largest_decides():
    found = derive(FIG_1, Pixel.symbolic(2, values=(0, 1)), n=n).rates()
    w1, w2 = Pixel.symbolic(2).weights
    whole = Symbol("n", integer=True, positive=True)
    put = {w1: sympy.Rational(3, 4), w2: sympy.Rational(1, 4)}
    assert sympy.simplify(found.leading.subs(put) + sympy.Rational(1, 4) * sympy.Rational(3, 4) ** whole) == 0
    assert found.rate == sympy.Max(w1, w2)


def test_an_unbiased_family_has_nothing_that_leads():
    found = derive(catalogue["discard-pilot"], PIXELS["two"], p=n).rates()
    assert (found.limit, found.leading, found.consistent) == (0, 0, True)


def test_what_has_no_rate():
    with pytest.raises(InputError, match="no symbol for a sample size"):
        derive(FIG_1, PIXELS["two"], n=4).rates()
    with pytest.raises(InputError, match="there is n"):
        derive(FIG_1, PIXELS["two"], n=n).rates("m")
    with pytest.raises(NoClosedForm, match="variance"):
        derive(lambda X, n: X.draw(n).mean() if X.draw(n).variance() <= 1 else 0, PIXELS["two"], n=n)
