"""The catalogue: what each plan says of itself, the paper's equations, and agreement of all number systems."""

from __future__ import annotations

from fractions import Fraction
from inspect import Parameter

import numpy as np
import pytest
from tests.oracle.catalogue_cases import FEW, MANY, OF_A_SCENE, PARAMS, PLACED, cases, pixels_of

from truemean.errors import InputError, InputTypeError, NeedsScene, UnknownName
from truemean.oracle import Approx, Pixel, derive
from truemean.oracle.plans import catalogue, find_plan
from truemean.oracle.scene import load_scene

SIGNATURES = {
    "kirk-arvo": {"n": 4, "eps": 0},
    "kirk-arvo-unbiased": {"area": "1/4", "p": 4, "n1": 4, "n2": 16, "eps": 0},
    "discard-pilot": {"p": 4, "n1": 4, "n2": 16, "eps": 0},
    "two-stage-pooled": {"n": 4, "m": 12, "eps": 0},
    "fixed": {"n": 4},
    "sequential": {"start": 4, "step": 1, "most": 64, "eps": "1/20"},
    "hierarchical": {"n": 4, "depth": 2, "eps": 0},
    "centre-first": {"n": 4},
    "centre-and-grid": {"grid": 3},
}
CASES = cases(lambda name, short, pixel: True)
RESULTS = ("bias", "expectation", "variance", "mse", "cost", "oracle_calls")
SCALARS = {name: X for name, X in (FEW | MANY).items() if X.channels is None}


def channels(value):
    return value if isinstance(value, tuple) else (value,)


# -- what a plan says of itself --------------------------------------------------------------------


def test_the_catalogue_is_a_mapping_of_the_plans_of_the_paper():
    assert list(catalogue) == list(SIGNATURES)
    assert len(catalogue) == len(SIGNATURES)
    assert all(name in catalogue and catalogue[name].name == name for name in SIGNATURES)
    assert "kirk_arvo" not in catalogue


@pytest.mark.parametrize("name", SIGNATURES)
def test_a_plan_has_its_declared_signature(name):
    parameters = catalogue[name].signature.parameters
    assert {n: p.default for n, p in parameters.items()} == SIGNATURES[name]
    assert {p.kind for p in parameters.values()} == {Parameter.POSITIONAL_OR_KEYWORD}


@pytest.mark.parametrize("name", SIGNATURES)
def test_a_plan_tells_its_source_and_why_it_is_what_it_is(name):
    plan = catalogue[name]
    assert all(len(text.split()) >= 3 for text in (plan.source, plan.why, plan.doc))
    assert isinstance(plan.unbiased, bool)
    assert plan.doc.endswith(".")


@pytest.mark.parametrize(("name", "params", "pixel"), cases(lambda name, short, pixel: bool(catalogue[name].unbiased)))
def test_a_plan_called_unbiased_has_no_bias_anywhere(name, params, pixel):
    derivation = derive(catalogue[name], pixel, **params)
    assert set(channels(derivation.bias)) == {0}
    assert derivation.expectation == pixel.mean


@pytest.mark.parametrize(
    "name", [name for name in SIGNATURES if not catalogue[name].unbiased and name not in OF_A_SCENE]
)
def test_a_plan_called_biased_is_biased_somewhere(name):
    biases = {short: derive(catalogue[name], X, **PARAMS[name][0]).bias for short, X in pixels_of(name).items()}
    assert biases["constant"] == 0
    assert all(any(channels(biases[s])) for s in ("white on 1/8", "three tones", "signed", "rare bright", "colours"))
    assert biases["white on 1/8"] == -biases["white on 7/8"] < 0


# -- the paper's equations -------------------------------------------------------------------------


@pytest.mark.parametrize("n", [1, 2, 4, 9, 32])
@pytest.mark.parametrize("short", SCALARS)
def test_equations_4_to_6(short, n):
    X = SCALARS[short]
    pairs = [(w**n, value) for value, w in X.law.items()]
    easy = sum(power for power, _ in pairs)
    expected = sum(power * value for power, value in pairs) / easy

    derivation = derive(catalogue["kirk-arvo"], X, n=n)
    first, *others = derivation.paths
    assert first.probability == easy  # Eq. 4
    assert first.bias / first.probability + X.mean == expected  # Eq. 5
    assert derivation.bias == sum(power * (value - X.mean) for power, value in pairs)  # Eq. 6
    assert sum((path.probability for path in others), easy) == 1
    assert {path.bias for path in others} <= {0}
    assert derivation.oracle_calls == 1 - easy


