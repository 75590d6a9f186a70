"""The kinds of evidence keep their level on laws that are hard, find biases soon, and are published as they are.

A test of a level adds up all laws: each repetition is independent and raises an alarm with probability NOMINAL
at most, so a count beyond the limit has probability < 1e-6 if the method keeps its level.
"""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom
from tests.quality.publish import BEYOND, CERTIFIED, TABLES, VALID, Run, heading, intro
from tests.quality.rates import (
    BIASED,
    LAWS,
    NOMINAL,
    conforming,
    delays,
    false_alarms,
    fixed_alarms,
    fixed_power,
    limit,
    looks,
    within_bound,
    wrong_conforms,
)

PAGE = Path(__file__).parents[2] / "docs" / "error-rates.md"
RARELY = 1e-6
SEED, SPARSE = 7, 0.2  # fewer looks than are published: the tests are to be quick
REPETITIONS = {"klinf": 2}
KINDS = {
    "unbiased": (false_alarms, 0),
    "biased by the tolerance, upwards": (false_alarms, 1),
    "biased by the tolerance, downwards": (false_alarms, -1),
    "certified on the upper edge": (wrong_conforms, 1),
    "certified on the lower edge": (wrong_conforms, -1),
}


def errors(method, kind, n):
    measure, sign = KINDS[kind]
    return sum(measure(method, law, sign, repetitions=n, seed=SEED, share=SPARSE) for law in LAWS)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("method", VALID)
def test_a_method_with_a_guarantee_keeps_its_level_at_every_look(method, kind):
    n = REPETITIONS.get(method, 20)
    assert errors(method, kind, n) <= limit(n * len(LAWS), RARELY)


@pytest.mark.parametrize("kind", KINDS)
def test_the_measure_sees_that_a_t_test_breaks_its_level_under_looks(kind):
    assert errors("welch", kind, 20) > limit(20 * len(LAWS), RARELY)


def test_one_look_at_a_t_test_is_right_for_a_mean_of_many_and_wrong_for_a_rare_event():
    n, once = 400, [1000]
    assert fixed_alarms("uniform", once, floor=0, repetitions=n, seed=SEED) <= limit(n, RARELY)
    assert fixed_alarms("1 with probability 1e-4, else 0", once, floor=0, repetitions=n, seed=SEED) > n / 2
    assert fixed_alarms("uniform", looks(*once), floor=0, repetitions=n, seed=SEED) > limit(n, RARELY)


@pytest.mark.parametrize("method", ["focus", "mixture"])
@pytest.mark.parametrize("name", BIASED)
def test_a_bias_is_found_within_twice_the_bound(name, method):
    # The published medians lie between 1.1 and 1.8.
    assert np.median(delays(method, name, most=2.5, repetitions=20, seed=SEED)) <= 2


@pytest.mark.parametrize("name", CERTIFIED)
def test_a_mean_is_certified_within_two_and_a_half_times_the_bound(name):
    assert np.median(conforming("focus", name, most=3, repetitions=20, seed=SEED)) <= 2.5


def test_a_variance_floor_hides_a_bias_that_betting_finds():
    name = "0.2 always, its highlights clamped"
    assert fixed_power(name, multiple=2, floor=1e-4, repetitions=20, seed=SEED) == 0
    assert np.isfinite(delays("focus", name, most=2, repetitions=20, seed=SEED)).all()


@pytest.mark.parametrize("name", LAWS)
def test_a_law_has_the_mean_it_says(name):
    law, n = LAWS[name], 20_000
    values, probabilities = law.columns
    assert ((values >= 0) & (values <= 1)).all()
    if law.atoms:
        assert values @ probabilities == pytest.approx(float(law.mean), rel=1e-12)
    (batch,) = law.batches(np.random.default_rng(SEED), [n])
    # Six standard errors, and the rare event once too often.
    error = 6 * np.sqrt(batch.moments.squares) / n + 10 / n
    assert abs(batch.moments.mean - float(law.mean)) <= error


def test_the_bounds_are_those_of_the_survey():
    bounds = {name: case.bound for name, case in BIASED.items()}
    assert bounds["Kirk-Arvo, w = 1/8, n = 4"] == pytest.approx(60, abs=0.5)
    assert bounds["Kirk-Arvo, w = 0.45, n = 4"] == pytest.approx(842, abs=0.5)
    assert bounds["1 with probability 0.02, not 0.01"] == pytest.approx(1177, abs=0.5)
    assert within_bound("mean of 16, w = 1/8") == pytest.approx(250, abs=5)


def test_the_limit_is_a_binomial_tail():
    most = limit(2000, BEYOND)
    assert binom.sf(most, 2000, NOMINAL) < BEYOND <= binom.sf(most - 1, 2000, NOMINAL)


def test_every_look_draws_at_least_one_outcome_and_all_together_the_horizon():
    sizes = looks(2500)
    assert sum(sizes) == 2500
    assert sizes[:20] == [1] * 20
    assert min(sizes) == 1


@pytest.fixture(scope="module")
def page():
    """The page, and the run it says it is of."""
    text = PAGE.read_text(encoding="utf-8")
    repetitions, seed = re.search(r"--repetitions (\d+) --seed (\d+)", text).groups()
    return text, Run(int(repetitions), int(seed))


def published(text, table):
    """The cells of a table on the page: row -> column -> text."""
    section = text.partition(f"## {table.title}\n")[2].partition("\n## ")[0]
    lines = [line.strip("| ").split(" | ") for line in section.splitlines() if line.startswith("|")]
    heads, _, *rows = lines
    return {name: dict(zip(heads[1:], cells, strict=True)) for name, *cells in rows}


def test_the_page_is_of_these_methods_levels_and_numbers(page):
    text, run = page
    assert text.startswith(intro(run))
    assert run.repetitions >= 2000


@pytest.mark.parametrize("table", TABLES, ids=lambda table: table.title)
def test_a_published_table_has_the_laws_and_methods_there_are(page, table):
    text, run = page
    cells, foot = published(text, table), table.foot(run)
    assert list(cells) == [*table.rows, *foot]
    assert all(list(row) == [heading(column) for column in table.columns] for row in cells.values())
    assert all(list(cells[name].values()) == numbers for name, numbers in foot.items())


@pytest.mark.parametrize("table", TABLES[:3], ids=lambda table: table.title)
def test_no_published_rate_of_a_valid_method_is_above_its_level(page, table):
    text, run = page
    cells = published(text, table)
    for method in VALID:
        most = 100 * limit(run.of(method), BEYOND) / run.of(method)
        rates = [float(rate) for law in LAWS for rate in cells[law][heading(method)].split(" / ")]
        assert max(rates) <= most + 0.05


def test_a_published_rate_is_what_the_command_measures(page):
    text, run = page
    law = "mean of 16, w = 1/8"
    for table, method in [(TABLES[0], "mixture"), *((table, "agrapa") for table in TABLES[:3])]:
        assert table.cell(run, law, method) == published(text, table)[law][heading(method)]
