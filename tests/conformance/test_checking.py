"""Each promise of an estimator is broken by a liar planted here, and kept by those that are right.

Seeds are fixed; a right estimator breaks a promise by chance once in a million.
"""

from __future__ import annotations

import itertools
import json

import numpy as np
import pytest
from tests.command_line import call, directory
from tests.conformance.estimators import COLOUR, EIGHTH, Together, draws, fixed, kirk_arvo, uniforms

from truemean.adapters import asking, load
from truemean.adapters.planted import SUBJECTS
from truemean.conformance import check_subject
from truemean.errors import InputError, InputTypeError, SubjectError, Unsupported
from truemean.oracle.pixel import Pixel
from truemean.subject import Costed, Exact

HALF = {"half": Pixel.two("1/2")}
PROMISES = (
    NUMBERS := "estimates and costs are numbers, one for each seed",
    RANGE := "estimates are finite and in their range, those of a pixel of one value exact",
    SAME := "the same seeds give the same estimates",
    ALONE := "a replicate depends on its own seed alone",
    MANY := "run_many gives what run gives",
    VARIED := "different seeds give different estimates",
    NEIGHBOURS := "neighbouring seeds are not correlated",
    BITS := "all bits of a seed are used",
    LAW := "estimates are outcomes of the exact law",
    ITSELF := "what it says of itself can be read",
    DECLARED := "what is declared can be read",
    TEXTS := "versions and notes are text",
    SOME := "some pixel is supported",
)


def with_(function=fixed, **attributes):
    """The function as an object with these attributes."""

    class Subject:
        def run(self, pixel, seeds):
            return function(pixel, seeds)

    return type("Subject", (Subject,), attributes)()


def broken(subject, **options):
    """The promises that are broken, with what was seen."""
    checks = check_subject(subject, strict=False, **options)
    assert {check.promise for check in checks} <= set(PROMISES)
    assert all(check.seen for check in checks if check.kept is False)
    return {check.promise: check.seen for check in checks if check.kept is False}


# -- right estimators ---------------------------------------------------------------------------------


def pooled(draw):
    S = draw(2)
    return (np.concatenate([S, draw(2)]) if np.ptp(S, axis=0).any() else S).mean(axis=0)


RIGHT = {
    "function": fixed,
    "one seed": lambda pixel, seed: fixed(pixel, np.array([seed]))[0],
    "many at once": Together(fixed),
    "with costs": lambda pixel, seeds: Costed(fixed(pixel, seeds), np.full(len(seeds), 8)),
    "with costs, one seed": lambda pixel, seed: Costed(fixed(pixel, np.array([seed]))[0], 8),
    "no costs": with_(costs=lambda self, pixel, seeds: None),
    "says it all": with_(
        declares=("fixed", {"n": 8}), versions={"a": "1"}, notes=("A note.",), range=lambda self, pixel: (-1, 2)
    ),
    "predicts": with_(predicts=lambda self, pixel: {"cost": 8}),
    "few": with_(replicates=400),
    "8 bits": with_(seed_bits=8),
    "asks": asking(pooled, paths=1000),
}


@pytest.mark.parametrize("name", RIGHT)
def test_right_estimators_keep_every_promise(name):
    checks = check_subject(RIGHT[name])
    assert [check for check in checks if check.kept is not True] == []
    assert len(checks) >= (8 if name in ("few", "8 bits") else 9)


@pytest.mark.parametrize(
    "subject",
    [
        *(f"plan:{plan}" for plan in ("kirk-arvo", "kirk-arvo-unbiased?n2=8", "discard-pilot?n2=8", "fixed")),
        "plan:sequential?most=8",
        *(f"python:truemean.adapters.planted:{subject.__name__}" for subject in SUBJECTS),
        "python:truemean.adapters.planted:TwoStage?fault=pilot-kept",
        "python:truemean.adapters.reference:KirkArvoUnbiased",
    ],
)
def test_our_own_keep_every_promise(subject):
    checks = check_subject(load(subject))
    assert [check for check in checks if check.kept is not True] == []


