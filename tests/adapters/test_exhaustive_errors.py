"""Code that asks for its samples and breaks its word, or asks for too much."""

from __future__ import annotations

import itertools
import math
import sys
import time
from contextlib import suppress
from fractions import Fraction
from random import Random

import numpy as np
import pytest

from truemean.adapters import answers, asking
from truemean.adapters.exhaustive import ORDERS
from truemean.errors import InputError, SubjectError, TooManyPaths, Unsupported
from truemean.oracle import Pixel

COLOUR = Pixel({(1, 0, 0): "5/8", (0, "1/2", 0): "1/4", (0, 0, 3): "1/8"})


def fixed(draw):
    return draw(4).mean()


def discard_pilot(draw):
    return draw(4 if np.ptp(draw(2)) else 2).mean()


# -- code that breaks its word ------------------------------------------------------------------------


UNSYMMETRIC = {
    "first of a block": (lambda draw: draw(3)[0], ("blocks", "all")),
    "pilot": (discard_pilot, ("all",)),
    "weighted": (lambda draw: draw() + 2 * draw(), ("all",)),
    "asks for more": (lambda draw: draw(2)[0] and draw(), ("blocks",)),
    "by chance": (lambda draw: draw(2)[draw.pick(["1/2", "1/2"])], ("blocks", "all")),
}


@pytest.mark.parametrize(
    ("kind", "order"), [(kind, order) for kind, (_, orders) in UNSYMMETRIC.items() for order in orders]
)
def test_code_that_is_not_symmetric_but_says_so(kind, order):
    estimator = asking(UNSYMMETRIC[kind][0], order=order)
    with pytest.raises(SubjectError, match="order=sequence"):
        estimator.exact(Pixel({0: "1/2", 1: "1/4", 4: "1/4"}))


def counting():
    calls = itertools.count()
    return {
        "random": lambda draw: draw() + Random().random(),
        "rarely": lambda draw: draw() + (Random().random() < 0.5),
        "time": lambda draw: draw() + time.perf_counter_ns() % 1000,
        "counter": lambda draw: draw() + draw() + next(calls) % 2,
        "every tenth": lambda draw: sum(draw() for _ in range(4)) + (next(calls) % 10 == 9),
        "number": lambda draw: float(draw(1 + next(calls) % 2)[0]),
        "fewer": lambda draw: float(draw(9 - next(calls) % 2)[0]),
        "kind": lambda draw: draw() if next(calls) % 2 else draw.pick(["7/8", "1/8"]),
        "choice": lambda draw: draw.pick(["7/8", "1/8"] if next(calls) % 2 else ["1/2", "1/2"]),
    }


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("kind", counting())
def test_code_that_depends_on_more_than_its_answers(kind, order):
    words = "for the same samples|asked for .* samples where it asked|asks for something else|same samples in another"
    with pytest.raises(SubjectError, match=words):
        asking(counting()[kind], order=order).exact(Pixel.two("1/8"))


def test_code_that_later_asks_for_less():
    calls = itertools.count()
    with pytest.raises(SubjectError, match="asked for 6 samples where it asked for 7 before"):
        asking(lambda draw: sum(draw() for _ in range(7 if next(calls) < 121 else 6))).exact(Pixel.two("1/8"))


def test_another_order_may_be_answered_by_other_requests():
    def code(draw):
        first = draw()
        return first + (draw() if first else 4 * draw(2).sum())

    X = Pixel(dict.fromkeys(range(8), "1/8"))
    assert asking(code, order="all").exact(X).law == asking(code).exact(X).law


BREAKING = [
    (lambda draw: 1 / (1 - draw() * draw()), ["crashed with ZeroDivisionError", "when its samples were 1, 1"]),
    (lambda draw: math.nan if draw() + draw() == 2 else 0, ["returned nan, not a number, when its samples were 1, 1"]),
    (lambda draw: math.inf, ["returned inf, not a number, before it asked for a sample"]),
    (lambda draw: None, ["returned None, not a number"]),
    (lambda draw: "0.5", ["returned '0.5', not a number"]),
    (lambda draw: [draw()], ["returned [0.0], not a number, when its samples were 0"]),
    (lambda draw: np.array([draw()]), ["returned array([0.]), not a number"]),
    (lambda draw: 10**400, ["not a number"]),
    (lambda draw: draw(-1), ["asks for -1 samples"]),
    (lambda draw: draw.pick(["1/2", "1/3"]), ["('1/2', '1/3')", "let them sum to 1"]),
    (lambda draw: draw.pick([]), ["let them sum to 1"]),
    (lambda draw: draw.pick(["1/0", 1]), ["let them sum to 1"]),
    (lambda draw: draw.coin(1.5), ["let them sum to 1"]),
    (lambda draw: sys.exit(3), ["crashed with SystemExit: 3"]),
]


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("number", range(len(BREAKING)))
def test_what_breaks_names_the_answers_that_led_there(number, order):
    code, words = BREAKING[number]
    with pytest.raises(SubjectError) as raised:
        asking(code, order=order).exact(Pixel.two("1/8"))
    assert [word for word in words if word not in str(raised.value)] == []


