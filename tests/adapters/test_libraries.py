"""lib: functions of shared libraries, judged exactly where they ask for their samples; and all that breaks them.

Sampled replicates are those of fixed seeds; a verdict on them is wrong with a probability of 1 %.
"""

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
from tests.adapters.compiled import Compiled
from tests.command_line import call

from truemean.adapters import asking, load
from truemean.conformance import Verdict, check_subject, judge, standard_pixels
from truemean.conformance.replicates import Seeds
from truemean.errors import InputError, SubjectError, TooManyPaths, UnknownName
from truemean.oracle import Pixel, derive
from truemean.oracle.plans import catalogue

EIGHTH, HALF, ONE = Pixel.two("1/8"), Pixel.two("1/2"), Pixel({3: 1})
TONES = Pixel({0: "1/2", Fraction(1, 2): "1/3", 1: "1/6"})
COLOUR = Pixel({(1, 0, 0): "1/2", (0, 1, 0): "1/4", (0, 0, 1): "1/4"})
PIXELS = {"eighth": EIGHTH, "half": HALF}
STANDARD = standard_pixels()
GREY = {name: X for name, X in STANDARD.items() if X.channels is None}
BAD = int(Seeds(seed=7, bits=53, stream=0, streams=2).take(50, 51)[0])

SEEDED = """
#include <stdio.h>
#include <stdlib.h>
TRUEMEAN_EXPORT int32_t f(const truemean_pixel *pixel, int64_t count, const uint64_t *seeds, double *estimates, double *costs) {
    (void)costs;
    for (int64_t i = 0; i < count; i++) {
        estimates[i] = (double)((seeds[i] * 0x9E3779B97F4A7C15u) >> 11) * 0x1p-53 < pixel->weights[1];
        EACH
    }
    return 0;
}
"""
ASKING = """
#include <stdlib.h>
#include <string.h>
#include <time.h>
TRUEMEAN_EXPORT int32_t f(const truemean_pixel *pixel, truemean_source *source, double *estimate) {
    (void)pixel; (void)source;
    CODE
    return 0;
}
"""
MEAN = "*estimate = 0; for (int i = 0; i < 4; i++) *estimate += truemean_sample(pixel, source) / 4;"
REJECTION = "while (source->draw(source) == 0) {} *estimate = 1;"
names = (f"code{number}" for number in itertools.count())


@pytest.fixture(scope="session")
def compiled(tmp_path_factory):
    return Compiled(tmp_path_factory.mktemp("libraries"))


@pytest.fixture
def seeded(compiled):
    """The subject of a function of seeds that does ``each`` besides."""
    return lambda each, options="": f"lib:{compiled.functions(SEEDED.replace('EACH', each), next(names))}:f{options}"


@pytest.fixture
def asks(compiled):
    """The subject of a function of answers, with its loop compiled or not."""

    def subject(code, options="", *, loop=True):
        text = ASKING.replace("CODE", code) + ("TRUEMEAN_ASKS(f)\n" if loop else "")
        told = "&".join(filter(None, ["" if loop else "asks=1", options]))
        return f"lib:{compiled.functions(text, next(names))}:f{'?' if told else ''}{told}"

    return subject


def judged(subject, tolerance=0, pixels=PIXELS):
    return judge(load(subject), pixels=pixels, tolerance=tolerance, budget=120, seed=7)


# -- examples ---------------------------------------------------------------------------------------


def test_the_c_example_has_exactly_the_law_of_figure_1(compiled):
    subject = load(f"lib:{compiled.library('fig1.c')}:fig1")
    for X in (EIGHTH, HALF, ONE, STANDARD["quarter"], STANDARD["three-tones"]):
        found, derived = subject.exact(X), derive(catalogue["kirk-arvo"], X, n=4)
        assert (found.law, found.cost, found.paths) == (derived.distribution(), 4, len(X.values) ** 4)


def test_the_bias_of_the_paper_is_found_in_the_c_example(compiled):
    report = judge(load(f"lib:{compiled.library('fig1.c')}:fig1"), tolerance="1%", declares=("kirk-arvo", {"n": 4}))
    biases = {name: derive(catalogue["kirk-arvo"], X, n=4).bias for name, X in GREY.items()}
    assert [case.pixel for case in report.cases if abs(case.exact_bias - biases[case.pixel]) > Fraction(1, 2**50)] == []
    biased = {name for name, bias in biases.items() if abs(bias) > Fraction(1, 100)}
    assert {case.pixel for case in report.cases if case.verdict is Verdict.BIASED} == biased
    assert {case.pixel for case in report.cases if case.verdict is Verdict.CONFORMS} == biases.keys() - biased
    assert next(case.exact_bias for case in report.cases if case.pixel == "eighth") == Fraction(-1197, 16384)
    assert [*report.skipped] == ["equal-luminance"]
    assert str(report.plan_check) == "FOLLOWS"


