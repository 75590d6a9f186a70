"""How near evidence comes to what no test can beat, and what it costs: ``pytest tests/benchmarks/test_evidence.py``.

The ratio of a law is the median number of replicates until the verdict over log(1/level) / KL_inf, a lower
bound of their mean. Beside it, on the same laws: Welch's t-test at the fixed N that gives it a power of
90 % (Jung et al. 2020), with the false alarms that it really raises at a nominal 1 %, and the z-test of
Mitsuba 3. The time is what judging adds to a million replicates of one pixel. What is asserted are mean
ratios, up to two standard errors; no test asserts a time.

A ratio is the median of ``EVIDENCE_REPETITIONS`` runs, by default 60, looked at after every replicate at
first, and then after a share ``EVIDENCE_LOOKS`` more, by default 0.02.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.benchmarks.evidence_laws import CONFORMING, LAWS, Law, of, random_laws

from truemean.conformance import judge
from truemean.conformance.declared import Declared
from truemean.conformance.evidence import METHODS, Bounded, EProcess, Question
from truemean.conformance.openings import Levels, open_within
from truemean.conformance.target import Target
from truemean.oracle import Pixel

REPETITIONS = int(os.environ.get("EVIDENCE_REPETITIONS", "60"))
SHARE = float(os.environ.get("EVIDENCE_LOOKS", "0.02"))
TINY = 1e-15  # a variance that is rounding
PATIENCE = 12  # lower bounds until a run is given up
SETS = {"laws": lambda: LAWS, "random laws": lambda: random_laws(60, seed=20)}
FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Ratio:
    """What one law took, in units of its lower bound, with the standard error."""

    law: Law
    bound: float
    ratio: float
    error: float


def budget(bound: float) -> int:
    return 10**5 if bound < 2e4 else 10**6


def replicates(processes: Sequence[EProcess], law: Law, asked: float, most: float, rng: np.random.Generator) -> int:
    """How many until every process has reached ``asked``."""
    number = 0
    while (waiting := [each for each in processes if each.peak < asked]) and number < most:
        more = max(1, math.ceil(number * SHARE))
        batch = law.draw(more, rng)
        processes = [each.update(batch) for each in waiting]
        number += more
    return number


def measured(law: Law, bound: float, level: float, processes: Sequence[EProcess]) -> Ratio:
    rng, asked = np.random.default_rng(7), -math.log(level)
    took = sorted(replicates(processes, law, asked, PATIENCE * bound, rng) for _ in range(REPETITIONS))
    # The order statistics one standard error from the median.
    away = (math.sqrt(REPETITIONS) - 1) / 2
    low, high = np.quantile(took, 0.5 + np.array([-1, 1]) * away / (REPETITIONS - 1))
    return Ratio(law, bound, float(np.median(took)) / bound, float(high - low) / 2 / bound)


def biased(law: Law, level: float) -> Ratio:
    bound = law.bound(level)
    sides = (Bounded(1, law.mean), Bounded(-1, 1 - law.mean))
    return measured(law, bound, level, [METHODS["focus"].open(Question(sides, level, budget(bound)))])


def conforms(law: Law, tolerance: float, level: float, declared: bool) -> Ratio:
    bound = law.within_bound(level, tolerance)
    zero, one, mean = Fraction(0), Fraction(1), Fraction(law.mean)
    target = Target("pixel", None, mean, Fraction(tolerance), (zero, one), zero)
    levels = Levels(biased=level, deviates=level, conforms=level, budget=budget(bound))
    chances = map(Fraction, law.probabilities.tolist())
    exact = dict(zip(map(Fraction, law.values.tolist()), chances, strict=True))
    plan = Declared(Fraction(law.own_mean) - mean, Fraction(law.variance), None, exact) if declared else None
    named = law.against(law.mean, f"{law.name}, {tolerance:g}")
    return measured(named, bound, level, [open_within(target, levels, "focus", plan, sign) for sign in (1, -1)])


def summary(ratios: Sequence[Ratio]) -> tuple[float, float, str]:
    """The mean, its standard error, and a line with the worst."""
    mean = float(np.mean([r.ratio for r in ratios]))
    error = math.hypot(*(r.error for r in ratios)) / len(ratios)
    worst = max(ratios, key=lambda r: r.ratio)
    return mean, error, f"mean {mean:.3f} +- {error:.3f}, worst {worst.ratio:.2f} +- {worst.error:.2f} {worst.law.name}"


# Tests at a fixed N, on their own terms.


def alarms(sums: FloatArray, floor: float = 0.0, level: float = 0.01) -> NDArray[np.bool_]:
    """Which runs a t-test says to be biased, none without variance; with a least variance a z-test."""
    from scipy.special import ndtri, stdtrit

    number, total, squares = sums
    variance = np.maximum(floor, (squares - total**2 / number) / np.maximum(number - 1, 1))
    far = -ndtri(level / 2) if floor else stdtrit(np.maximum(number - 1, 1), 1 - level / 2)
    return np.asarray((np.abs(total) > far * np.sqrt(np.maximum(variance, 0) * number)) & (variance > TINY))


def about(law: Law, mean: float) -> Law:
    """Outcomes less ``mean``, so that no digits cancel."""
    return Law(law.name, law.values - mean, law.probabilities, 0.0)


def powerful(law: Law, most: float, rng: np.random.Generator) -> int | None:
    """The first N, on a grid up to ``most``, at which Welch's test finds this bias in 90 % of runs, the right way."""
    number, centred, way = 2, about(law, law.mean), law.own_mean > law.mean
    while number < most:
        sums = centred.draws(number, 400, rng)
        if np.mean(alarms(sums) & ((sums[1] > 0) == way)) >= 0.9:
            return number
        number = math.ceil(number * 1.2)
    return None


