"""The worst pixel: how biased a plan can get whatever the coverages, with a certificate.

For fixed values the bias is a polynomial in the weights. On pixels of two values its critical
points are the real roots of an integer polynomial; beyond, a branch and bound over the simplex
encloses the supremum.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truemean.errors import InputError, UnknownName
from truemean.oracle.derivation import Derivation, derive
from truemean.oracle.enclosure import Enclosure
from truemean.oracle.exact import exact_number, is_symbolic
from truemean.oracle.extremum import Extremum, below, supremum, supremum_ratio, supremum_simplex
from truemean.oracle.pixel import Pixel
from truemean.oracle.plan import Plan, as_plan
from truemean.oracle.symbols import Ratio

__all__ = ["WorstCase", "smallest_n", "worst_case"]

OBJECTIVES = ("bias", "relative bias", "mse")


@dataclass(frozen=True, slots=True)
class WorstCase:
    """The answer of `worst_case`.

    ``value`` encloses the supremum of the objective's absolute value over all weights; ``attained``
    says whether some pixel has it or it is only a limit; ``pixel`` is rational and as bad within the
    enclosure, ``bias`` its signed bias. ``complete`` is false where the digits asked for were too
    many for the work allowed: the enclosure is then wider, and holds all the same.
    """

    objective: str
    value: Enclosure
    attained: bool
    pixel: Pixel
    bias: Fraction
    complete: bool
    plan: Plan = field(repr=False)
    params: dict[str, Any] = field(repr=False)

    def curve(self, points: int = 257) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The signed objective over the weight of the larger of two values: ``(weights, values)``."""
        if len(self.pixel.values) != 2:
            raise InputError(f"a curve is over one weight, but the pixel has {len(self.pixel.values)} values: use k=2")
        w = np.linspace(0, 1, points + 2)[1:-1]
        low, high = sorted(self.pixel.values)
        at = derive(self.plan, Pixel({low: "1/2", high: "1/2"}), **self.params).at(np.array([1 - w, w]))
        return w, np.asarray(getattr(at, self.objective.replace(" ", "_")))


def worst_case(
    plan: Any,
    *,
    objective: str = "bias",
    k: int = 2,
    values: Sequence[Any] | None = None,
    digits: int = 30,
    **params: Any,
) -> WorstCase:
    """The supremum over all weights of |bias|, |bias|/I or the mean squared error, certified.

    ``k`` values evenly spaced on [0, 1] unless ``values`` are given. Raises InputError for an unknown
    objective, NoClosedForm and its kin where the plan has no polynomial in the weights.

    >>> from truemean.oracle.plans import catalogue
    >>> found = worst_case(catalogue["kirk-arvo"], n=2, digits=6)
    >>> found.value, found.attained, found.bias
    (Enclosure(0.09622504298, 0.09622504502), True, Fraction(-1790712, 18609625))
    """
    name = objective.replace("_", " ")
    if name not in OBJECTIVES:
        raise UnknownName("objective", objective, OBJECTIVES)
    declared = as_plan(plan)
    bound = declared.bind(params)
    derivation = _derived(declared, bound, k, values)
    number = derivation.mean_squared_errors[0] if name == "mse" else derivation.biases[0]
    terms = _polynomial(derivation, number)
    if name == "relative bias":
        found = _relative(derivation, terms, digits)
    elif len(derivation.pixel.values) == 2:
        found = supremum(_univariate(terms), digits)
    else:
        found = supremum_simplex(terms, len(derivation.pixel.values), digits)
    X = _pixel(derivation, found)
    value = Enclosure.around(found.lower, found.upper, digits)
    return WorstCase(name, value, found.attained, X, derive(declared, X, **bound).bias, found.complete, declared, bound)


