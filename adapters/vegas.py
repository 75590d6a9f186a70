"""vegas, the adaptive integrator of physics, as an estimator of the pixels of a scene.

How it decides (vegas 6.4.1, ``src/vegas/_vegas.pyx``): in each of ``nitn`` iterations some ``neval`` points fall into
the ``nstrat`` strata of the square, ``beta`` > 0 giving more to those that varied, through a map whose increments
``alpha`` > 0 makes smaller where the values were large. A point counts by the map's Jacobian, so for the map and the strata
that earlier iterations left an iteration has the true mean, and so has the plain mean of iterations
(``weighted=0``). vegas itself weights an iteration by the inverse of the variance that it found in it
(``weighted=1``): biased, since a sample's mean and variance go together. An iteration that saw nothing but 0 has
variance 0 and is given 1e-257, which outweighs all others; one that saw nothing but another value v is given, with
one stratum, (2.2e-12 v)^2 / (neval - 1): the estimate is dark as soon as one iteration is.

The range of estimates is proved: an axis has ``ninc / nstrat`` increments a stratum, whose largest add up to
1 at most, so that no iteration exceeds the largest value times the product of ``ninc / nstrat`` over both axes, and no
weighting does either. With one increment a stratum, or a map that never changes, estimates lie between the values.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from fractions import Fraction
from importlib import import_module
from importlib.metadata import version
from itertools import combinations_with_replacement
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from truemean.adapters.frames import Floats, Number, read_count, untested
from truemean.adapters.integrands import Integrand, SceneIntegrator, true_mean
from truemean.adapters.registry import read_number
from truemean.errors import InputError, MissingExtra
from truemean.subject import PixelLike

__all__ = ["Vegas", "weighted_law"]

TESTED = ("6.4.1",)
SQUARE = [[0.0, 1.0], [0.0, 1.0]]
TINY = Fraction(1e-257)  # the variance of an iteration that saw nothing but 0
EPSILON = Fraction(float(np.finfo(float).eps) * 1e4)  # the relative deviation of one that saw one value
MOST = 6000  # outcomes of a law


class Vegas(SceneIntegrator):
    """The integral of a pixel of a scene by vegas, a replicate by ``gvar.ranseed(seed)``.

    ``nitn``, ``neval``, ``alpha``, ``beta`` and ``nstrat`` ("1,1") are vegas' own; ``weighted`` 1 is its own mean of the
    iterations, 0 their plain mean. MissingExtra without vegas, InputError for options that vegas refuses.
    """

    name = "vegas"
    package: ClassVar[str] = "vegas"

    def __init__(
        self,
        scene: Any = "tile",
        nitn: Number = 5,
        neval: Number = 100,
        alpha: Number = 0.5,
        beta: Number = 0.75,
        nstrat: str | Sequence[int] | None = None,
        weighted: Number = 1,
    ) -> None:
        try:
            import_module("vegas")
        except ImportError as error:
            raise MissingExtra(f"vegas can't be imported ({error}): pip install 'truemean[vegas]'") from error
        super().__init__(scene)
        self.notes = untested("vegas", version("vegas"), TESTED)
        self.weighted = read_number(weighted) == 1
        if read_number(weighted) not in (0, 1):
            raise InputError(
                f"weighted={weighted!r}: write 1 for vegas' own mean of the iterations, 0 for the plain one"
            )
        self.nitn, self.neval = read_count("nitn", nitn), read_count("neval", neval)
        self.options: dict[str, Any] = {
            "nitn": self.nitn,
            "neval": self.neval,
            "alpha": _damping("alpha", alpha),
            "beta": _damping("beta", beta),
            "nstrat": None if nstrat is None else _strata(nstrat),
        }
        try:
            with _undisturbed():
                made = self._integrator()
        except (ValueError, OverflowError, MemoryError) as error:
            given = ", ".join(f"{name}={value}" for name, value in self.options.items())
            raise InputError(f"vegas refuses {given}: {error}") from None
        increments, strata = (math.prod(map(int, parts)) for parts in (made.map.ninc, made.nstrat))
        self.one_stratum = strata == 1
        self.adaptive_map = self.options["alpha"] > 0 and self.nitn > 1 and increments > 1
        if self.adaptive_map:
            self._magnify(Fraction(increments, strata))

    @property
    def declares(self) -> tuple[str, dict[str, int]] | None:
        """Independent samples where there is one stratum, a map that stays and no weighting; else None."""
        if self.one_stratum and not self.adaptive_map and self._unweighted:
            return "fixed", {"n": self.nitn * self.neval}
        return None

    @property
    def predicts(self) -> Callable[[PixelLike], Mapping[str, Any]] | None:
        """The true mean without weighting; the law of independent samples that are weighted; else None."""
        if self._unweighted:
            return lambda pixel: {"mean": true_mean(pixel)}
        return self._weighted if self.one_stratum and not self.adaptive_map else None

    def integrate(self, function: Integrand, seeds: NDArray[np.int64]) -> tuple[Floats, Floats]:
        """Estimates and samples drawn ``[seeds]``; gvar's own random numbers go on as if unused."""
        from vegas import lbatchintegrand

        batch = lbatchintegrand(function.__call__)
        with _undisturbed():
            results = [self._result(batch, int(seed)) for seed in seeds]
        estimates, costs = np.array(results, dtype=float).reshape(-1, 2).T
        return estimates, costs

    @property
    def _unweighted(self) -> bool:
        return not self.weighted or self.nitn == 1

    def _weighted(self, pixel: PixelLike) -> Mapping[str, Any]:
        law = weighted_law(pixel, self.nitn, self.neval)
        return {"cost": self.nitn * self.neval} | ({} if law is None else {"law": law})

    def _integrator(self) -> Any:
        from vegas import Integrator

        return Integrator(SQUARE, **self.options)

    def _result(self, batch: Any, seed: int) -> tuple[float, float]:
        import gvar

        gvar.ranseed(seed)
        result = self._integrator()(batch)
        if self.weighted:
            return result.mean, result.sum_neval
        return float(np.mean([each.mean for each in result.itn_results])), result.sum_neval