@pytest.mark.parametrize("weight", ["1/64", "1/8", "1/2", "63/64"])
@pytest.mark.parametrize("estimator", [fixed, kirk_arvo, lambda X, seeds: draws(X, seeds, 1)[:, 0]], ids=range(3))
def test_no_pixel_is_so_dark_that_a_right_estimator_is_blamed(estimator, weight):
    for n in (2, 16, 64, 200):
        assert broken(estimator, pixels=Pixel.two(weight), replicates=n) == {}


@pytest.mark.parametrize(
    "subject",
    [
        with_(lambda pixel, seeds: np.full(len(seeds), 0.25), deterministic=True),
        lambda pixel, seeds: np.full(len(seeds), 0.5),  # exact, whatever the seed
    ],
    ids=["says so", "exact"],
)
def test_what_has_no_randomness_may_be_so(subject):
    checks = check_subject(subject, pixels=HALF)
    assert {check.promise for check in checks if check.kept is None} == {VARIED}
    assert NEIGHBOURS not in {check.promise for check in checks}


# -- liars ------------------------------------------------------------------------------------------------


def ignoring(pixel, seeds):
    return np.full(len(seeds), 0.25)


def counting():
    calls = itertools.count()
    return lambda pixel, seeds: fixed(pixel, np.array([next(calls) for _ in seeds]))


def by_batch(pixel, seeds):
    return fixed(pixel, seeds[0] + np.arange(len(seeds)))


def by_place(pixel, seeds):
    return fixed(pixel, seeds + 1000 * np.arange(len(seeds)))


def antithetic(pixel, seeds):
    u = np.where(seeds % 2, 1 - uniforms(seeds - 1, 1)[:, 0], uniforms(seeds, 1)[:, 0])
    values, weights = pixel.arrays()
    return np.where(u < weights[0], values[0], values[-1])


def sweeping(pixel, seeds, step=0.0123):
    """A generator whose first number creeps along with its seed."""
    values, weights = pixel.arrays()
    return values[np.searchsorted(weights.cumsum()[:-1], seeds * step % 1, side="right")]


class Disagreeing(Together):
    def run_many(self, pixels, seeds):
        return super().run_many(pixels, seeds + 1)


def at_times(value):
    def liar(pixel, seeds):
        return np.where(seeds % 5, fixed(pixel, seeds), value)

    return liar


def in_a_batch(pixel, seeds):
    return fixed(pixel, seeds) if len(seeds) == 1 else fixed(pixel, seeds[1:])


def crashing_on(pixel, seeds):
    return 1 / bool((seeds % 7).all()) and fixed(pixel, seeds)


def one_off(pixel, seeds):
    return fixed(pixel, seeds) + 1e-6 * (len(pixel.weights) == 1)


def lawful(law):
    return lambda self, pixel: Exact(law, 1, 2, "2 paths")


def raising(self, *_):
    raise RuntimeError("no such thing")