def test_the_decisions_of_figure_1_are_told_in_the_words_of_the_plan():
    easy, hard = derive(catalogue["kirk-arvo"], Pixel.two("1/8"), eps="1/3").paths
    assert (easy.decisions, hard.decisions) == (("range(S1) <= 1/3",), ("range(S1) > 1/3",))


def test_figure_2_takes_the_regions_that_the_pixel_declares_and_splits_it_where_there_are_none():
    whole, parted = Pixel.two("13/32"), FEW["two regions"]
    assert whole.law == parted.law
    plan = catalogue["kirk-arvo-unbiased"]
    easy = Fraction(7, 8) ** 4 + Fraction(1, 8) ** 4
    assert derive(plan, parted).cost == 4 + easy * 4 + (1 - easy) * 16
    assert derive(plan, parted, area="2/3").variance == derive(plan, parted).variance
    scattered = Fraction(19, 32) ** 4 + Fraction(13, 32) ** 4
    derivation = derive(plan, whole)
    assert derivation.cost == 4 + scattered * 4 + (1 - scattered) * 16
    # Independent parts: the variance of R's mean over p draws, and that of the rest's over n1 or n2.
    spread = whole.variance / 16 * Fraction(1, 4)
    spread += whole.variance * Fraction(9, 16) * (scattered / 4 + (1 - scattered) / 16)
    assert derivation.variance == spread
    assert derive(plan, whole, area="2/3").variance != spread


def test_a_pixel_of_four_regions_is_split_too():
    X = PLACED["tile (4, 0)"]
    assert len(X.regions) == 4
    plan = catalogue["kirk-arvo-unbiased"]
    assert derive(plan, X).variance == derive(plan, Pixel(X.law)).variance


def test_a_hierarchy_spends_its_samples_where_the_quadrants_differ():
    row = [load_scene("fig5").pixel(x, 10) for x in range(12, 20)]
    costs = {X: derive(catalogue["hierarchical"], X).cost for X in row}
    assert {cost for X, cost in costs.items() if len(X.law) == 1} == {8}
    varied = [cost for X, cost in costs.items() if len(X.law) > 1]
    assert varied
    assert min(varied) > 8


def test_a_hierarchy_of_depth_0_needs_no_scene_and_a_deeper_one_says_so():
    plan, X = catalogue["hierarchical"], Pixel.two("1/8")
    derivation = derive(plan, X, depth=0)
    assert (derivation.bias, derivation.cost, derivation.variance) == (0, 8, X.variance / 4)
    with pytest.raises(NeedsScene, match="needs a scene"):
        derive(plan, X)


@pytest.mark.parametrize("X", load_scene("tile").pixels().values())
@pytest.mark.parametrize(
    ("name", "params", "samples"),
    [
        ("centre-first", {"n": 1}, 1),
        ("centre-first", {"n": 4}, 4),
        ("centre-and-grid", {}, 10),
        ("centre-and-grid", {"grid": 2}, 5),
    ],
)
def test_a_sample_at_the_centre_has_its_share_of_the_bias(name, params, samples, X):
    derivation = derive(catalogue[name], X, **params)
    assert derivation.bias == (X.at("1/2", "1/2") - X.mean) / samples
    assert derivation.cost == samples


def test_the_noise_around_the_centre_is_that_of_the_drawn_samples():
    X = load_scene("tile").pixel(4, 0)
    assert derive(catalogue["centre-first"], X).variance == X.variance * 3 / 16
    cells = sum(cell.variance for cell in X.grid(3))
    assert derive(catalogue["centre-and-grid"], X).variance == cells / 100
    assert derive(catalogue["centre-first"], X, n=1).variance == 0


@pytest.mark.parametrize("name", ["centre-first", "centre-and-grid"])
def test_a_centre_needs_a_scene(name):
    with pytest.raises(NeedsScene, match="needs a scene"):
        derive(catalogue[name], Pixel.two("1/8"))


# -- every number system agrees with every other ---------------------------------------------------


