"""Formulas as functions, pictures, tables and typeset mathematics."""

import subprocess
import sys
from fractions import Fraction

import matplotlib as mpl
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sympy import Poly, Symbol, simplify

from truemean.errors import InputError
from truemean.oracle import Pixel, compare, derive
from truemean.oracle.plans import catalogue

n, eps, w = Symbol("n"), Symbol("eps"), Symbol("w")
FIG_1, POOLED = catalogue["kirk-arvo"], catalogue["two-stage-pooled"]
OPEN = Pixel.symbolic(2, values=(0, 1))


@pytest.fixture(autouse=True)
def no_window():
    mpl.use("agg")
    yield
    import matplotlib.pyplot as plt

    plt.close("all")


# -- NumPy functions ----------------------------------------------------------------------------------


@settings(max_examples=25)
@given(st.integers(1, 40), st.floats(2**-40, 1 - 2**-40))
def test_a_function_is_as_exact_as_its_input(size, weight):
    """With both weights given the relative error is a few units, however small the bias is."""
    function = derive(FIG_1, OPEN, n=n).lambdify(*OPEN.weights, n)
    rest = 1 - weight  # exact for numbers above 2^-53
    exact = derive(FIG_1, Pixel({0: Fraction(weight), 1: 1 - Fraction(weight)}), n=size).bias
    terms = Fraction(weight) ** size + (1 - Fraction(weight)) ** size
    assert abs(Fraction(float(function(weight, rest, size))) - exact) <= 2e-14 * float(terms)


def test_a_function_keeps_the_digits_that_the_polynomial_loses():
    """The polynomial in one weight has large coefficients of both signs: at 7/8 it loses half its digits."""
    params = {"start": 4, "most": 32, "eps": "1/10"}
    d = derive(catalogue["sequential"], OPEN, **params)
    w1, w2 = OPEN.weights
    coefficients = Poly(d.bias.subs(w1, 1 - w2), w2).all_coeffs()
    exact = float(derive(catalogue["sequential"], Pixel.two("7/8"), **params).bias)
    assert abs(np.polyval([float(c) for c in coefficients], 0.875) / exact - 1) > 1e-9
    assert abs(float(d.lambdify()(0.125)) / exact - 1) < 1e-14


def test_arrays_are_broadcast_and_symbols_may_be_named():
    function = derive(FIG_1, OPEN, n=n).lambdify("n", "omega1")
    table = function(np.arange(1, 6)[:, None], np.array([0.25, 0.5, 0.875]))
    exact = [
        [float(derive(FIG_1, Pixel.two(1 - Fraction(x)), n=i).bias) for x in (0.25, 0.5, 0.875)] for i in range(1, 6)
    ]
    np.testing.assert_allclose(table, exact, atol=1e-16)
    assert function(4, 0.25).shape == ()


@pytest.mark.parametrize("result", ["bias", "expectation", "relative_bias", "variance", "mse", "cost", "oracle_calls"])
def test_every_result_is_a_function(result):
    X = Pixel({0: 1 - w, 1: w})
    function = derive(FIG_1, X, n=n, eps=eps).lambdify(w, n, eps, result=result)
    exact = getattr(derive(FIG_1, Pixel.two("1/8"), n=3, eps="1/2"), result)
    assert float(function(0.125, 3, 0.5)) == pytest.approx(float(exact), rel=1e-14)


def test_values_and_thresholds_are_decided_exactly():
    function = derive(FIG_1, Pixel.symbolic(2), n=n, eps=eps).lambdify("omega1", "I1", "I2", "n", "eps")
    assert function(0.25, 0, 1, 4, [0.0, 1.0, np.nextafter(1, 0)]).tolist() == pytest.approx(
        [0.076171875, 0, 0.076171875]
    )


@pytest.mark.parametrize(
    ("symbols", "words"),
    [(("n",), "are not the symbols"), (("omega1", "n", "x"), "are not the symbols"), (("n", "n", "omega1"), "are not")],
)
def test_wrong_symbols_are_named(symbols, words):
    with pytest.raises(InputError, match=words):
        derive(FIG_1, OPEN, n=n).lambdify(*symbols)


def test_other_wrong_uses():
    d = derive(FIG_1, OPEN, n=n)
    with pytest.raises(InputError, match="result='law'"):
        d.lambdify(result="law")
    with pytest.raises(InputError, match="one for each of"):
        d.lambdify()(0.5)
    with pytest.raises(InputError, match="coincide"):
        derive(FIG_1, Pixel.symbolic(2), n=2).lambdify()(0.5, 1.0, 1.0)
    with pytest.raises(InputError, match=r"use .lambdify"):
        d.at([[0.5], [0.5]])


# -- pictures -----------------------------------------------------------------------------------------


def test_the_bias_over_n_is_figure_3():
    axes = derive(FIG_1, OPEN, n=n).plot()
    assert len(axes.lines) == 7 + 1
    x, y = axes.lines[0].get_data()
    assert (axes.get_xlabel(), list(x[:3])) == ("n", [1, 2, 3])
    assert y[3] == pytest.approx(float(derive(FIG_1, Pixel.two("7/8"), n=4).bias))