def test_the_cpp_example_is_as_biased_as_its_plan_and_tells_its_costs(compiled):
    plan = ("two-stage-pooled", {"n": 4, "m": 12, "eps": 0})
    report = judge(load(f"lib:{compiled.library('two_stage.cpp')}:two_stage"), tolerance="5%", declares=plan, seed=7)
    verdicts = {case.pixel: case.verdict for case in report.cases}
    biased = {"eighth", "quarter", "three-quarters", "seven-eighths"}
    assert {name for name, verdict in verdicts.items() if verdict is Verdict.BIASED} == biased
    assert {name for name, verdict in verdicts.items() if verdict is Verdict.CONFORMS} == verdicts.keys() - biased
    assert str(report.plan_check) == "FOLLOWS"
    eighth = next(case for case in report.cases if case.pixel == "eighth")
    cost = derive(catalogue[plan[0]], EIGHTH, **plan[1]).cost
    assert abs(eighth.cost - cost) < 4.5 * 6 / math.sqrt(eighth.replicates)


def test_the_rust_example_is_unbiased(compiled):
    report = judge(load(f"lib:{compiled.library('fixed.rs')}:fixed"), tolerance="5%", seed=7)
    assert (report.verdict, len(report.cases)) == (Verdict.CONFORMS, 13)


@pytest.mark.parametrize("example", ["fig1.c:fig1", "two_stage.cpp:two_stage", "fixed.rs:fixed"])
def test_examples_keep_the_promises_of_an_estimator(compiled, example):
    file, _, symbol = example.partition(":")
    check_subject(load(f"lib:{compiled.library(file)}:{symbol}"), pixels=GREY)


@pytest.mark.parametrize(
    ("example", "code", "words"),
    [
        ("fig1.c:fig1", 1, "E[ξ] - I = -1197/16384"),
        ("two_stage.cpp:two_stage", 1, "BIASED"),
        ("fixed.rs:fixed", 0, "CONFORMS"),
        ("fixed.rs:broken", 4, ""),
    ],
)
def test_the_command_line_judges_examples(compiled, example, code, words):
    file, _, symbol = example.partition(":")
    arguments = (f"lib:{compiled.library(file)}:{symbol}", "--tolerance", "5%", "--pixels", "0:7/8,1:1/8")
    found, out, _ = call("judge", *arguments)
    assert (found, words in " ".join(out.split())) == (code, True)


# -- exact ------------------------------------------------------------------------------------------


def test_unbiased_code_has_no_bias_on_any_standard_pixel(asks):
    """Zero false alarms at tolerance 0: a bias that is left is that of floats."""
    report = judge(load(asks(MEAN)), pixels=GREY, tolerance=0)
    assert {case.verdict for case in report.cases} == {Verdict.CONFORMS}
    assert max(abs(case.exact_bias) for case in report.cases) < 1e-16
    assert report.notes[0].startswith("all verdicts are exact")


CODES = {
    "mean": MEAN,
    "two stages": """
    int n = 2; double sum = truemean_sample(pixel, source), x = truemean_sample(pixel, source);
    if (x != sum) n = 5;
    sum += x;
    for (int i = 2; i < n; i++) sum += truemean_sample(pixel, source);
    *estimate = sum / n;""",
    "until black": "int n = 1; while (n < 6 && source->draw(source)) n++; *estimate = 1.0 / n;",
    "nothing": "*estimate = 0.25;",
}


@pytest.mark.parametrize("code", CODES)
def test_the_compiled_loop_is_the_one_in_python(asks, code):
    compiled_loop, plain_loop = (load(asks(CODES[code], loop=loop)) for loop in (True, False))
    for X in (EIGHTH, TONES, STANDARD["eight-tones"], ONE, Pixel({0: 0, 1: "2/3", 2: "1/3"})):
        assert compiled_loop.exact(X) == plain_loop.exact(X)


