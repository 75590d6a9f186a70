"""What code that asks for its samples is told: given answers first, then the first alternative, or chance."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, lru_cache
from random import Random
from typing import Any

from truemean.errors import SubjectError, TooManyPaths, TruemeanError
from truemean.subject import PixelLike

__all__ = ["LONGEST", "SPOTS", "Another", "Answers", "Chance", "Odds", "check_again", "odds_of"]

LONGEST = 4096  # answers on one path
ENDLESS = 1 << 22  # answers of one replicate
SHOWN = 20
ROUNDING = Fraction(1, 10**9)  # of floats that are weights
SPOTS = 16  # paths that are run again


@dataclass(frozen=True, eq=False)
class Odds:
    """Alternatives that can be: their indices, and their weights over one denominator."""

    places: tuple[int, ...]
    masses: tuple[int, ...]
    total: int

    @cached_property
    def cumulative(self) -> list[float]:
        """Upper ends of the alternatives in [0, 1]."""
        return [sum(self.masses[: i + 1]) / self.total for i in range(len(self.masses))]


def odds_of(weights: Sequence[Any]) -> Odds:
    """Alternatives of these weights, those of weight 0 left out; SubjectError unless they sum to 1.

    Floats that sum to 1 but for rounding, such as 1/3 thrice, are divided by their sum.

    >>> odds_of(["1/2", 0, "1/2"]).places
    (0, 2)
    """
    exact: list[Fraction] = []
    with suppress(ValueError, TypeError, OverflowError, ZeroDivisionError):
        exact = [Fraction(weight) for weight in weights]
    if not exact or min(exact) < 0 or abs(sum(exact, Fraction(-1))) > ROUNDING:
        raise SubjectError(
            f"asks for a choice of weights {weights!r:.80}, which are no probabilities: let them sum to 1"
        )
    shared = math.lcm(*(weight.denominator for weight in exact))
    masses = {i: int(weight * shared) for i, weight in enumerate(exact) if weight}
    return Odds(tuple(masses), tuple(masses.values()), sum(masses.values()))


_choice = lru_cache(1024)(odds_of)


class Another(SubjectError):
    """After the same answers, the code asks for something else."""


class Answers:
    """One run after the other: ``given`` are the answers, by place among the alternatives ``asked``.

    ``used`` counts those of the run so far; ``blocks`` are start and length of the samples asked for at once;
    ``refusal`` is the error that ended the run, even if the code caught it.
    """

    def __init__(self, draws: Odds) -> None:
        self.draws = draws
        self.refusal: TruemeanError | None = None
        self.given: list[int] = []
        self.asked: list[Odds] = []
        self.blocks: list[tuple[int, int]] = []
        self.used = 0

    def start(self) -> None:
        """The code is run again, from its first question."""
        self.used, self.refusal = 0, None
        self.blocks.clear()

    def one(self) -> int:
        """The index of the value of one sample."""
        place = self.used
        if place == len(self.given):
            self._new(self.draws)
        elif self.asked[place] is not self.draws:
            raise self._another()
        self.used = place + 1
        return self.draws.places[self.given[place]]

    def draw(self, count: int) -> list[int]:
        """Indices of the values of so many samples, asked for at once."""
        if not count >= 0:
            raise SubjectError(f"asks for {count} samples: ask for 0 or more")
        start, draws = self.used, self.draws
        before = self.asked[start : start + count]
        if before.count(draws) < len(before):
            raise self._another()
        for _ in range(count - len(before)):
            self._new(draws)
        if count:
            self.blocks.append((start, count))
        self.used = start + count
        return [draws.places[place] for place in self.given[start : self.used]]

    def pick(self, weights: Sequence[Any]) -> int:
        """The index of one of several alternatives of the code's own."""
        return self.ask(_choice(tuple(weights)))

    def ask(self, odds: Odds) -> int:
        """The index of the alternative that the code is told."""
        place = self.used
        if place == len(self.given):
            self._new(odds)
        elif (before := self.asked[place]) is not odds:
            drawn = self.draws in (before, odds)
            if drawn or (before.places, before.masses) != (odds.places, odds.masses):
                raise self._another()
        self.used = place + 1
        return odds.places[self.given[place]]

    def _new(self, odds: Odds) -> None:
        if len(self.given) >= LONGEST:
            raise self._refuse(TooManyPaths(f"it asks for more than {LONGEST} samples on one path"))
        self.given.append(0)
        self.asked.append(odds)

    def _another(self) -> TruemeanError:
        return self._refuse(
            Another(
                f"asks for something else as its answer {self.used + 1} than before, after the same answers: "
                "let it depend on nothing but its answers"
            )
        )

    def _refuse(self, error: TruemeanError) -> TruemeanError:
        self.refusal = error
        return error

    @property
    def cost(self) -> int:
        """How many of the answers were samples."""
        return self.asked[: self.used].count(self.draws)

    def told(self, pixel: PixelLike) -> str:
        """The answers in words, for an error."""
        if not self.used:
            return "before it asked for a sample"
        said = [
            str(pixel.values[odds.places[place]]) if odds is self.draws else f"choice {odds.places[place]}"
            for odds, place in zip(self.asked[: self.used], self.given, strict=False)
        ]
        return f"when its samples were {', '.join(said[:SHOWN])}{', ...' if len(said) > SHOWN else ''}"


class Chance(Answers):
    """The answers of one run, as the generator of a seed has them."""

    def __init__(self, draws: Odds, seed: int) -> None:
        super().__init__(draws)
        self._random = Random(seed).random  # the stream of a seed is the replicate's

    def _new(self, odds: Odds) -> None:
        if len(self.given) >= ENDLESS:
            raise self._refuse(SubjectError(f"asks for more than {ENDLESS} samples for one replicate: let it end"))
        self.given.append(min(bisect_right(odds.cumulative, self._random()), len(odds.places) - 1))
        self.asked.append(odds)


def check_again(run: Callable[[Answers], Any], answers: Answers, estimate: Any, times: int) -> None:
    """SubjectError unless the code, run again with its answers, gives its ``estimate`` again, so many ``times``."""
    used = answers.used
    for _ in range(times):
        again = run(answers)
        if answers.used != used or again != estimate:
            raise SubjectError(
                f"returned {estimate} and then {again} for the same samples: let it depend on nothing but its answers"
            )