def weighted_law(pixel: PixelLike, nitn: int, neval: int) -> dict[Fraction, Fraction] | None:
    """The law of vegas' weighted mean of ``nitn`` iterations of ``neval`` independent samples, its outcomes as floats.

    None where there are too many.

    >>> from types import SimpleNamespace
    >>> quarter = SimpleNamespace(values=(Fraction(0), Fraction(1)), weights=(Fraction(3, 4), Fraction(1, 4)))
    >>> law = weighted_law(quarter, nitn=2, neval=2)
    >>> round(float(sum(x * p for x, p in law.items())), 6), float(sum(p for x, p in law.items() if x < 1e-200))
    (0.121094, 0.80859375)
    """
    sizes = [math.comb(neval + len(pixel.values) - 1, neval)]
    sizes.append(math.comb(sizes[0] + nitn - 1, nitn))
    if max(sizes) > MOST:
        return None
    law: dict[Fraction, Fraction] = {}
    for drawn in combinations_with_replacement(_iterations(pixel, neval), nitn):
        orders = math.factorial(nitn) // math.prod(math.factorial(drawn.count(each)) for each in set(drawn))
        weight = sum(w for _, w, _ in drawn)
        outcome = Fraction(float(sum(w * mean for mean, w, _ in drawn) / weight))
        law[outcome] = law.get(outcome, Fraction(0)) + orders * math.prod(p for _, _, p in drawn)
    return law


def _iterations(pixel: PixelLike, neval: int) -> Iterator[tuple[Fraction, Fraction, Fraction]]:
    """Mean, weight in vegas and probability of what an iteration may have drawn."""
    values = [value for value in pixel.values if isinstance(value, Fraction)]
    for counts in _counts(neval, len(values)):
        mean = sum((c * v for c, v in zip(counts, values, strict=True)), Fraction(0)) / neval
        variance = sum((c * (v - mean) ** 2 for c, v in zip(counts, values, strict=True)), Fraction(0)) / neval
        ways = math.factorial(neval) // math.prod(map(math.factorial, counts))
        probability = ways * math.prod(w**c for c, w in zip(counts, pixel.weights, strict=True))
        yield mean, (neval - 1) / max(variance or (EPSILON * mean) ** 2, TINY * (neval - 1)), Fraction(probability)


@contextmanager
def _undisturbed() -> Iterator[None]:
    """Afterwards gvar's random numbers go on as if unused, and the numbers that it keeps are forgotten."""
    import gvar

    state, seed = gvar.RNG, getattr(gvar.ranseed, "seed", None)
    gvar.switch_gvar()
    gvar.ranseed(0)
    try:
        yield
    finally:
        gvar.restore_gvar()
        gvar.RNG, gvar.ranseed.seed = state, seed


def _counts(total: int, kinds: int) -> Iterator[tuple[int, ...]]:
    """How ``total`` draws may be shared out."""
    if kinds == 1:
        yield (total,)
        return
    for first in range(total + 1):
        yield from ((first, *rest) for rest in _counts(total - first, kinds - 1))


def _damping(name: str, value: Number) -> float:
    number = read_number(value)
    if not (isinstance(number, int | float) and 0 <= number < math.inf):
        raise InputError(f"{name}={value!r} is no damping: give a number from 0 up, 0 for no adaptation")
    return float(number)


def _strata(given: str | Sequence[int]) -> list[int]:
    parts = given.split(",") if isinstance(given, str) else list(given)
    counts = [read_number(part) for part in parts]
    if not (len(counts) == 2 and all(isinstance(count, int) and count >= 1 for count in counts)):
        raise InputError(f"nstrat={given!r} are no strata: give two whole numbers from 1 up, such as 1,1")
    return counts