def test_counts_are_enough_where_order_makes_no_difference(asks):
    by_counts, by_sequence = (load(asks(MEAN, option)) for option in ("order=all", "order=sequence"))
    for X in (EIGHTH, TONES, STANDARD["quarter"]):
        one, other = by_counts.exact(X), by_sequence.exact(X)
        assert (one.law, one.cost) == (other.law, other.cost)
        assert one.paths < other.paths
    with pytest.raises(SubjectError, match="say order=sequence"):
        load(asks("*estimate = truemean_sample(pixel, source); truemean_sample(pixel, source);", "order=all")).exact(
            TONES
        )


def test_many_values_and_many_samples_are_left_to_the_loop_in_python(asks):
    many = Pixel({i: Fraction(1, 80) for i in range(80)})
    assert load(asks("*estimate = truemean_sample(pixel, source);")).exact(many).law == dict(
        zip(many.values, many.weights, strict=True)
    )
    long = "*estimate = 0; for (int i = 0; i < 200; i++) *estimate += truemean_sample(pixel, source); *estimate /= 200;"
    assert load(asks(long)).exact(ONE).law == {3: 1}
    few = "int n = 1; while (n < 140 && source->draw(source) == 0) n++; *estimate = n;"
    found = load(asks(few)).exact(STANDARD["eight-tones"])
    assert (found.paths, sum(found.law.values())) == (7 * 139 + 1, 1)


def test_choices_of_its_own_are_answered(asks):
    def estimate(draw):
        return draw() if draw.pick(["1/4", "3/4"]) else 0.5

    code = "double odds[] = {0.25, 0.75}; *estimate = source->pick(source, 2, odds) ? truemean_sample(pixel, source) : 0.5;"
    for loop in (True, False):
        subject = load(asks(code, loop=loop))
        assert subject.exact(TONES) == asking(estimate).exact(TONES)
        assert np.array_equal(subject.run(TONES, np.arange(50)), asking(estimate).run(TONES, np.arange(50)))


def test_colours_are_tuples(asks):
    code = "memcpy(estimate, pixel->values + 3 * source->draw(source), 3 * sizeof *estimate);"
    for loop in (True, False):
        assert load(asks(code, loop=loop)).exact(COLOUR).law == dict(zip(COLOUR.values, COLOUR.weights, strict=True))


@pytest.mark.parametrize("loop", [True, False])
def test_too_many_paths_are_sampled(asks, loop):
    report = judged(asks(MEAN, "paths=9", loop=loop))
    assert report.notes[-1] == "half: judged by sampled replicates, not exactly: more than paths=9 runs would be needed"
    assert report.verdict is Verdict.INCONCLUSIVE
    assert {case.cost for case in report.cases} == {4}


@pytest.mark.parametrize("loop", [True, False])
@pytest.mark.parametrize(
    "code",
    [
        REJECTION,
        "while (source->draw(source) != pixel->count - 1) {} *estimate = 1;",
        "double odds[] = {0.5, 0.5}; while (source->draw(source) == 0 || source->pick(source, 2, odds) == 0) {} *estimate = 1;",
    ],
)
def test_a_rejection_loop_ends(asks, code, loop):
    subject = load(asks(code, "timeout=20", loop=loop))
    for X in (EIGHTH, TONES):
        with pytest.raises(TooManyPaths, match="more than 4096 samples on one path"):
            subject.exact(X)
        assert set(subject.run(X, np.arange(20))) == {1}
    assert subject.costs(EIGHTH, np.arange(20)).mean() > 2


# -- what is broken ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("each", "words"),
    [
        ("abort();", f"at seed {BAD} it was killed by signal SIGABRT"),
        ("*(volatile int *)0 = 1;", f"at seed {BAD} it was killed by signal SIGSEGV"),
        ("exit(0);", f"at seed {BAD} it ended with exit code 0"),
        ('fputs("no light", stderr); _Exit(3);', f"at seed {BAD} it ended with exit code 3; standard error: no light"),
        ("for (volatile int on = 1; on;) {}", f"at seed {BAD} it did not answer within 1 s"),
        ("return 7;", "returned the status 7: return 0 for success"),
        ("estimates[i] = 0.0 / (double)(seeds[i] - seeds[i]);", f"returned NaN for seed {BAD}"),
        ("estimates[i] = 2;", f"returned 2.0 for seed {BAD}, outside its range"),
    ],
)
def test_the_seed_at_which_it_breaks_is_named(seeded, each, words):
    broken, other = judged(seeded(f"if (seeds[i] == {BAD}u) {{ {each} }}", "?timeout=1")).cases
    assert (broken.verdict, other.verdict) == (Verdict.BROKEN, Verdict.INCONCLUSIVE)
    assert words in broken.reason
    assert (broken.replicates > 0, other.replicates >= 120) == (True, True)


