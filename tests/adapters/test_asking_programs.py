"""exec: programs that ask for their samples are judged exactly, or sampled where they ask too often.

Sampled replicates are those of fixed seeds; a verdict on them is wrong with a probability of 1 %.
"""

from fractions import Fraction

import numpy as np
import pytest
from tests.adapters.compiled import Compiled
from tests.adapters.programs import program
from tests.command_line import call

from truemean.adapters import asking, load
from truemean.conformance import Verdict, check_subject, judge
from truemean.errors import SubjectError, TooManyPaths, Unsupported
from truemean.oracle import Pixel, derive
from truemean.oracle.plans import catalogue

PIXELS = {"eighth": Pixel.two("1/8"), "half": Pixel.two("1/2")}
COLOUR = Pixel({(1, 0, 0): "1/2", (0, 1, 0): "1/4", (0, 0, 1): "1/4"})
TONES = Pixel({0: "1/2", Fraction(1, 2): "1/4", 1: "1/4"})
ASKS = "def greet(): say('truemean 1 asks')\n"


@pytest.fixture(scope="session")
def compiled(tmp_path_factory):
    return Compiled(tmp_path_factory.mktemp("asking"))


def asks(folder, changes="", **limits):
    return program(folder, ASKS + changes, **limits)


def judged(subject, pixels=PIXELS):
    return judge(load(subject), pixels=pixels, tolerance=0, budget=40, seed=7)


@pytest.mark.parametrize("X", [*PIXELS.values(), TONES, Pixel({3: 1})])
def test_the_rust_example_has_exactly_the_law_of_figure_1(compiled, X):
    subject = load(f"exec:{compiled.program('estimator.rs')}")
    found, derived = subject.exact(X), derive(catalogue["kirk-arvo"], X, n=4)
    assert (found.law, found.cost, found.paths) == (derived.distribution(), 4, len(X.values) ** 4)


def test_the_bias_of_the_paper_is_found_in_the_rust_example(compiled):
    report = judge(load(f"exec:{compiled.program('estimator.rs')}"), pixels=PIXELS, tolerance="1%")
    eighth, half = report.cases
    assert (eighth.verdict, half.verdict) == (Verdict.BIASED, Verdict.CONFORMS)
    assert (eighth.exact_bias, half.exact_bias) == (Fraction(-1197, 16384), 0)
    assert eighth.replicates == half.replicates == 0


def test_it_is_what_the_same_code_is_in_python(tmp_path):
    def estimate(draw):
        if draw.pick(["1/4", 0, "3/4"]) == 2:
            return (draw() + draw()) / 2
        return draw(3).mean()

    changes = """
def pick(*weights): say(f"pick {' '.join(weights)}"); return int(read())
def three(): say("draw 3"); return [values[int(index)] for index in read().split()]
def ask(): return (draw() + draw()) / 2 if pick("1/4", "0", "3/4") == 2 else sum(three()) / 3
"""
    subject = load(asks(tmp_path, changes))
    for X in (PIXELS["eighth"], TONES):
        assert subject.exact(X) == asking(estimate).exact(X)
        assert np.array_equal(subject.run(X, np.arange(40)), asking(estimate).run(X, np.arange(40)))
        assert np.array_equal(subject.costs(X, np.arange(40)), asking(estimate).costs(X, np.arange(40)))
    check_subject(subject, pixels=PIXELS)


def test_colours_are_numbers_side_by_side(tmp_path):
    changes = """
rows = []
def ask(): say("draw 1"); return " ".join(map(str, rows[int(read())][1:]))
"""
    law = load(asks(tmp_path, changes)).exact(COLOUR).law
    assert law == dict(zip(COLOUR.values, COLOUR.weights, strict=True))
    with pytest.raises(SubjectError, match=r"printed 'estimate 0.5' when its samples were .*: expected estimate and 3"):
        load(asks(tmp_path, "def ask(): draw(); return 0.5")).exact(COLOUR)


@pytest.mark.parametrize("order", ["blocks", "all"])
def test_order_may_make_no_difference(tmp_path, order):
    changes = "def ask(): say('draw 7'); return sum(values[int(i)] for i in read().split()) / 7"
    symmetric, plain = (load(asks(tmp_path, changes, **by)).exact(TONES) for by in ({"order": order}, {}))
    assert (symmetric.law, symmetric.cost) == (plain.law, plain.cost)
    assert (symmetric.paths < 100, plain.paths) == (True, 3**7)


