"""Formulas beside other systems: ``pytest tests/benchmarks/test_formulas.py``; T5 of the survey of engines.

The bias of Fig. 1 with symbolic weights, values 0, 1, 4, 9: ours, Storm's parametric engine and
lea's symbolic probabilities, the answers compared at a rational point. Then what nobody else
does: Eq. 6 for symbolic n, and the worst pixel.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import pytest
import sympy
from tests.benchmarks import peers

from truemean.oracle import Pixel, derive, prove, worst_case
from truemean.oracle.plans import catalogue

FIG_1 = catalogue["kirk-arvo"]


def ours(k: int, n: int) -> peers.Bias:
    """To the polynomial, as Storm does; written out by SymPy only for the comparison."""
    X = Pixel.symbolic(k, values=[i * i for i in range(k)])
    return lambda: derive(FIG_1, X, n=n).biases[0]


def by_variance(X: Any, n: Any, eps: Any) -> Any:
    """Fig. 1 with the sample variance as variation: counts, hence many terms."""
    S = X.draw(n)
    return S.mean() if S.variance() <= eps else X.true_mean()


def at_a_point(bias: Any, k: int) -> Any:
    """The number at omega_i = i / (k (k + 1) / 2), whatever the weights are called."""
    numbers = [sympy.Rational(2 * (i + 1), k * (k + 1)) for i in range(k)]
    # lea calls the last weight by the text of its formula, as one symbol.
    formula = bias.expression() if hasattr(bias, "expression") else sympy.sympify(str(bias))
    named = {f"{letter}{i + 1}": x for letter in ("omega", "w") for i, x in enumerate(numbers)}
    return formula.subs({s: named[str(s)] for s in formula.free_symbols})


SYSTEMS = {"ours": ours, "storm": peers.storm, "lea": peers.lea}
CASES = [
    (name, k, n) for k, n in ((2, 8), (2, 32), (3, 8), (3, 32), (4, 16)) for name in SYSTEMS if name != "lea" or k == 2
]


@pytest.mark.parametrize(("name", "k", "n"), CASES, ids=[f"{k}-{n}-{name}" for name, k, n in CASES])
def test_symbolic_weights(benchmark, name, k, n):
    benchmark.group = f"T5 k={k} n={n}"
    X = Pixel({i * i: Fraction(2 * (i + 1), k * (k + 1)) for i in range(k)})
    bias = benchmark(SYSTEMS[name](k, n))
    exact = derive(FIG_1, X, n=n).bias
    assert at_a_point(bias, k) == sympy.Rational(exact.numerator, exact.denominator)


@pytest.mark.parametrize("n", [16, 32])
def test_many_terms(benchmark, n):
    benchmark.group = f"variance rule, symbolic weights, k=4 n={n}"
    X = Pixel.symbolic(4, values=(0, 1, 4, 9))
    assert benchmark(lambda: derive(by_variance, X, n=n, eps=3).biases[0])


def test_equation_6(benchmark):
    benchmark.group = "Eq. 6, symbolic n, k=3"
    assert benchmark(lambda: derive(FIG_1, Pixel.symbolic(3), n=sympy.Symbol("n")).bias).free_symbols


@pytest.mark.parametrize("n", [8, 64])
def test_the_worst_pixel(benchmark, n):
    benchmark.group = f"worst case of Fig. 1 to 30 digits, n={n}"
    assert benchmark(lambda: worst_case(FIG_1, n=n, digits=30)).complete


def test_a_proof_by_structure(benchmark):
    benchmark.group = "proof of Fig. 2"
    assert benchmark(lambda: prove(catalogue["kirk-arvo-unbiased"])).status == "unbiased"