def looked_at(law: Law, number: int, rng: np.random.Generator, runs: int = 1000) -> float:
    """How often Welch's test raises a false alarm with looks from 16 on, each 10 % later, up to ``number``."""
    sums, alarmed = np.zeros((3, runs)), np.zeros(runs, dtype=bool)
    while sums[0, 0] < number:
        more = min(max(16, math.ceil(sums[0, 0] * 0.1)), number - sums[0, 0])
        sums += law.draws(int(more), runs, rng)
        alarmed |= alarms(sums)
    return float(alarmed.mean())


def by_far_end(law: Law) -> Law:
    """An unbiased law that looks like this one: the missing rest comes from rare outcomes at the far end."""
    end = 1.0 if law.own_mean < law.mean else 0.0
    rare = (law.mean - law.own_mean) / (end - law.own_mean)
    return of(law.name, np.append(law.values, end), np.append((1 - rare) * law.probabilities, rare), 0.0)


def beside(ratio: Ratio) -> list[float]:
    """Welch's N over the bound, its false alarms on two unbiased laws and with looks, and the z-test's power at our N."""
    law, rng, ours = ratio.law, np.random.default_rng(8), max(2, round(ratio.ratio * ratio.bound))
    found = float(alarms(about(law, law.mean).draws(ours, 1000, rng), floor=1e-4).mean())
    number = powerful(law, PATIENCE * ratio.bound, rng)
    if number is None:
        return [math.nan] * 4 + [found]
    still, rare = about(law, law.own_mean), about(by_far_end(law), law.mean)
    once = [float(alarms(each.draws(number, 2000, rng)).mean()) for each in (still, rare)]
    return [number / ratio.bound, *once, looked_at(still, number, rng), found]


def table(ratios: Sequence[Ratio]) -> Iterator[str]:
    yield f"{'law':34}{'LB':>9}{'ratio':>7}{'+-':>5}"
    for r in ratios:
        yield f"{r.law.name:34}{r.bound:9.0f}{r.ratio:7.2f}{r.error:5.2f}"
    yield summary(ratios)[2]


def comparison(ratios: Sequence[Ratio]) -> Iterator[str]:
    """Welch's test and the z-test on the same laws; "none": no N finds the bias, as the variance is 0."""
    yield ""
    yield f"{'law':34}{'Welch N/LB':>11}{'false':>7}{'far end':>9}{'looks':>7}{'z power':>9}"
    found = np.array([beside(r) for r in ratios])
    for r, (number, *rates, power) in zip(ratios, found.tolist(), strict=True):
        welch = f"{number:11.2f}{rates[0]:7.3f}{rates[1]:9.3f}{rates[2]:7.3f}"
        none = " " * 7 + "none" + " " * 23
        yield f"{r.law.name:34}{none if math.isnan(number) else welch}{power:9.2f}"
    yield "Welch, median: N/LB {:.2f}, false alarms {:.3f}, {:.3f}, {:.3f}".format(*np.nanmedian(found[:, :4], axis=0))
    yield "       worst false alarms {:.3f}, {:.3f}, {:.3f}".format(*np.nanmax(found[:, 1:4], axis=0))
    yield f"z-test: power below 50 % on {np.mean(found[:, 4] < 0.5):.0%} of the laws"