def smallest_n(
    plan: Any,
    tolerance: Any,
    *,
    parameter: str = "n",
    between: tuple[int, int] = (2, 1024),
    values: Sequence[Any] = (0, 1),
    **params: Any,
) -> int:
    """The smallest sample size for which |bias| <= tolerance on every pixel of two values, certified.

    ``tolerance`` is absolute, or in percent of the distance of the values (``"1%"``). Every size ``between``
    the two is decided in turn, since a bias need not fall steadily; with one draw there is nothing to vary, hence
    mostly no bias, so the search starts at 2. Raises InputError where the last size is not enough.

    >>> from truemean.oracle.plans import catalogue
    >>> smallest_n(catalogue["kirk-arvo"], "5%")
    7
    """
    declared = as_plan(plan)
    low, high = (exact_number(v, "values") for v in values)
    text = str(tolerance).strip()
    limit = (
        exact_number(text[:-1], "tolerance") / 100 * abs(high - low)
        if text.endswith("%")
        else exact_number(tolerance, "tolerance")
    )
    if limit <= 0:
        raise InputError(f"tolerance={tolerance!r} is not positive: an unbiased plan is what prove() is for")
    for n in range(between[0], between[1] + 1):
        derivation = _derived(declared, declared.bind({**params, parameter: n}), 2, values)
        coefficients = _univariate(_polynomial(derivation, derivation.biases[0]))
        if below(coefficients, limit, near=_likely_worst(coefficients)):
            return n
    raise InputError(
        f"|bias| <= {tolerance} on every pixel of two values needs more than {parameter}={between[1]}: raise between="
    )


def _derived(plan: Plan, params: dict[str, Any], k: int, values: Sequence[Any] | None) -> Derivation:
    open_ = [name for name, value in params.items() if is_symbolic(value)]
    if open_:
        raise InputError(f"{', '.join(open_)} of {plan.name} is a symbol: the worst pixel needs numbers")
    if isinstance(k, bool) or not isinstance(k, int) or k < 2:
        raise InputError(f"k={k!r} is no number of values to weigh: give an integer of at least 2")
    chosen = list(values) if values is not None else [Fraction(i, k - 1) for i in range(k)]
    found: Derivation = derive(plan, Pixel.symbolic(len(chosen), values=chosen), arithmetic="symbolic", **params)
    if len(chosen) < 2 or found.pixel.channels is not None:
        raise InputError(f"values={values!r}: give two or more numbers")
    return found


def _polynomial(derivation: Derivation, number: Any) -> dict[tuple[int, ...], Fraction]:
    """A number of the derivation as a polynomial in the weights, by exponents."""
    ratio: Ratio = derivation.field.number(number)
    num, den = ratio.lifted()
    unit = int(den.leading_coefficient())
    places = [derivation.field.place(str(mass)) for mass in derivation.law.masses]
    return {tuple(int(e[p]) for p in places if p is not None): Fraction(int(c), unit) for e, c in num.to_dict().items()}


def _univariate(terms: dict[tuple[int, ...], Fraction]) -> list[Fraction]:
    """Coefficients in w, the weight of the larger value; the smaller has 1 - w."""
    from flint import fmpq, fmpq_poly

    w, rest = fmpq_poly([0, 1]), fmpq_poly([1, -1])
    total = fmpq_poly([0])
    for (low, high), c in terms.items():
        total += rest**low * w**high * fmpq(c.numerator, c.denominator)
    return [Fraction(int(c.p), int(c.q)) for c in total.coeffs()] or [Fraction(0)]


def _relative(derivation: Derivation, terms: dict[tuple[int, ...], Fraction], digits: int) -> Extremum:
    if len(derivation.pixel.values) > 2:
        raise InputError("objective='relative bias' is certified for two values only: use k=2, or objective='bias'")
    mean = _univariate(_polynomial(derivation, derivation.law.mean(0)))
    return supremum_ratio(_univariate(terms), mean, digits)


def _pixel(derivation: Derivation, found: Extremum) -> Pixel:
    values = sorted(derivation.pixel.values)
    weights = found.point if len(found.point) == len(values) else (1 - found.point[0], found.point[0])
    return Pixel(dict(zip(values, weights, strict=True)))


def _likely_worst(coefficients: list[Fraction]) -> Fraction:
    """Where |p| is large as far as floats can tell: only a place to look first."""
    w = np.arange(1, 256) / 256
    rough = np.polynomial.polynomial.polyval(w, np.array([float(c) for c in coefficients]))
    return Fraction(1 + int(np.argmax(np.abs(np.nan_to_num(rough)))), 256)