# -- what asks too often ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("ask", "limits", "why"),
    [
        ("return sum(draw() for _ in range(8)) / 8", {"paths": 50}, "more than paths=50 runs would be needed"),
        (
            "n = 1\n    while draw() == 0: n += 1\n    return 1 / n",
            {},
            "it asks for more than 4096 samples on one path",
        ),
    ],
)
def test_too_many_paths_are_sampled(tmp_path, ask, limits, why):
    report = judged(asks(tmp_path, f"def ask():\n    {ask}", **limits))
    assert report.notes[-2:] == tuple(f"{name}: judged by sampled replicates, not exactly: {why}" for name in PIXELS)
    assert Verdict.BROKEN not in {case.verdict for case in report.cases}
    assert min(case.replicates for case in report.cases) >= 16


def test_one_that_asks_for_ever_is_broken(tmp_path):
    subject = asks(tmp_path, "def ask():\n    while True: draw()", timeout=0.5)
    report = judged(subject, {"half": PIXELS["half"]})
    assert "half: judged by sampled replicates, not exactly" in report.notes[-1]
    assert "samples and gave no estimate in 0.5 s" in report.cases[0].reason
    assert report.verdict is Verdict.BROKEN


# -- what is broken ---------------------------------------------------------------------------------

HALF = "\ndef ask(ever=ask): return ever() if weights[0] != 0.5 else draw()"


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        ("draw(); say('more light'); read()", ["printed 'more light' when its samples were 0: expected draw N, pick"]),
        ("say('draw'); read()", ["printed 'draw' before it asked for a sample"]),
        ("say('draw -1'); read()", ["printed 'draw -1'"]),
        ("say('draw \u00b2'); read()", ["expected draw N"]),
        ("say(''); read()", ["printed ''"]),
        ("say('pick 1 1'); read()", ["asks for a choice of weights", "which are no probabilities: let them sum to 1"]),
        ("say('pick 0.5 -0.5 1'); read()", ["no probabilities"]),
        ("say('pick heads tails'); read()", ["no probabilities"]),
        ("draw(); return float('nan')", ["returned nan, not a number, when its samples were 0"]),
        (
            "draw(); return 'bright'",
            ["printed 'estimate bright' when its samples were 0: expected estimate and 1 number"],
        ),
        ("return draw() + draw() * time.monotonic()", ["same samples", "depend on nothing but its answers"]),
        (
            "say(f'draw {1 + time.monotonic_ns() % 7}'); return len(read().split())",
            ["nothing but its answers|no others"],
        ),
        ("return draw() and os._exit(3)", ["ended with exit code 3, when its samples were 1"]),
        ("return draw() and os.abort()", ["was killed by signal SIGABRT, when its samples were 1"]),
        ("return draw() and time.sleep(100)", ["did not answer within 0.5 s, when its samples were 1"]),
        ("say('draw 1\\ndraw 1')", ["printed more than a line"]),
    ],
)
def test_what_breaks_on_some_path_is_told_and_the_next_pixel_is_judged(tmp_path, ask, words):
    report = judged(asks(tmp_path, f"def ask():\n    {ask}{HALF}", timeout=0.5))
    broken, other = report.cases
    assert (broken.verdict, other.verdict) == (Verdict.BROKEN, Verdict.CONFORMS)
    assert [word for word in words if not any(way in broken.reason for way in word.split("|"))] == []
    assert broken.replicates == 0
    assert other.exact_bias == 0


def test_it_is_asked_anew_after_its_conversation_was_cut(tmp_path):
    subject = load(
        asks(tmp_path, "def ask(): return sum(draw() for _ in range(3 if weights[0] == 0.5 else 9))", paths=10)
    )
    for _ in range(2):
        with pytest.raises(TooManyPaths):
            subject.enumerate(PIXELS["eighth"])
        assert subject.exact(PIXELS["half"]).paths == 8


def test_what_it_declines_is_skipped(tmp_path):
    subject = asks(tmp_path, "def pixel(): say('unsupported too dark' if weights[0] > 0.5 else 'ok')")
    with pytest.raises(Unsupported, match=r"^too dark$"):
        load(subject).exact(PIXELS["eighth"])
    assert judged(subject).skipped == {"eighth": "too dark"}


def test_the_command_line_tells_exact_numbers(compiled, tmp_path):
    arguments = ("--tolerance", "1%", "--pixels", "0:7/8,1:1/8")
    code, out, _ = call("judge", f"exec:{compiled.program('estimator.rs')}", *arguments)
    assert (code, "E[ξ] - I = -1197/16384" in " ".join(out.split())) == (1, True)
    assert call("judge", asks(tmp_path), *arguments)[0] == 0
    assert call("judge", asks(tmp_path, "def ask(): say('x')"), *arguments)[0] == 4