def test_other_plots():
    over_weight = derive(FIG_1, OPEN, n=n).plot("omega1", n=[2, 3])
    assert [line.get_label() for line in over_weight.lines[:2]] == ["n=2", "n=3"]
    one = derive(FIG_1, Pixel({0: 1 - w, 1: w}), n=4).plot(result="variance")
    assert one.get_ylabel() == "variance"
    threshold = derive(FIG_1, Pixel.two("1/4"), n=4, eps=eps).plot("eps", between=(0, 2))
    assert set(threshold.lines[0].get_ydata()) == {
        0.0,
        derive(FIG_1, Pixel.two("1/4"), n=4).at([[0.75], [0.25]]).bias[0],
    }


def test_what_can_not_be_plotted():
    with pytest.raises(InputError, match="no symbol to plot over"):
        derive(FIG_1, Pixel.two("1/4"), n=4).plot()
    with pytest.raises(InputError, match="x is no symbol"):
        derive(FIG_1, OPEN, n=n).plot("x")
    with pytest.raises(InputError, match="give between"):
        derive(FIG_1, Pixel.two("1/4"), n=4, eps=eps).plot()
    with pytest.raises(InputError, match="eps has no usual value"):
        derive(FIG_1, Pixel.two("1/4"), n=n, eps=eps).plot()
    with pytest.raises(InputError, match="too many to read"):
        derive(FIG_1, OPEN, n=n).plot("omega1", n=range(1, 20))


# -- words --------------------------------------------------------------------------------------------


def test_latex_is_equation_6_with_the_true_mean_explained():
    text = derive(FIG_1, Pixel.symbolic(2), n=n).latex()
    assert r"\omega_{1}^{n} \left(- I + I_{1}\right)" in text
    assert r"I = I_{1} \omega_{1} + I_{2} \omega_{2}" in text
    assert r"\omega_{1} + \omega_{2} = 1" in text
    assert derive(FIG_1, Pixel.two("1/8"), n=4).latex() == r"\mathrm{E}[\xi] - I = - \frac{1197}{16384}"
    with pytest.raises(InputError, match="law"):
        derive(FIG_1, OPEN, n=n).latex("law")


@pytest.mark.parametrize(
    "d",
    [
        derive(FIG_1, Pixel.symbolic(2), n=n),
        derive(FIG_1, Pixel.two("1/8"), n=4),
        derive(FIG_1, Pixel.two("1/8"), n=4, arithmetic="float64"),
        derive(FIG_1, Pixel.two("1/3"), n=4, arithmetic="ball", digits=12),
        derive(FIG_1, Pixel({(1, 0): "1/2", (0, 1): "1/2"}), n=4),
        derive(FIG_1, Pixel.symbolic(Symbol("k")), n=n),
        derive(FIG_1, Pixel({0: 1}), n=4),
    ],
    ids=["symbolic", "exact", "float64", "ball", "colours", "k open", "true mean 0"],
)
def test_a_derivation_shows_itself(d):
    text, page = str(d), d._repr_html_()
    for words in ("E[ξ]", "bias", "variance", "cost", "range(S1) <= 0"):
        assert words in text
    assert page.count("<table>") == 2
    assert r"\mathrm{Var}[\xi]" in page
    assert max(map(len, text.splitlines())) <= 118 or "Pixel" in max(text.splitlines(), key=len)


def test_names_in_a_page_are_escaped():
    def plan(X, b="<b>"):
        return X.draw(1).mean()

    assert "<b>=" not in derive(plan, OPEN)._repr_html_()
    assert "b=&lt;b&gt;" in derive(plan, OPEN)._repr_html_()


def test_requirements_are_told():
    d = derive(lambda X, n: X.draw(n).mean() if X.draw(n).variance() <= 0 else X.true_mean(), OPEN, n=n)
    assert d.requirements == ["n >= 2"]
    assert "for n >= 2" in str(d)


def test_plans_side_by_side():
    both = compare(derive(FIG_1, OPEN, n=n), derive(POOLED, OPEN, n=n, m=4))
    assert simplify(both.difference() - (both.derivations[1].bias - both.derivations[0].bias)) == 0
    assert "two-stage-pooled(n=n, m=4, eps=0)" in str(both)
    assert both._repr_html_().count("<th ") == 3
    with pytest.raises(InputError, match="two or more"):
        compare(both.derivations[0])


# -- the prompt ---------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("without", ["", "import sys; sys.modules['IPython'] = None; "])
def test_the_prompt_knows_the_names(without, root):
    code = f"{without}from truemean.repl import interact; interact()"
    typed = 'print(derive(catalogue["kirk-arvo"], Pixel.two("1/8"), n=4).bias)\nprove(catalogue["fixed"]).status\n'
    environment = {"PYTHONPATH": str(root / "src"), "HOME": "/nonexistent", "PATH": "", "MPLBACKEND": "agg"}
    done = subprocess.run(
        [sys.executable, "-c", code], input=typed, capture_output=True, text=True, env=environment, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "-1197/16384" in done.stdout
    assert "'unbiased'" in done.stdout