def show(capsys: pytest.CaptureFixture[str], title: str, lines: Iterable[str]) -> None:
    with capsys.disabled():
        print(f"\n\n{title}, {REPETITIONS} repetitions, looks x{1 + SHARE:g}", *lines, sep="\n")  # noqa: T201 - the table is what it is run for


def timed(benchmark, measure: Callable[[], list[Ratio]]) -> list[Ratio]:
    ratios: list[Ratio] = benchmark.pedantic(measure, rounds=1, iterations=1)
    benchmark.extra_info.update({r.law.name: round(r.ratio, 3) for r in ratios})
    return ratios


@pytest.mark.parametrize(("level", "most"), [(1e-2, 1.40), (1e-6, 1.20)])
@pytest.mark.parametrize("laws", SETS)
def test_bias_is_found_near_the_lower_bound(benchmark, capsys, laws, level, most):
    benchmark.group = "BIASED over the lower bound"
    ratios = timed(benchmark, lambda: [biased(law, level) for law in SETS[laws]()])
    others = comparison(ratios) if level == 1e-2 else ()
    show(capsys, f"BIASED at {level:g}, {len(ratios)} {laws}", [*table(ratios), *others])
    mean, error, worst = summary(ratios)
    assert mean - 2 * error <= most, worst


@pytest.mark.parametrize(("declared", "most"), [(False, 1.35), (True, 1.20)], ids=["no law", "declared law"])
def test_conformance_is_found_near_the_lower_bound(benchmark, capsys, declared, most):
    benchmark.group = "CONFORMS over the lower bound"
    ratios = timed(benchmark, lambda: [conforms(law, tolerance, 0.01, declared) for tolerance, law in CONFORMING])
    title = f"CONFORMS at 0.01, {'declared' if declared else 'no declared'} law"
    show(capsys, title, table(ratios))
    mean, error, worst = summary(ratios)
    assert mean - 2 * error <= most, worst


class Cheap:
    """An estimator that takes no time to speak of; it keeps the account of what it took."""

    def __init__(self, kind: str) -> None:
        self.kind, self.spent = kind, 0.0
        if kind == "declared":
            self.predicts = lambda pixel: {"law": {Fraction(i, 16): Fraction(1, 17) for i in range(17)}}

    def range(self, pixel):
        return 0, 1

    def run(self, pixel, seeds):
        started = time.process_time()
        u = np.random.default_rng(seeds[:1]).random(seeds.size)
        y = u if self.kind == "continuous" else np.floor(17 * u) / 16
        self.spent += time.process_time() - started
        return y


# On the edge of the tolerance no verdict comes, and all evidence is gathered; with tolerance 0 only that for BIASED.
ASKED = {"tolerance 0": ("1/2", 0), "at the edge": ("2/5", "1/10")}


@pytest.mark.parametrize("asked", ASKED)
@pytest.mark.parametrize("kind", ["discrete", "continuous", "declared"])
def test_what_judging_adds_to_a_million_replicates(benchmark, capsys, kind, asked):
    benchmark.group = "a million replicates of one pixel"
    weight, tolerance = ASKED[asked]
    added = []

    def judged():
        subject, started = Cheap(kind), time.process_time()
        report = judge(subject, tolerance=tolerance, pixels={"pixel": Pixel.two(weight)}, budget=10**6)
        added.append(time.process_time() - started - subject.spent)
        return report

    report = benchmark.pedantic(judged, rounds=5, iterations=1, warmup_rounds=1)
    assert report.cases[0].replicates == 10**6
    least = min(added)
    benchmark.extra_info["seconds added"] = least
    with capsys.disabled():
        print(f"\n{kind}, {asked}: {least:.3f} s added, {least / 10:.1%} of 10 us a replicate")  # noqa: T201 - the same
