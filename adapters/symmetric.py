"""Code for which the order of its samples makes no difference: one run for all sequences of equal counts."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import combinations_with_replacement
from random import Random
from typing import Any

from truemean.adapters.answers import SPOTS, Another, Answers, Odds, check_again, odds_of
from truemean.errors import SubjectError, TooManyPaths
from truemean.subject import Exact, PixelLike

__all__ = ["by_counts"]

SHUFFLED = 32  # states whose samples are shuffled, to see whether their order makes a difference
Run = Callable[[PixelLike, Answers], Any]


@dataclass(frozen=True, slots=True)
class _State:
    """Sequences of answers of equal counts: their probability together, and one of them."""

    mass: Fraction
    given: tuple[int, ...]
    asked: tuple[Odds, ...]


def by_counts(run: Run, pixel: PixelLike, order: str, budget: int) -> Exact:
    """The exact law over the counts of samples, in each block asked for at once or in ``all`` together.

    States are run in the order of how many answers they have, so that all their sequences have been added up.
    SubjectError where a shuffled sequence gives another estimate, TooManyPaths beyond ``budget`` runs.
    """
    draws = odds_of(pixel.weights)
    waiting: dict[int, dict[Any, _State]] = {0: {(): _State(Fraction(1), (), ())}}
    law: dict[Any, Fraction] = {}
    cost, known, seen = Fraction(0), 1, []
    while waiting:
        level = min(waiting)
        for state in waiting.pop(level).values():
            # Run one of its sequences; whatever is asked beyond it is told the first alternative.
            answers, estimate = _run(run, pixel, draws, state.given, state.asked)
            if answers.used < level:
                raise SubjectError(f"asked for {answers.used} samples where it asked for {level} before")
            ended = answers.used == level
            seen.append((state, estimate if ended else None, _blocks(answers, level)))
            check_again(lambda again: run(pixel, again), answers, estimate, SPOTS // len(seen))
            if ended:
                value = tuple(map(Fraction, estimate)) if isinstance(estimate, tuple) else Fraction(estimate)
                law[value] = law.get(value, Fraction(0)) + state.mass
                cost += state.mass * answers.cost
                continue
            # It asks for more: each of the counts that it may be told is a state.
            odds, count = answers.asked[level], dict(answers.blocks).get(level, 1)
            if math.comb(len(odds.places) + count - 1, count) > budget:
                raise _too_many(budget)
            for after in _children(state, odds, count):
                key = _key(after, draws) if order == "all" else after.given
                level_of_it = waiting.setdefault(len(after.given), {})
                before = level_of_it.get(key)
                known += before is None
                level_of_it[key] = replace(before, mass=before.mass + after.mass) if before else after
            if known > budget:
                raise _too_many(budget)
    _check(run, pixel, draws, order, seen)
    return Exact(law, cost, known, f"{known} counts of answers")


def _too_many(budget: int) -> TooManyPaths:
    return TooManyPaths(f"more than paths={budget} runs would be needed")


def _run(run: Run, pixel: PixelLike, draws: Odds, given: Any, asked: Any) -> tuple[Answers, Any]:
    answers = Answers(draws)
    answers.given, answers.asked = list(given), list(asked)
    return answers, run(pixel, answers)


def _blocks(answers: Answers, level: int) -> list[tuple[int, int]]:
    return [(start, count) for start, count in answers.blocks if start + count <= level]


def _children(state: _State, odds: Odds, count: int) -> Iterator[_State]:
    """What the next request may be answered: all counts of a block of samples, or the alternatives of a choice."""
    total, orders, asked = odds.total**count, math.factorial(count), state.asked + (odds,) * count
    for places in combinations_with_replacement(range(len(odds.places)), count):
        mass = orders
        for place, times in Counter(places).items():
            mass = mass * odds.masses[place] ** times // math.factorial(times)
        yield _State(state.mass * Fraction(mass, total), state.given + places, asked)


def _key(state: _State, draws: Odds) -> Any:
    """The counts of all samples, and the choices in their order."""
    pairs = list(zip(state.asked, state.given, strict=True))
    sampled = tuple(sorted(place for odds, place in pairs if odds is draws))
    return sampled, tuple((at, place) for at, (odds, place) in enumerate(pairs) if odds is not draws)


def _check(run: Run, pixel: PixelLike, draws: Odds, order: str, seen: list[Any]) -> None:
    """Shuffle the samples of some states: the estimate, and whether there is one, must stay."""
    random = Random(len(seen))
    slack = 1e-9 * (1 + max(abs(float(v)) for value in pixel.values for v in _parts(value)))
    mixed = [each for each in seen if len(set(each[0].given)) > 1]
    for state, estimate, blocks in random.sample(mixed, min(SHUFFLED, len(mixed))):
        spots = [i for i, odds in enumerate(state.asked) if odds is draws]
        groups = [spots] if order == "all" else [list(range(start, start + count)) for start, count in blocks]
        shuffled, level = list(state.given), len(state.given)
        for group in groups:
            for spot, source in zip(group, random.sample(group, len(group)), strict=True):
                shuffled[spot] = state.given[source]
        try:
            answers, again = _run(run, pixel, draws, shuffled, state.asked)
        except Another:
            if order == "all":
                continue
            raise
        if order == "all" and (answers.used < level or any(at < level < at + count for at, count in answers.blocks)):
            continue  # in this order it took another way
        other = again if answers.used == level else None
        if (other is None) != (estimate is None) or (estimate is not None and _differ(estimate, other, slack)):
            raise SubjectError(
                f"gives {_told(estimate)}, but {_told(other)} {answers.told(pixel)}, which are the same samples in another "
                "order: say order=sequence"
            )


def _told(estimate: Any) -> str:
    return "no estimate yet" if estimate is None else str(estimate)


def _parts(value: Any) -> tuple[Any, ...]:
    return value if isinstance(value, tuple) else (value,)


def _differ(one: Any, other: Any, slack: float) -> bool:
    return any(abs(float(a) - float(b)) > slack for a, b in zip(_parts(one), _parts(other), strict=True))