@pytest.mark.parametrize("returned", [0.5, [1, 2], "abc", None, [[1, 2, 3]] * 3, [1, 2, math.nan]])
def test_a_colour_is_as_many_numbers_as_channels(returned):
    with pytest.raises(SubjectError, match="3 numbers"):
        asking(lambda draw: returned).exact(COLOUR)


def test_a_choice_is_told_as_one():
    with pytest.raises(SubjectError, match="when its samples were choice 1, 0"):
        asking(lambda draw: 1 // (1 - draw.pick(["1/2", "1/2"]) * (draw() + 1))).exact(Pixel.two("1/8"))


def test_long_paths_are_told_shortened():
    with pytest.raises(SubjectError, match=r"samples were (0, ){20}\.\.\.$"):
        asking(lambda draw: draw(50).sum() + math.nan, paths=10, order="blocks").exact(Pixel.two("1/8"))


def test_declining_a_pixel_is_passed_on():
    def declines(pixel, draw):
        raise Unsupported("no such pixel")

    with pytest.raises(Unsupported, match="no such pixel"):
        asking(declines).exact(Pixel.two("1/8"))


def test_code_may_change_its_samples():
    def in_place(draw):
        total = draw()
        total += draw()
        return total / 2

    law = asking(in_place).exact(Pixel({(1, 0): "1/2", (0, 1): "1/2"})).law
    assert law == {(0, 1): Fraction(1, 4), (1, 0): Fraction(1, 4), (Fraction(1, 2), Fraction(1, 2)): Fraction(1, 2)}


# -- too much -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("order", "enough"), [("sequence", 16), ("blocks", 6), ("all", 6)])
def test_the_budget_of_paths(order, enough):
    X = Pixel.two("1/8")
    assert asking(fixed, order=order, paths=enough).exact(X).paths == enough
    estimator = asking(fixed, order=order, paths=str(enough - 1))
    for _ in range(2):  # computed, and then known
        with pytest.raises(TooManyPaths, match=f"more than paths={enough - 1} runs"):
            estimator.exact(X)


@pytest.mark.parametrize("order", ORDERS)
def test_a_large_block_is_known_to_be_too_much_at_once(order):
    calls = []

    def code(draw):
        calls.append(1)
        return draw(100).mean()

    with pytest.raises(TooManyPaths):
        asking(code, order=order).exact(Pixel(dict.fromkeys(range(8), "1/8")))
    assert len(calls) <= 20


def test_long_paths_count_for_more_than_one():
    runs = []

    def code(draw):
        runs.append(1)
        return sum(draw() for _ in range(1000)) / 1000

    with pytest.raises(TooManyPaths, match="more than 32 samples a path would be needed for each of paths=1000 runs"):
        asking(code, paths=1000).exact(Pixel.two("1/8"))
    assert len(runs) < 200
    until_white = asking(lambda draw: next((i for i in range(999) if draw()), 999) / 999)
    assert until_white.exact(Pixel.two("1/8")).paths == 1000


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("then", [lambda: 0.0, lambda: 1 / 0], ids=["goes on", "crashes"])
def test_code_that_catches_the_end_of_its_run(then, order):
    def swallows(draw):
        with suppress(Exception):
            while True:
                draw()
        return then()

    with pytest.raises(TooManyPaths, match="more than 4096 samples on one path"):
        asking(swallows, order=order, paths=10**6).exact(Pixel.two("1/8"))


@pytest.mark.parametrize("order", ORDERS)
def test_code_that_may_ask_without_end(order, monkeypatch):
    def first_white(draw):
        return next(i for i in itertools.count() if draw()) % 2

    def endless(draw):
        while True:
            draw()

    X = Pixel.two("1/2")
    for code in (first_white, endless):
        with pytest.raises(TooManyPaths, match=r"more than 4096 samples on one path|more than paths="):
            asking(code, order=order).exact(X)
    # Sampled, it ends with probability 1, or else is stopped.
    estimates = asking(first_white, order=order).run(X, np.arange(2000))
    assert abs(estimates.mean() - 1 / 3) < 4.5 * math.sqrt(2 / 9 / 2000)
    monkeypatch.setattr(answers, "ENDLESS", 1000)
    with pytest.raises(SubjectError, match="more than 1000 samples for one replicate: let it end"):
        asking(endless, order=order).run(X, np.arange(1))


def test_what_breaks_while_sampled_names_the_answers():
    with pytest.raises(SubjectError, match="returned nan, not a number, when its samples were 1"):
        asking(lambda draw: math.nan if draw() else 0).run(Pixel.two("1/8"), np.arange(100))


@pytest.mark.parametrize("paths", [0, -3, 1.5, "many", None])
def test_a_budget_that_can_not_be_meant(paths):
    with pytest.raises(InputError, match=f"paths={paths!r}"):
        asking(fixed, paths=paths)


@pytest.mark.parametrize("order", ["none", "", None, "sequences"])
def test_an_order_that_can_not_be_meant(order):
    with pytest.raises(InputError, match=f"order={order!r}: .* sequence, blocks, all"):
        asking(fixed, order=order)
