"""A subject in several processes: the same replicates, and a crash or a hang that ends no run."""

import pickle
import signal
from fractions import Fraction

import numpy as np
import pytest
from tests.command_line import call

from truemean.adapters import load
from truemean.adapters.crew import Crew
from truemean.conformance import Verdict, check_subject, judge
from truemean.conformance.replicates import Seeds
from truemean.errors import InputError, TooManyPaths, UnknownName, Unsupported
from truemean.oracle.pixel import Pixel
from truemean.oracle.scene import load_scene
from truemean.subject import PlainPixel

EIGHTH, HALF = Pixel.two("1/8"), Pixel.two("1/2")
PIXELS = {"eighth": EIGHTH, "half": HALF}
COLOUR = Pixel({(1, 0, 0): "1/2", (0, 1, 0): "1/4", (0, 0, 1): "1/4"})
SEEDS = np.arange(1000) * 10**9
BAD = int(Seeds(seed=7, bits=53, stream=0, streams=2).take(50, 51)[0])
CODE = f"""
import os, signal, sys, time
from fractions import Fraction
import numpy as np
from truemean.adapters.reference import KirkArvo, uniforms
from truemean.errors import Unsupported
from truemean.subject import Costed, PlainPixel

print("noise of the subject")
honest = KirkArvo().run

def at(action):
    def f(pixel, seeds):
        if {BAD} in seeds:
            action()
        return honest(pixel, seeds)
    return f

def ends():
    print("no light", file=sys.stderr, flush=True)
    os._exit(3)

def fails():
    raise ValueError("no light")

exits, crashes = at(ends), at(lambda: os.kill(os.getpid(), signal.SIGSEGV))
hangs, raises = at(lambda: time.sleep(1000)), at(fails)

def broken(pixel, seeds):
    fails()

def costed(pixel, seeds):
    return Costed(honest(pixel, seeds), seeds % 7)

def declines(pixel, seeds):
    raise Unsupported("no colours")

def forks(pixel, draw):
    return (draw() + draw()) / 2

class Image:
    \"\"\"Two pixels of one render; it counts its renders.\"\"\"

    declares = ("fixed", {{"n": 1}})
    notes = ("a render of two pixels",)
    versions = {{"image": "1.5"}}
    seed_bits = 40
    rendered = 0

    def pixels(self):
        return self.own

    def __init__(self, bright="3/4"):
        from truemean.oracle.pixel import Pixel
        self.own = {{"left": Pixel.two("1/4"), "right": Pixel.two(Fraction(bright))}}

    def run_many(self, pixels, seeds):
        assert all(pixel is self.own["left"] or pixel is self.own["right"] for pixel in pixels)
        Image.rendered += 1
        return np.column_stack([self.run(pixel, seeds) for pixel in pixels])

    def run(self, pixel, seeds):
        return (uniforms(seeds, pixel is self.own["right"], 1)[:, 0] < float(pixel.mean)) * 1.0

    def costs(self, pixel, seeds):
        return seeds % 5 + (pixel is self.own["right"])
"""


class PixelThatStays(PlainPixel):
    """One that holds what no other process can have."""

    def __reduce__(self):
        raise TypeError("it stays")


@pytest.fixture
def code(tmp_path):
    """``python:FILE:`` of the subjects above."""
    (tmp_path / "subjects_of_crew.py").write_text(CODE)
    return f"python:{tmp_path / 'subjects_of_crew.py'}:"


def assert_same(one, other, pixel, seeds=SEEDS):
    assert np.array_equal(one.run(pixel, seeds), other.run(pixel, seeds))
    costs, others = one.costs(pixel, seeds), other.costs(pixel, seeds)
    assert (costs is None and others is None) or np.array_equal(costs, others)


@pytest.mark.parametrize("subject", ["plan:kirk-arvo?n=4", "python:truemean.adapters.reference:KirkArvo?n=8"])
def test_two_processes_give_the_replicates_of_one(subject):
    alone, crew = load(subject), load(subject, jobs=2)
    assert isinstance(crew, Crew)
    for pixel in (*PIXELS.values(), COLOUR):
        assert_same(alone, crew, pixel)
        assert_same(alone, crew, pixel, SEEDS[:3])


@pytest.mark.parametrize("name", ["costed", "exits"])
def test_functions_of_a_file_too(code, name, capfd):
    alone, crew = load(code + name), load(code + name, jobs=2)
    assert_same(alone, crew, PIXELS["eighth"])
    assert capfd.readouterr().out.count("noise of the subject") == 2


def test_the_shares_are_run_in_processes_of_their_own(code):
    crew = load(f"{code}Image", jobs=2)
    left, right = crew.pixels().values()
    crew.run_many([left, right], SEEDS)
    assert crew.rendered == 0
    assert [host.child.starts for host in crew._hosts] == [1, 1]
    crew.run_many([left, right], SEEDS + 1)
    assert [host.child.starts for host in crew._hosts] == [1, 1]