LIARS = {
    "ignores its seed": (ignoring, {VARIED: "all are one"}),
    "global counter": (counting(), {SAME: " for seed ", ALONE: " for seed "}),
    "depends on its batch": (by_batch, {ALONE: "half: "}),
    "depends on its place": (by_place, {ALONE: "half: "}),
    "same for neighbours": (lambda X, seeds: fixed(X, seeds // 8), {NEIGHBOURS: "half: correlation 0."}),
    "creeps with its seed": (sweeping, {NEIGHBOURS: "half: correlation 0."}),
    "crawls": (lambda X, seeds: sweeping(X, seeds, 0.001), {NEIGHBOURS: "half: correlation 1.000", BITS: "half: "}),
    "antithetic": (antithetic, {NEIGHBOURS: "half: correlation -0."}),
    "32 bits": (lambda X, seeds: fixed(X, seeds & 0xFFFFFFFF), {BITS: "declare seed_bits = 32"}),
    "shape": (lambda X, seeds: fixed(X, seeds)[:, None], {NUMBERS: "half: returned ndarray of shape (1, 1)"}),
    "shape of a batch": (in_a_batch, {NUMBERS: "shape (63,) for 64 seeds"}),
    "None": (lambda X, seeds: None, {NUMBERS: "of shape () for 1 seeds"}),
    "crash": (raising, {NUMBERS: "RuntimeError: no such thing"}),
    "crash on some seeds": (crashing_on, {NUMBERS: "ZeroDivisionError"}),
    "NaN": (at_times(np.nan), {RANGE: "half returned NaN for seed"}),
    "infinite": (at_times(np.inf), {RANGE: "half returned inf for seed"}),
    "out of range": (at_times(1.5), {RANGE: "half returned 1.5 for seed"}),
    "out of its own range": (with_(range=lambda self, X: (0, 0.625)), {RANGE: "outside its range [0.0, 0.625]"}),
    "costs negative": (with_(costs=lambda self, X, seeds: -seeds), {NUMBERS: "gave [-"}),
    "costs NaN": (
        with_(costs=lambda self, X, seeds: seeds * np.nan),
        {NUMBERS: "gave [nan] of shape (1,) for 1 seeds"},
    ),
    "costs in all": (
        with_(costs=lambda self, X, seeds: 8),
        {NUMBERS: "gave [8.] of shape () for 1 seeds: return a number from 0 up for each"},
    ),
    "costs by name": (
        with_(costs=lambda self, X, seeds: ["many"] * len(seeds)),
        {NUMBERS: "costs(pixel, seeds) crashed with"},
    ),
    "costs of a function": (lambda X, seeds: Costed(fixed(X, seeds), -1 - 0 * seeds), {NUMBERS: "gave [-1."}),
    "plan unknown": (with_(declares="fixd"), {ITSELF: "no plan is called 'fixd'"}),
    "plan with other parameters": (with_(declares=("fixed", {"m": 8})), {DECLARED: "'m'"}),
    "plan that fails": (with_(declares=("fixed", {"n": 0})), {DECLARED: "n=0"}),
    "prediction": (with_(predicts=lambda self, X: {"man": 1}), {DECLARED: "return a mapping"}),
    "prediction crashes": (with_(predicts=raising), {DECLARED: "predicts(pixel) crashed with RuntimeError"}),
    "costs in a batch": (with_(costs=lambda self, X, seeds: seeds[:1]), {NUMBERS: "of shape (1,) for 64 seeds"}),
    "range crashes": (with_(range=raising), {ITSELF: "range(pixel) crashed with RuntimeError"}),
    "range without the mean": (with_(range=lambda self, X: (0, 0.1)), {ITSELF: "does not contain its true mean"}),
    "seed_bits": (with_(seed_bits=64), {ITSELF: "seed_bits=64"}),
    "replicates": (with_(replicates=0), {ITSELF: "replicates=0"}),
    "versions": (with_(versions={"renderer": 1.2}), {TEXTS: "1.2 is no text"}),
    "versions in a list": (with_(versions=["1.2"]), {TEXTS: "versions=['1.2'] is a mapping"}),
    "notes": (with_(notes="a sentence"), {TEXTS: "notes='a sentence' a tuple"}),
    "notes that are none": (with_(notes=(None,)), {TEXTS: "None is no text"}),
    "declines everything": (
        lambda X, seeds: (_ for _ in ()).throw(Unsupported("no")),
        {SOME: "every pixel is declined"},
    ),
    "exact of another code": (
        with_(exact=lawful({0: "1/2", 1: "1/2"})),
        {LAW: "is none"},
    ),
    "exact crashes": (with_(exact=raising), {LAW: "exact(pixel) crashed with RuntimeError"}),
    "exact is no law": (with_(exact=lawful({0: "1/2"})), {LAW: "sum to 1/2"}),
}


@pytest.mark.parametrize("name", LIARS)
def test_a_liar_is_found_out(name):
    subject, words = LIARS[name]
    found = broken(subject, pixels=HALF)
    assert list(found) == list(words)
    assert {promise: word in found[promise] for promise, word in words.items()} == dict.fromkeys(words, True)


@pytest.mark.parametrize(
    "name", ["global counter", "depends on its batch", "same for neighbours", "32 bits", "costs NaN", "plan unknown"]
)
def test_a_liar_is_found_out_on_the_standard_pixels(name):
    assert list(broken(LIARS[name][0])) == list(LIARS[name][1])


def test_run_many_that_disagrees_with_run():
    assert list(broken(Disagreeing(fixed))) == [MANY]


def test_a_constant_pixel_that_is_off():
    seen = broken(one_off, pixels=HALF | {"constant": Pixel({"1/3": 1})})
    assert list(seen) == [RANGE]
    assert "constant returned 0.333334" in seen[RANGE]


def test_seeds_of_32_bits_may_be_declared():
    subject = with_(lambda X, seeds: fixed(X, seeds & 0xFFFFFFFF), seed_bits=32)
    assert broken(subject, pixels=HALF) == {}
    assert BITS not in {check.promise for check in check_subject(subject, pixels=HALF)}


def test_half_as_many_neighbours_alike_take_more_replicates():
    def pairs(X, seeds):
        return fixed(X, seeds // 2)

    assert list(broken(pairs, pixels=HALF, replicates=256)) == [NEIGHBOURS]


def test_pixels_that_are_declined_are_left_out():
    def scalars_only(pixel, seeds):
        if pixel.channels:
            raise Unsupported("no colours")
        return fixed(pixel, seeds)

    assert broken(scalars_only, pixels=HALF | COLOUR) == {}
    assert list(broken(scalars_only, pixels=COLOUR)) == [SOME]


def test_pixels_of_as_many_channels_are_looked_at_together():
    subject = Together(fixed)
    check_subject(subject)
    assert {count for count, _ in subject.calls} == {2}  # one pixel alone needs no run_many


def test_all_that_is_broken_is_raised_together():
    subject = with_(by_batch, versions=3)
    with pytest.raises(SubjectError) as raised:
        check_subject(subject, pixels=EIGHTH)
    assert str(raised.value).startswith(
        "2 of 9 promises are broken: a replicate depends on its own seed alone: eighth:"
    )
    assert "; versions and notes are text: versions=3 is" in str(raised.value)


@pytest.mark.parametrize("replicates", [0, 1, -4, 2.5, "64", None])
def test_replicates_that_can_not_be_meant(replicates):
    with pytest.raises(InputError, match=f"replicates={replicates!r}"):
        check_subject(fixed, replicates=replicates)


def test_what_is_no_estimator():
    with pytest.raises(InputTypeError, match="subject=7"):
        check_subject(7)
    with pytest.raises(InputTypeError, match="pixels=3"):
        check_subject(fixed, pixels=3)
    with pytest.raises(InputTypeError, match="wrap it"):
        check_subject(lambda pixel, draw: draw())


# -- from the command line ----------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path, monkeypatch):
    yield from directory(tmp_path, monkeypatch)


def test_the_command_prints_a_table_and_ends_with_0_where_all_is_kept(folder):
    code, out, err = call("check", "python:subjects_of_cli.py:noisy", "--pixels", "0:1/2,1:1/2")
    assert (code, "Traceback" in err) == (0, False)
    assert SAME in out
    assert out.splitlines()[-1] == "9 of 9 promises are kept: python:subjects_of_cli.py:noisy"


def test_the_command_ends_with_4_where_a_promise_is_broken(folder):
    code, out, _ = call("check", "python:subjects_of_cli.py:nan", "--pixels", "0:1/2,1:1/2", "--replicates", "32")
    assert code == 4
    assert "returned NaN for seed" in " ".join(out.split())
    assert "promises are kept: python:subjects_of_cli.py:nan" in out.splitlines()[-1]
    code, out, _ = call("check", "python:subjects_of_cli.py:nan", "--pixels", "0:1/2,1:1/2", "--json", "-")
    checks = {check["promise"]: check for check in json.loads(out)["checks"]}
    assert (code, checks[RANGE]["kept"]) == (4, False)
    assert call("check", "python:subjects_of_cli.py:Broken")[0] == 4


def test_what_could_not_be_looked_at_is_no_broken_promise(folder):
    code, out, _ = call("check", "python:subjects_of_cli.py:exact", "--json", "-")
    kept = {check["promise"]: check["kept"] for check in json.loads(out)["checks"]}
    assert (code, kept[VARIED], kept[SAME]) == (0, None, True)