@pytest.mark.parametrize("loop", [True, False])
@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("abort();", "was killed by signal SIGABRT"),
        ("for (volatile int on = 1; on;) {}", "did not answer within 1 s"),
        ("return 7;", "returned the status 7"),
        ("*estimate = 0.0 / (*estimate - *estimate);", "returned nan, not a number, when its samples were 1"),
        ("double odds[] = {1, 1}; source->pick(source, 2, odds);", "no probabilities: let them sum to 1"),
        ("static int runs; *estimate = ++runs;", "for the same samples: let it depend on nothing but its answers"),
        ("static int runs; if (++runs % 3 == 0) source->draw(source);", "|no others|nothing but its answers"),
    ],
)
def test_what_breaks_on_some_path_is_told_and_the_next_pixel_is_judged(asks, code, words, loop):
    code = f"*estimate = truemean_sample(pixel, source); if (*estimate > 0 && pixel->weights[0] != 0.5) {{ {code} }}"
    if "static" in code:
        code = code.replace("*estimate > 0 && ", "")
    broken, other = judged(asks(code, "timeout=1", loop=loop)).cases
    assert (broken.verdict, other.verdict) == (Verdict.BROKEN, Verdict.CONFORMS)
    assert any(way in broken.reason for way in words.split("|") if way), broken.reason


def test_hidden_chance_is_noticed_by_the_compiled_loop(asks):
    code = "*estimate = truemean_sample(pixel, source); if (*estimate > 0) *estimate = rand() % 1000 / 1000.0;"
    with pytest.raises(SubjectError, match="different estimates for the same samples"):
        load(asks(code)).exact(EIGHTH)


def test_what_it_declines_is_skipped(seeded, asks):
    declines = "if (pixel->weights[0] == 0.5) return TRUEMEAN_UNSUPPORTED;\n"
    for subject in (seeded(declines), asks(declines + MEAN), asks(declines + MEAN, loop=False)):
        report = judged(subject)
        assert report.skipped == {"half": "the function does not support this pixel"}
        assert [case.pixel for case in report.cases] == ["eighth"]


def test_costs_are_told_or_not(seeded):
    silent, telling = load(seeded("")), load(seeded("costs[i] = (double)i;"))
    assert silent.costs(EIGHTH, [1, 2]) is None
    assert telling.costs(EIGHTH, [1, 2]).tolist() == [0, 1]


def test_what_it_prints_disturbs_nothing(seeded, asks):
    subject = load(seeded('puts("much to say"); fflush(stdout); getchar();'))
    assert subject.run(EIGHTH, np.arange(20_000)).shape == (20_000,)


@pytest.mark.parametrize(
    ("subject", "error", "words"),
    [
        ("lib:./no_such.so:f", InputError, ["there is no file './no_such.so'", "lib:path/to/libmine.so:f"]),
        ("lib:fig1", InputError, ["'fig1' is not PATH:SYMBOL", "lib:./libmine.so:my_estimator"]),
        ("lib:{text}:f", SubjectError, ["is no shared library that can be loaded"]),
        ("lib:{fig1}:fig2", SubjectError, ["has no function 'fig2'", 'in C++ as extern "C"']),
        ("lib:{fig1}:fig2?asks=1", SubjectError, ["has no function 'fig2'"]),
        ("lib:{fig1}:fig1?asks=maybe", InputError, ["asks='maybe'", "say 1"]),
        ("lib:{fig1}:fig1?paths=0", InputError, ["paths='0'"]),
        ("lib:{fig1}:fig1?order=none", InputError, ["order='none'", "sequence, blocks, all"]),
        ("lib:{fig1}:fig1?timeout=-1", InputError, ["timeout='-1'", "positive number of seconds"]),
        ("lib:{fig1}:fig1?total=soon", InputError, ["total='soon'"]),
        ("lib:{fig1}:fig1?path=9", UnknownName, ["option of adapter lib", "'path'"]),
    ],
)
def test_bad_libraries(compiled, tmp_path, subject, error, words):
    text = tmp_path / "text.so"
    text.write_text("no library")
    subject = subject.format(text=text, fig1=compiled.library("fig1.c"))
    with pytest.raises(error) as raised:
        load(subject)
    assert [word for word in words if word not in str(raised.value)] == []
    assert call("judge", subject, "--tolerance", "1%")[0] == (4 if error is SubjectError else 2)