def test_one_render_of_many_pixels_is_shared_too(code):
    alone, crew = load(f"{code}Image?bright=5/8"), load(f"{code}Image?bright=5/8", jobs=2)
    pairs = [list(each.pixels().values()) for each in (alone, crew)]
    assert np.array_equal(alone.run_many(pairs[0], SEEDS), crew.run_many(pairs[1], SEEDS))
    for mine, theirs in zip(*pairs, strict=True):
        assert np.array_equal(alone.costs(mine, SEEDS), crew.costs(theirs, SEEDS))
        assert np.array_equal(alone.run(mine, SEEDS), crew.run(theirs, SEEDS))
    check_subject(crew)


def test_what_a_subject_says_of_itself_it_says_here(code):
    crew = load(f"{code}Image", jobs=2)
    assert (crew.declares, crew.notes, crew.seed_bits) == (("fixed", {"n": 1}), ("a render of two pixels",), 40)
    assert not hasattr(crew, "range")
    assert not hasattr(load("plan:kirk-arvo", jobs=1), "run_many")
    report = judge(crew, tolerance="10%", seed=7)
    assert (report.verdict, str(report.plan_check)) == (Verdict.CONFORMS, "FOLLOWS")
    assert report.versions["image"] == "1.5"
    assert [case.pixel for case in report.cases] == ["left", "right"]


def test_a_verdict_does_not_depend_on_jobs():
    reports = [
        judge(load("plan:kirk-arvo?n=4", jobs=jobs), pixels=PIXELS, tolerance="1%", budget=3000, seed=7)
        for jobs in (0, 1, 2)
    ]
    assert reports[0].cases == reports[1].cases == reports[2].cases


def test_code_that_asks_is_judged_exactly_with_jobs_too(code):
    crew = load(f"{code}forks", jobs=2)
    assert crew.exact(PIXELS["half"]).paths == 4
    assert_same(load(f"{code}forks"), crew, PIXELS["half"], SEEDS[:40])
    with pytest.raises(TooManyPaths):
        load(f"{code}forks?paths=3", jobs=2).exact(PIXELS["half"])


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("exits", f"at seed {BAD} it ended with exit code 3; standard error: no"),
        ("crashes", f"at seed {BAD} it was killed by signal SIGSEGV"),
        ("hangs", f"at seed {BAD} it did not answer within 1 s"),
        ("raises", "crashed with ValueError: no light ("),
    ],
)
def test_the_seed_at_which_it_breaks_is_named_and_the_next_pixel_is_judged(code, name, words):
    crew = load(code + name, jobs=2, timeout=1)
    broken, other = judge(crew, pixels=PIXELS, tolerance=0, budget=120, seed=7).cases
    assert (broken.verdict, other.verdict) == (Verdict.BROKEN, Verdict.INCONCLUSIVE)
    assert words in broken.reason
    assert (broken.replicates > 0, other.replicates >= 120) == (True, True)


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs POSIX signals")
def test_an_interrupt_waits_for_nobody(code):
    def interrupt(*_):
        raise KeyboardInterrupt

    crew = load(f"{code}hangs", jobs=2, timeout=10**6)
    crew.run(EIGHTH, SEEDS)
    before = signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, 0.5)
    try:
        with pytest.raises(KeyboardInterrupt):
            crew.run(EIGHTH, [*SEEDS, BAD])
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert_same(load(f"{code}hangs"), crew, EIGHTH)


def test_what_it_declines_stays_declined(code):
    with pytest.raises(Unsupported, match=r"^no colours$"):
        load(f"{code}declines", jobs=2).run(COLOUR, SEEDS)


def test_the_command_line_runs_jobs(code):
    arguments = ("--tolerance", "5%", "--pixels", "0:7/8,1:1/8", "--seed", "7")
    assert call("judge", "plan:kirk-arvo?n=4", *arguments, "--jobs", "2")[0] == 1
    assert call("judge", f"{code}broken", *arguments, "--jobs", "1", "--budget", "16")[0] == 4


@pytest.mark.parametrize("jobs", [-1, 1.5, "2"])
def test_a_number_of_processes_is_whole(jobs):
    with pytest.raises(InputError, match=f"jobs={jobs!r} is no number of processes"):
        load("plan:kirk-arvo", jobs=jobs)


def test_what_can_not_be_loaded_is_told_before_any_process_is_started(code):
    with pytest.raises(UnknownName, match="'darkens'"):
        load(f"{code}darkens", jobs=2)
    with pytest.raises(InputError, match="is more than 1"):
        load(f"{code}Image?bright=2", jobs=2)


@pytest.mark.parametrize(
    ("plan", "X"),
    [
        ("kirk-arvo-unbiased", Pixel.from_regions({"R": ("1/4", HALF), "rest": ("3/4", EIGHTH)})),
        ("hierarchical?n=2", load_scene("tile").pixel(4, 0)),
    ],
)
def test_a_plan_is_sent_what_else_a_pixel_has(plan, X):
    assert_same(load(f"plan:{plan}"), load(f"plan:{plan}", jobs=2), X)


def test_a_pixel_that_can_not_be_sent_is_sent_as_values_and_weights():
    pixel = PixelThatStays((Fraction(0), Fraction(1)), (Fraction(1, 2), Fraction(1, 2)))
    with pytest.raises(TypeError):
        pickle.dumps(pixel)
    subject = "python:truemean.adapters.reference:KirkArvo"
    assert_same(load(subject), load(subject, jobs=2), pixel)
