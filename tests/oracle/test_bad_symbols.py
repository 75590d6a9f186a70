"""Symbols that can't be meant: each error names the symbol and what to declare or to make concrete."""

import numpy as np
import pytest
from sympy import Symbol, sqrt

from truemean.errors import AssumptionError, InputError, NoClosedForm, PlanError
from truemean.oracle import Pixel, derive
from truemean.oracle.plans import catalogue

n, w, eps, k = Symbol("n"), Symbol("w"), Symbol("eps"), Symbol("k")
FIG_1 = catalogue["kirk-arvo"]
TWO = Pixel.two("1/4")


def by_variance(X, n=4, eps=1):
    S = X.draw(n)
    return S.mean() if S.variance() <= eps else X.true_mean()


def counted(X, n=4):
    return sum(X.draw(1).mean() for _ in range(n)) / n


def compared(X, n=4):
    return X.draw(n).mean() if n > 3 else X.true_mean()


def until(X, eps=1):
    return X.draw_until(lambda S: S.variance() <= eps, start=2, most=5).mean()


def sized(X, eps=1):
    S = X.draw(2)
    return X.draw(np.where(S.range() <= eps, 1, 3)).mean() * S.size


def divided(X, eps=1):
    S = X.draw(2)
    return S.mean() / np.where(S.range() <= eps, 1, 2)


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (
            lambda: derive(FIG_1, TWO, n=Symbol("n", negative=True)),
            AssumptionError,
            r"Symbol\('n', integer=True, positive",
        ),
        (lambda: derive(FIG_1, TWO, n=Symbol("n", integer=False)), AssumptionError, "symbol n is declared otherwise"),
        (lambda: derive(FIG_1, TWO, n=n / 2), NoClosedForm, "n/2 is no integer combination"),
        (
            lambda: derive(FIG_1, TWO, n=4, eps=Symbol("eps", imaginary=True)),
            AssumptionError,
            r"eps is not real.*real=True",
        ),
        (
            lambda: derive(FIG_1, TWO, n=4, eps=Symbol("eps") + Symbol("eps", positive=True)),
            AssumptionError,
            "called eps",
        ),
        (lambda: derive(FIG_1, Pixel.symbolic(7), n=4, eps=1), AssumptionError, "ordered=True"),
        (
            lambda: derive(by_variance, TWO, n=n).bias,
            NoClosedForm,
            r"variance\(S1\) <= 1: level moments .* make n concrete",
        ),
        (lambda: derive(counted, TWO, n=n), PlanError, r"has a symbol \(n=n\).*range\(n\)"),
        (lambda: derive(compared, TWO, n=n), PlanError, r"has a symbol \(n=n\)"),
        (lambda: derive(until, TWO, eps=eps).bias, NoClosedForm, "which a symbol decides"),
        (lambda: derive(sized, TWO, eps=eps).variance, NoClosedForm, "write the comparison as an if"),
        (lambda: derive(divided, TWO, eps=eps).bias, NoClosedForm, "write the comparison as an if"),
        (
            lambda: derive(FIG_1, Pixel.symbolic(k), n=n, eps=1),
            NoClosedForm,
            "with an open number of values.*make k concrete",
        ),
        (lambda: derive(FIG_1, Pixel.symbolic(k), n=n).distribution(), NoClosedForm, "make k concrete"),
        (lambda: derive(FIG_1, TWO, n=n, arithmetic="exact"), InputError, "n are symbols.*arithmetic='symbolic'"),
        (lambda: derive(FIG_1, TWO, n=n, arithmetic="float64"), InputError, "n are symbols"),
        (lambda: derive(FIG_1, TWO, n=n, rows="sampled"), InputError, "n are symbols"),
        (lambda: derive(FIG_1, TWO, n=n - n - 1), InputError, "n=-1"),
        (lambda: derive(lambda X, n: X.from_({1: 1}).draw(n).mean(), Pixel({w: 1}), n=2), NoClosedForm, "proposal"),
        (
            lambda: derive(catalogue["kirk-arvo-unbiased"], TWO, area=Symbol("a", negative=True)),
            AssumptionError,
            "area=a",
        ),
        (lambda: derive(FIG_1, TWO, n=4, digits=9), InputError, "digits=9"),
        (lambda: derive(FIG_1, TWO, n=4, arithmetic="ball", digits=0), InputError, "digits=0"),
    ],
    ids=range(22),
)
def test_a_derivation_with_the_wrong_symbols(call, error, words):
    with pytest.raises(error, match=words):
        call()


@pytest.mark.parametrize(
    ("make", "error", "words"),
    [
        (lambda: Pixel({0: w, 1: w}), AssumptionError, "sum to 2[*]w, not to 1"),
        (lambda: Pixel({0: Symbol("a"), 1: Symbol("b")}), AssumptionError, "1 minus the others"),
        (
            lambda: Pixel({0: 1 - w, 1: Symbol("w", negative=True)}),
            AssumptionError,
            "w can't be a coverage.*positive=True",
        ),
        (lambda: Pixel.symbolic(3, weights=("3/4", "1/2", w)), AssumptionError, "leave -1/4 for w"),
        (lambda: Pixel.symbolic(2, weights=("1/2", "1/4")), InputError, "sum to 3/4"),
        (lambda: Pixel.symbolic(2, values=(1, 1)), InputError, "not distinct"),
        (lambda: Pixel.symbolic(2, values=(1, 2, 3)), InputError, "are 3, but k=2"),
        (lambda: Pixel.symbolic(0), InputError, "k=0"),
        (lambda: Pixel.symbolic(Symbol("k", negative=True)), AssumptionError, "k=k"),
        (lambda: Pixel({Symbol("v", imaginary=True): 1}), AssumptionError, "value=v is not a real"),
        (lambda: Pixel.symbolic(2).arrays(), InputError, "substitute I1, I2, omega1, omega2"),
        (lambda: Pixel.from_regions({"R": (w, TWO), "rest": (w, TWO)}), InputError, "sum to 2[*]w"),
    ],
)
def test_a_pixel_of_the_wrong_symbols(make, error, words):
    with pytest.raises(error, match=words):
        make()


@pytest.mark.parametrize("assumption", [{}, {"integer": True}, {"positive": True}, {"real": True}])
def test_a_size_may_be_declared_as_far_as_it_is_and_used_twice(assumption):
    size = Symbol("n", **assumption)
    found = derive(catalogue["discard-pilot"], TWO, p=size, n1=size, n2=2 * size)
    assert found.cost.free_symbols == {Symbol("n", integer=True, positive=True)}


def test_a_contradiction_is_not_kept_for_the_next_derivation():
    with pytest.raises(AssumptionError):
        derive(FIG_1, TWO, n=Symbol("n", negative=True))
    assert derive(FIG_1, TWO, n=n).cost == Symbol("n", integer=True, positive=True)


def test_a_sum_of_too_many_cases_names_the_symbols():
    many = Pixel({i * i: "1/8" for i in range(8)})
    with pytest.raises(NoClosedForm, match="comparisons are decided by symbols: make some of eps numbers"):
        derive(by_variance, many, n=6, eps=eps)


def test_an_irrational_number_is_a_symbol_too():
    X = Pixel({0: "1/2", sqrt(Symbol("s", positive=True)): "1/2"})
    assert derive(FIG_1, X, n=2).bias == 0
