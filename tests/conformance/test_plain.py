"""Plain data for JSON: exact numbers of any length, nothing that JSON has no word for."""

import json
import math
import sys
from fractions import Fraction

import numpy as np
import pytest

from truemean.conformance import Verdict
from truemean.conformance.plain import plain
from truemean.oracle import Approx
from truemean.oracle.exact import exact_text

LONG = Fraction(-(7**6000), 8**6000)


@pytest.fixture
def unlimited():
    """Python writes integers of any length."""
    limit = sys.get_int_max_str_digits()
    sys.set_int_max_str_digits(0)
    yield
    sys.set_int_max_str_digits(limit)


def test_an_exact_number_is_whole_beyond_pythons_limit():
    with pytest.raises(ValueError, match="4300 digits"):
        str(LONG)
    assert len(exact_text(LONG)) > 10_000


def test_a_long_exact_number_is_right(unlimited):
    for value in (LONG, Fraction(0), Fraction(-3), Fraction(-1197, 16384), 7**6000):
        assert exact_text(value) == str(value)


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (Fraction(1, 3), {"exact": "1/3", "value": 1 / 3}),
        (Fraction(10**400), {"exact": "1" + "0" * 400, "value": None}),
        ((Fraction(1), 2), [{"exact": "1", "value": 1.0}, 2]),
        (Approx(0.25, 1e-17), {"value": 0.25, "error": 1e-17}),
        ({1: (None, True, "p/q")}, {"1": [None, True, "p/q"]}),
        ([math.nan, math.inf, -math.inf, np.float64(0.5), np.int64(3)], [None, None, None, 0.5, 3]),
        ((2**53, 2**53 + 1), [2**53, {"exact": str(2**53 + 1), "value": float(2**53)}]),
        (Verdict.BIASED, "BIASED"),
    ],
)
def test_every_value_has_a_plain_form(value, expected):
    assert plain(value) == expected
    json.dumps(plain(value), allow_nan=False)


def test_a_long_number_is_written():
    assert json.loads(json.dumps(plain({"n": 10**5000, "p": LONG})))["n"]["exact"] == "1" + "0" * 5000
