"""Speed against accuracy: the engine's exact and float bias beside the naive formulas."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from types import MappingProxyType
from typing import Any

import mpmath
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.special import gammaln

from truemean.conformance.report.charts import MARKERS, SERIES, panels, styled
from truemean.conformance.report.document import Cell, Chart, Section, Table
from truemean.conformance.report.wording import decimal
from truemean.oracle import Pixel, derive
from truemean.oracle.plans import catalogue

__all__ = ["METHODS", "digits", "section", "speed_accuracy"]

Floats = NDArray[np.float64]
DOUBLE = 16  # digits that a float64 can hold
REPEATS = 5
PIXELS = ("1/3", "1/64")
LEAD = (
    "The bias of Fig. 1 computed in six ways, for n from 4 to 4,096. A bias taken as E[ξ] − I in floating point "
    "loses its digits as n grows, because the bias becomes small beside I; the engine centres the pixel at I and "
    "never forms that difference."
)


def by_eq_2(values: Floats, weights: Floats, n: int) -> float:
    """E[ξ] by Eqs. 2, 4 and 5, less I."""
    mean = float(weights @ values)
    easy = float((weights**n).sum())
    given_easy = float((weights**n @ values) / np.float64(easy))
    return given_easy * easy + mean * (1 - easy) - mean


def by_eq_6(values: Floats, weights: Floats, n: int) -> float:
    """E[ξ] by Eq. 6, less I."""
    mean = float(weights @ values)
    return float(mean + weights**n @ (values - mean)) - mean


def by_factorials(values: Floats, weights: Floats, n: int) -> float:
    """Fig. 1 stepped through all k-tuples of a two-valued pixel, Eq. 3 with float factorials, less I."""
    factorial = np.append(1.0, np.cumprod(np.arange(1.0, n + 1)))
    second = np.arange(n + 1)
    first = n - second
    chances = weights[0] ** first * weights[1] ** second / (factorial[first] * factorial[second]) * factorial[n]
    return _stepped(values, weights, chances)


def by_lgamma(values: Floats, weights: Floats, n: int) -> float:
    """The same with the logarithms of the factorials."""
    second = np.arange(n + 1)
    first = n - second
    logarithms = gammaln(n + 1) - gammaln(first + 1) - gammaln(second + 1)
    chances = np.exp(logarithms + first * np.log(weights[0]) + second * np.log(weights[1]))
    return _stepped(values, weights, chances)


def _stepped(values: Floats, weights: Floats, chances: Floats) -> float:
    """The estimates of Fig. 1 weighted by the chances of their k-tuples, less I."""
    mean = float(weights @ values)
    estimates = np.full(len(chances), mean)
    estimates[0], estimates[-1] = values
    return float(chances @ estimates) - mean


NAIVE: Mapping[str, Callable[[Floats, Floats, int], float]] = MappingProxyType(
    {
        "naive: Eq. 2, 4, 5 − I": by_eq_2,
        "naive: Eq. 6 − I": by_eq_6,
        "naive: Eq. 3, factorials − I": by_factorials,
        "naive: Eq. 3, lgamma − I": by_lgamma,
    }
)
METHODS = ("engine: exact", "engine: float64", *NAIVE)
FAILURES = (
    ("1/3", 64, "naive: Eq. 6 − I", "cancellation: the bias is lost in the digits of I"),
    ("1/3", 128, "naive: Eq. 6 − I", "cancellation: no digit is left"),
    ("499999999999/1000000000000", 8, "naive: Eq. 6 − I", "two large terms of opposite sign"),
    ("86/171", 171, "naive: Eq. 3, factorials − I", "171! is no float64"),
    ("501/1000", 1100, "naive: Eq. 2, 4, 5 − I", "Prob[easy] underflows: 0/0"),
    ("1/64", 1024, "naive: Eq. 3, lgamma − I", "errors of large logarithms, then cancellation"),
)


@dataclass(frozen=True, slots=True)
class Timed:
    """One method at one n: the bias it gives, its correct digits (infinite for exact), and seconds."""

    method: str
    n: int
    value: Any
    digits: float
    seconds: float


def digits(value: float, truth: Fraction) -> float:
    """How many leading digits of ``value`` are correct, from 0 to 16.

    >>> digits(0.1251, Fraction(1, 8)), digits(float("nan"), Fraction(1, 8))
    (3.1, 0.0)
    """
    if not math.isfinite(value):
        return 0.0
    error = abs(Fraction(value) - truth) / abs(truth)
    if not error:
        return float(DOUBLE)
    right = math.log10(error.denominator) - math.log10(error.numerator)
    return round(min(max(right, 0.0), DOUBLE), 1)


def exact_bias(pixel: Pixel, n: int) -> Fraction:
    """The exact bias of Fig. 1."""
    bias: Fraction = derive(catalogue["kirk-arvo"], pixel, n=n).bias
    return bias


def float_bias(pixel: Pixel, n: int) -> Any:
    """The bias in float64 with its error bound."""
    return derive(catalogue["kirk-arvo"], pixel, n=n, arithmetic="float64").bias


@cache
def measured(weight: str, most: int) -> tuple[Timed, ...]:
    """Every method at n = 4, 8, ..., ``most`` on the pixel with ``weight`` of 1."""
    pixel = Pixel.two(weight)
    return tuple(timed for power in range(2, most.bit_length()) for timed in _at(pixel, 2**power))


def _at(pixel: Pixel, n: int) -> list[Timed]:
    truth, seconds = _fastest(exact_bias, pixel, n)
    found = [Timed("engine: exact", n, truth, math.inf, seconds)]
    approx, seconds = _fastest(float_bias, pixel, n)
    found.append(Timed("engine: float64", n, approx.value, digits(approx.value, truth), seconds))
    arrays = pixel.arrays()
    with np.errstate(all="ignore"):  # whatever comes of it
        for method, formula in NAIVE.items():
            value, seconds = _fastest(formula, *arrays, n)
            found.append(Timed(method, n, value, digits(value, truth), seconds))
    return found


def _fastest(work: Callable[..., Any], *arguments: Any) -> tuple[Any, float]:
    """The result, and the least time of a few runs: what other programs did meanwhile is not ours."""
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        result = work(*arguments)
        times.append(time.perf_counter() - start)
    return result, min(times)


@styled
def speed_accuracy(most: int = 4096) -> Figure:
    """Correct digits of the bias over n, and over the time they took."""
    figure, axes = panels(10, 6.6, 2, 2, sharey=True)
    for row, weight in enumerate(PIXELS):
        over_n, over_time = axes[2 * row : 2 * row + 2]
        for method, colour, marker in zip(METHODS, SERIES, MARKERS, strict=False):
            points = [timed for timed in measured(weight, most) if timed.method == method]
            line: dict[str, Any] = {"color": colour, "marker": marker, "label": method, "clip_on": False}
            height = [min(point.digits, DOUBLE + 3) for point in points]
            over_n.plot([point.n for point in points], height, **line)
            over_time.plot([point.seconds for point in points], height, **{**line, "linewidth": 0.7})
        over_n.set(xlabel="size n of the pilot", ylabel="correct digits of the bias", title=f"white on {weight}")
        over_n.set_xscale("log", base=2)
        over_n.set_xticks([4, 16, 64, 256, 1024, 4096], ["4", "16", "64", "256", "1024", "4096"])
        over_time.set(xlabel="time", xscale="log", title="the same over time", xlim=(1e-6, 1e-2))
        over_time.set_xticks([1e-6, 1e-5, 1e-4, 1e-3, 1e-2], ["1 µs", "10 µs", "100 µs", "1 ms", "10 ms"])
        over_time.minorticks_off()
        _digit_ticks(over_n)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def _digit_ticks(panel: Axes) -> None:
    panel.set_ylim(0, DOUBLE + 3.5)
    panel.set_yticks([0, 4, 8, 12, DOUBLE, DOUBLE + 3], ["0", "4", "8", "12", f"{DOUBLE}", "all"])


def section(most: int = 4096) -> Section:
    """The chart, and where the naive formulas fail."""
    slowest = max(t.seconds for weight in PIXELS for t in measured(weight, most) if t.method == "engine: exact")
    lost = " or ".join(f"{lost_by(weight, most):,}" for weight in PIXELS)
    kept = min(t.digits for w in PIXELS for t in measured(w, most) if t.method == "engine: float64" and t.value)
    return Section(
        "speed",
        "How fast, and how right, is the engine?",
        (
            LEAD,
            Chart(
                "speed-accuracy",
                "Speed against accuracy",
                f"The naive formulas are fast and have no digit left by n = {lost}, the exact engine keeps all of them at "
                f"any n within {1e3 * slowest:.1f} ms; its float64 mode keeps at least {kept:.0f} until the bias itself is "
                f"smaller than any float64, and its error bound says so.",
                speed_accuracy(most),
            ),
            _failures(),
        ),
        {"measured": {weight: [_json(timed) for timed in measured(weight, most)] for weight in PIXELS}},
    )


def lost_by(weight: str, most: int) -> int:
    """The smallest n from which no naive formula has a correct digit; ``most`` where some has one to the end."""
    right = [timed.n for timed in measured(weight, most) if timed.method in NAIVE and timed.digits >= 1]
    return min(2 * max(right, default=1), most)


def _failures() -> Table:
    rows = []
    for weight, n, method, why in FAILURES:
        truth, approx, naive = failure(weight, n, method)
        rows.append(
            (
                Cell(f"ω₂ = {_short(weight)}, n = {n}"),
                Cell(method.removeprefix("naive: "), (why,)),
                Cell(decimal(naive), (), "number"),
                Cell(_digits_in_words(digits(naive, truth)), (), "number"),
                Cell(_tiny(truth), (), "number"),
                Cell(decimal(approx.value), (f"± {decimal(approx.error)}",), "number"),
            )
        )
    head = (
        "pixel and pilot",
        "naive formula, and why it fails",
        "its bias",
        "correct digits",
        "exact bias",
        "engine, float64",
    )
    return Table("naive-failures", "Where the naive formulas fail, with the exact bias beside.", head, tuple(rows))


def failure(weight: str, n: int, method: str) -> tuple[Fraction, Any, float]:
    """The exact bias, the engine's float64 one with its bound, and what a naive formula makes of it."""
    pixel = Pixel.two(weight)
    with np.errstate(all="ignore"):
        return exact_bias(pixel, n), float_bias(pixel, n), NAIVE[method](*pixel.arrays(), n)


def _short(weight: str) -> str:
    known = {"499999999999/1000000000000": "1/2 − 10⁻¹²"}
    return known.get(weight, weight)


def _digits_in_words(right: float) -> str:
    return "none" if right < 1 else f"{right:.0f}"


def _tiny(value: Fraction) -> str:
    """A number of any size with six digits."""
    quotient = mpmath.mpf(value.numerator) / value.denominator
    return str(mpmath.nstr(quotient, 6)).replace("-", "−")


def _json(timed: Timed) -> dict[str, Any]:
    value = _tiny(timed.value).replace("−", "-") if isinstance(timed.value, Fraction) else timed.value
    finite = value if isinstance(value, str) or math.isfinite(value) else str(value)
    right = "all" if math.isinf(timed.digits) else timed.digits
    return {"method": timed.method, "n": timed.n, "value": finite, "digits": right, "seconds": timed.seconds}