@pytest.mark.parametrize(("name", "params", "pixel"), CASES)
def test_floats_hold_their_bound(name, params, pixel):
    exact = derive(catalogue[name], pixel, **params)
    floats = derive(catalogue[name], pixel, arithmetic="float64", **params)
    for result in RESULTS:
        for number, approx in zip(channels(getattr(exact, result)), channels(getattr(floats, result)), strict=True):
            assert isinstance(approx, Approx)
            assert abs(Fraction(approx.value) - number) <= Fraction(approx.error), result
    for path, rough in zip(exact.paths, floats.paths, strict=True):
        assert path.decisions == rough.decisions
        assert abs(Fraction(rough.probability.value) - path.probability) <= Fraction(rough.probability.error)
    assert (exact.rows, exact.level) == (floats.rows, floats.level)


@pytest.mark.parametrize(("name", "params", "pixel"), CASES)
def test_floats_hold_a_relative_tolerance(name, params, pixel):
    exact = derive(catalogue[name], pixel, **params)
    floats = derive(catalogue[name], pixel, arithmetic="float64", rtol=1e-12, **params)
    for result in ("bias", "variance", "cost"):
        for number, approx in zip(channels(getattr(exact, result)), channels(getattr(floats, result)), strict=True):
            assert abs(Fraction(approx.value) - number) <= abs(number) * Fraction(1e-12), result


MOVABLE = cases(lambda name, short, pixel: name not in OF_A_SCENE and not pixel.regions)


def moved(pixel):
    """Weights that are not the pixel's own."""
    parts = [3 + (5 * i) % 7 for i in range(len(pixel.values))]
    return {value: Fraction(part, sum(parts)) for value, part in zip(pixel.values, parts, strict=True)}


@pytest.mark.parametrize(("name", "params", "pixel"), MOVABLE)
def test_other_weights_give_what_their_own_pixel_gives(name, params, pixel):
    law = moved(pixel)
    there, direct = derive(catalogue[name], pixel, **params).at(law), derive(catalogue[name], Pixel(law), **params)
    assert [getattr(there, r) for r in RESULTS] == [getattr(direct, r) for r in RESULTS]


@pytest.mark.parametrize(("name", "params", "pixel"), MOVABLE)
def test_weights_as_arrays_give_what_each_pixel_gives(name, params, pixel):
    laws = [dict(zip(pixel.values, pixel.weights, strict=True)), moved(pixel)]
    arrays = np.array([[float(law[value]) for law in laws] for value in pixel.values])
    there = derive(catalogue[name], pixel, **params).at(arrays)
    for number, law in enumerate(laws):
        direct = derive(catalogue[name], Pixel(law), **params)
        for result in ("bias", "variance", "cost", "oracle_calls"):
            # Plain floats without a bound: rounding is relative to the largest value and size around
            unit = 1e-12 * max(1.0, *(abs(float(v)) for value in pixel.values for v in channels(value))) ** 2
            found = [float(plane[number]) for plane in channels(getattr(there, result))]
            wanted = [float(exact) for exact in channels(getattr(direct, result))]
            assert found == pytest.approx(wanted, rel=1e-9, abs=unit), result


# -- finding a plan --------------------------------------------------------------------------------


def test_a_plan_is_found_by_name_module_and_file(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text("def my_plan(X, n=3):\n    '''The mean of n.'''\n    return X.draw(n).mean()\n")
    assert find_plan("fixed") is catalogue["fixed"]
    assert find_plan("truemean.oracle.plans.fixed:fixed") is catalogue["fixed"]
    mine = find_plan(f"{file}:my_plan")
    assert (mine.name, mine.doc, mine.unbiased) == ("my-plan", "The mean of n.", None)
    assert derive(mine, Pixel.two("1/8")).cost == 3


@pytest.mark.parametrize(
    ("name", "error", "words"),
    [
        ("kirkarvo", UnknownName, "no plan is called 'kirkarvo'; did you mean kirk-arvo or"),
        ("zzz", UnknownName, "no plan is called 'zzz'; known: kirk-arvo, "),
        ("", UnknownName, "no plan is called ''"),
        ("absent.py:f", InputError, "absent.py"),
        ("absent_module:f", InputError, "write file.py:function or module:function"),
        ("truemean.oracle.plans.fixed:fixd", UnknownName, "did you mean fixed"),
        ("math:pi", InputTypeError, "not a function of X"),
    ],
)
def test_a_plan_that_is_not_there_is_answered_with_the_way_out(name, error, words):
    with pytest.raises(error) as caught:
        find_plan(name)
    assert words in str(caught.value)
