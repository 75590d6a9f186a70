"""Code that asks for its samples, run over all answers: the exact law of the code itself.

The code calls ``draw`` for a sample and is told the first value of the pixel; run again, the next one, and so on
through all sequences of answers, as an odometer goes through its numbers. Each run is a path, its probability
the product of the weights of its answers: no statistics, no plan. Code for which the order of its samples makes no
difference says so, and runs once for all sequences of equal counts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from truemean.adapters.answers import SPOTS, Answers, Chance, check_again, odds_of
from truemean.adapters.registry import read_number
from truemean.adapters.symmetric import by_counts
from truemean.errors import InputError, SubjectError, TooManyPaths, TruemeanError, raised
from truemean.subject import Exact, PixelLike, argument_names

__all__ = ["ORDERS", "Asking", "Draw", "Replay", "by_sequences", "exact_law", "replay_of"]

Floats = NDArray[np.float64]
ORDERS = ("sequence", "blocks", "all")
LENGTH = 32  # samples on a path on average, beyond which paths are run for as long as so many of these
Replay = Callable[[PixelLike, Answers], Any]


class Asking:
    """An estimator that asks for its samples: exact where its paths can be enumerated, sampled where not.

    ``replay(pixel, answers)`` runs the code once. ``paths`` bounds the runs on one pixel. ``order`` says what makes a
    difference to the code: the ``sequence`` of its samples; the counts of each value in each of the ``blocks`` that
    it asks for at once; or only the counts in ``all`` samples so far. The two last are spot-checked.
    InputError for other options.

    >>> from truemean.oracle import Pixel
    >>> fig1 = Asking(lambda X, answers: 0.0 if not any(answers.draw(4)) else 0.125)
    >>> fig1.exact(Pixel.two("1/8")).law
    {Fraction(0, 1): Fraction(2401, 4096), Fraction(1, 8): Fraction(1695, 4096)}
    """

    def __init__(self, replay: Replay, *, name: str = "code", paths: Any = 300_000, order: str = "sequence") -> None:
        self.replay, self.name, self.order = replay, name, order
        self.paths = read_number(paths)
        if not (isinstance(self.paths, int) and self.paths >= 1):
            raise InputError(f"paths={paths!r} is no number of runs: give a whole number from 1 up")
        if order not in ORDERS:
            raise InputError(f"order={order!r}: say which order of samples matters, one of {', '.join(ORDERS)}")
        self._known: dict[Any, Exact | str] = {}
        self._last: tuple[Any, ...] = ()

    def exact(self, pixel: PixelLike) -> Exact:
        """The law of the estimate, over all paths; TooManyPaths beyond the budget, SubjectError where a path breaks."""
        key = (pixel.values, pixel.weights)
        if key not in self._known:
            try:
                self._known[key] = self.enumerate(pixel)
            except TooManyPaths as why:
                self._known[key] = str(why)
        found = self._known[key]
        if isinstance(found, str):
            raise TooManyPaths(found)
        return found

    def enumerate(self, pixel: PixelLike) -> Exact:
        """The same, always computed."""
        if self.order == "sequence":
            return by_sequences(lambda answers: self.once(pixel, answers), Answers(odds_of(pixel.weights)), self.paths)
        return by_counts(self.once, pixel, self.order, self.paths)

    def once(self, pixel: PixelLike, answers: Answers) -> Any:
        """One run; SubjectError, with the answers that led there, for a crash or what is no estimate."""
        answers.start()
        try:
            estimate = self.replay(pixel, answers)
        except TruemeanError:
            raise
        except (Exception, SystemExit) as crash:
            if answers.refusal is not None:
                raise answers.refusal from crash
            raise SubjectError(f"crashed with {raised(crash)} {answers.told(pixel)}") from crash
        if answers.refusal is not None:
            raise answers.refusal
        if type(estimate) is float and math.isfinite(estimate) and not isinstance(pixel.values[0], tuple):
            return estimate
        return _read_estimate(estimate, pixel, answers)

    def run(self, pixel: PixelLike, seeds: ArrayLike) -> Floats:
        """Estimates ``[seeds]`` or ``[seeds, channels]`` with sampled answers."""
        return self._sampled(pixel, np.asarray(seeds))[0]

    def costs(self, pixel: PixelLike, seeds: ArrayLike) -> Floats:
        """Samples drawn ``[seeds]``."""
        return self._sampled(pixel, np.asarray(seeds))[1]

    def _sampled(self, pixel: PixelLike, seeds: NDArray[np.int64]) -> tuple[Floats, Floats]:
        if not (self._last and self._last[0] is pixel and np.array_equal(self._last[1], seeds)):
            odds, estimates, costs = odds_of(pixel.weights), [], []
            for seed in seeds.tolist():
                answers = Chance(odds, seed)
                estimates.append(self.once(pixel, answers))
                costs.append(answers.cost)
            self._last = (pixel, seeds, (np.array(estimates, dtype=float), np.array(costs, dtype=float)))
        found: tuple[Floats, Floats] = self._last[2]
        return found


def by_sequences(run: Callable[[Answers], Any], answers: Answers, budget: int) -> Exact:
    """The exact law over all sequences of answers; ``run`` gives the estimate that the code returns with them.

    SubjectError where some of them, run twice, give another estimate; TooManyPaths beyond ``budget`` sequences.
    """
    given, asked = answers.given, answers.asked
    masses, totals = [1], [1]  # of the answers up to each
    law: dict[tuple[Any, int], int] = {}
    spent: dict[int, int] = {}
    paths, samples, least = 0, 0, 1
    while True:
        # Run this path; answers that are new are first alternatives.
        estimate = run(answers)
        paths += 1
        samples += answers.used
        if answers.used < len(given):
            raise SubjectError(
                f"asked for {answers.used} samples where it asked for {len(given)} before: use no others"
            )
        if paths <= SPOTS or paths & (paths - 1) == 0:
            least = max((len(answers.draws.places) ** count for _, count in answers.blocks), default=1)
            check_again(run, answers, estimate, max(1, SPOTS // paths))
        if max(paths, least) > budget:
            raise TooManyPaths(f"more than paths={budget} runs would be needed")
        if samples > LENGTH * budget:
            raise TooManyPaths(f"more than {LENGTH} samples a path would be needed for each of paths={budget} runs")
        # Count it.
        for odds, place in zip(asked[len(masses) - 1 :], given[len(masses) - 1 :], strict=True):
            masses.append(masses[-1] * odds.masses[place])
            totals.append(totals[-1] * odds.total)
        key = (estimate, totals[-1])
        law[key] = law.get(key, 0) + masses[-1]
        spent[totals[-1]] = spent.get(totals[-1], 0) + masses[-1] * answers.cost
        # The last answer that has a next alternative takes it.
        while given and given[-1] + 1 == len(asked[-1].places):
            for stack in (given, asked, masses, totals):
                stack.pop()
        if not given:
            return exact_law(law, spent, paths)
        given[-1] += 1
        masses[-1], totals[-1] = masses[-2] * asked[-1].masses[given[-1]], totals[-2] * asked[-1].total


def exact_law(law: dict[tuple[Any, int], int], spent: dict[int, int], paths: int) -> Exact:
    """The law of masses by ``(estimate, total)``, and the cost of masses by total."""
    found: dict[Any, Fraction] = {}
    for (estimate, total), mass in law.items():
        value = tuple(map(Fraction, estimate)) if isinstance(estimate, tuple) else Fraction(estimate)
        found[value] = found.get(value, Fraction(0)) + Fraction(mass, total)
    cost = sum((Fraction(mass, total) for total, mass in spent.items()), Fraction(0))
    return Exact(found, cost, paths, "1 sequence of answers" if paths == 1 else f"{paths} sequences of answers")


class Draw:
    """What a Python function asks: ``draw()`` for a sample, ``draw(n)`` for an array of n, ``draw.pick(weights)``, ``draw.coin(p)``.

    Samples are floats, or arrays ``[channels]`` on colour pixels.
    """

    def __init__(self, pixel: PixelLike) -> None:
        self._values = pixel.arrays()[0]
        self._numbers = self._values.tolist() if self._values.ndim == 1 else None
        self.answers = Answers(odds_of(pixel.weights))

    def __call__(self, count: int | None = None) -> Any:
        if count is not None:
            return self._values[self.answers.draw(count)]
        place = self.answers.one()
        return self._values[place].copy() if self._numbers is None else self._numbers[place]

    def pick(self, weights: Sequence[Any]) -> int:
        """0, 1, ... with these probabilities: ints, Fractions, decimal strings, or floats at their exact value."""
        return self.answers.pick(weights)

    def coin(self, p: Any) -> bool:
        """True with probability ``p``."""
        heads = Fraction(p)
        return self.pick((1 - heads, heads)) == 1


def replay_of(function: Callable[..., Any], **options: Any) -> Replay:
    """How to run ``function(pixel, draw)``, or ``function(draw)``, once."""
    alone = argument_names(function)[:1] == ["draw"]
    last: list[tuple[PixelLike, Draw]] = []

    def replay(pixel: PixelLike, answers: Answers) -> Any:
        if not last or last[0][0] is not pixel:
            last[:] = [(pixel, Draw(pixel))]
        draw = last[0][1]
        draw.answers = answers
        return function(draw, **options) if alone else function(pixel, draw, **options)

    return replay


def _read_estimate(estimate: Any, pixel: PixelLike, answers: Answers) -> Any:
    """A number, or a tuple of one a channel; SubjectError for anything else."""
    channels = len(pixel.values[0]) if isinstance(pixel.values[0], tuple) else 0
    try:
        listed = list(estimate) if channels else [estimate]
        numbers = [each if isinstance(each, Fraction) else float(each) for each in listed if np.ndim(each) == 0]
        right = len(numbers) == len(listed) == max(channels, 1) and not isinstance(estimate, str)
    except (TypeError, ValueError, OverflowError):
        right = False
    if not right or not all(map(math.isfinite, numbers)):
        wanted = f"{channels} numbers" if channels else "a number"
        raise SubjectError(f"returned {estimate!r:.80}, not {wanted}, {answers.told(pixel)}")
    return tuple(numbers) if channels else numbers[0]
