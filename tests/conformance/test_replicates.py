"""Seeds are fresh, and what is not an array of estimates is refused with a reason."""

from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest

from truemean.conformance.replicates import Seeds, run
from truemean.errors import InputError, NeedsScene, SubjectError, Unsupported

SEEDS = Seeds(seed=1, bits=53, stream=0, streams=1).take(0, 4)


@pytest.mark.parametrize(("bits", "streams"), [(1, 1), (3, 2), (8, 3), (10, 1), (16, 7)])
def test_the_streams_together_are_a_permutation_of_all_seeds(bits, streams):
    parts = [Seeds(5, bits, stream, streams) for stream in range(streams)]
    seeds = np.concatenate([part.take(0, part.capacity) for part in parts])
    assert sorted(seeds.tolist()) == list(range(2**bits))


@pytest.mark.parametrize("bits", [31, 32, 53, 63])
def test_seeds_are_distinct_in_range_and_the_same_in_any_batches(bits):
    parts = [Seeds(9, bits, stream, 5) for stream in range(5)]
    seeds = np.concatenate([part.take(0, 20_000) for part in parts])
    assert seeds.dtype == np.int64
    assert np.unique(seeds).size == seeds.size
    assert 0 <= seeds.min() <= seeds.max() < 2**bits
    pieces = [parts[3].take(start, start + 100) for start in range(0, 20_000, 100)]
    assert np.array_equal(np.concatenate(pieces), parts[3].take(0, 20_000))


def test_another_seed_gives_other_seeds():
    first, second = (Seeds(seed, 53, 0, 1).take(0, 1000) for seed in (0, 1))
    assert not set(first.tolist()) & set(second.tolist())


def test_more_seeds_than_there_are_is_an_error():
    with pytest.raises(InputError, match="seed_bits=4 gives 16 seeds"):
        Seeds(0, 4, 0, 1).take(0, 17)


@pytest.mark.parametrize("bits", [0, 64, 32.0])
def test_bits_that_no_seed_has(bits):
    with pytest.raises(InputError, match=f"seed_bits={bits}"):
        Seeds(0, bits, 0, 1)


def subject(answer, **more):
    def answers(pixel, seeds):
        if isinstance(answer, BaseException):
            raise answer
        return answer

    return SimpleNamespace(run=answers, **more)


def test_what_an_estimator_may_return():
    estimates, costs = run(subject([1, 2, 3, Fraction(1, 4)]), [None], None, SEEDS)
    assert estimates.tolist() == [[[1, 2, 3, 0.25]]]
    assert costs is None
    estimates, _ = run(subject(np.arange(12, dtype=np.float32).reshape(4, 3)), [None], 3, SEEDS)
    assert estimates[0, 1].tolist() == [1, 4, 7, 10]


def test_costs_are_summed_over_the_replicates():
    many = subject(np.zeros(4), costs=lambda pixel, seeds: np.full(seeds.size, 2.5))
    assert run(many, [None], None, SEEDS)[1] == [10.0]


@pytest.mark.parametrize("costs", [8, [8, 8], [1, 2, 3, -1], [1, 2, 3, np.nan], [[1]] * 4, ["a"] * 4])
def test_costs_are_a_number_from_0_up_for_each_seed(costs):
    with pytest.raises(SubjectError, match=r"costs\(pixel, seeds\) (gave|crashed with)"):
        run(subject(np.zeros(4), costs=lambda pixel, seeds: costs), [None], None, SEEDS)
    assert run(subject(np.zeros(4), costs=lambda pixel, seeds: None), [None], None, SEEDS)[1] is None


def test_many_pixels_at_once():
    many = SimpleNamespace(
        run_many=lambda pixels, seeds: np.add.outer(np.arange(seeds.size), 10 * np.arange(len(pixels)))
    )
    estimates, _ = run(many, ["a", "b", "c"], None, SEEDS)
    assert estimates.shape == (3, 1, 4)
    assert estimates[2, 0].tolist() == [20, 21, 22, 23]


@pytest.mark.parametrize(
    ("answer", "reason"),
    [
        (np.zeros(3), r"shape \(3,\) for 4 seeds, expected \(4,\)"),
        (np.zeros((4, 1)), r"shape \(4, 1\)"),
        (0.5, r"shape \(\)"),
        (None, r"NoneType of shape \(\)"),
        (["a"] * 4, "not an array of real numbers"),
        ([[1.0], [1.0, 2.0], 3, 4], "not an array of real numbers"),
        (np.zeros(4, complex), "not an array of real numbers"),
        (ZeroDivisionError("by zero"), "crashed with ZeroDivisionError: by zero"),
        (SystemExit(3), "crashed with SystemExit: 3"),
    ],
)
def test_what_it_may_not(answer, reason):
    with pytest.raises(SubjectError, match=reason):
        run(subject(answer), [None], None, SEEDS)


def test_a_sampler_of_scalars_is_told_what_to_do_with_colours():
    with pytest.raises(SubjectError, match=r"expected \(4, 3\): return \[seeds, channels\], e\.g\. values\.mean"):
        run(subject(np.zeros(4)), [None], 3, SEEDS)
    with pytest.raises(SubjectError, match=r"expected \(4, 3\)$"):
        run(subject(np.zeros(5)), [None], 3, SEEDS)


@pytest.mark.parametrize("error", [Unsupported("no colours"), NeedsScene("needs a scene")])
def test_declining_is_not_breaking(error):
    with pytest.raises(Unsupported, match=str(error)):
        run(subject(error), [None], None, SEEDS)


def test_an_interrupt_is_the_users():
    with pytest.raises(KeyboardInterrupt):
        run(subject(KeyboardInterrupt()), [None], None, SEEDS)
