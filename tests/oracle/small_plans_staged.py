"""Small plans of several stages: growth, sizes by row, choices, sub-estimates, regions, colours."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from tests.oracle.small_plans import Group, table

SCALAR: Group = {}
PARTED: Group = {}
COLOUR: Group = {}

# -- growth ----------------------------------------------------------------------------------------


@table(SCALAR)
def old_mean_outlives_growth(X):
    S = X.draw(2)
    old = S.mean()
    if S.range() > 0:
        S.more(1)
        return (old + S.mean()) / 2
    return S.mean()


@table(SCALAR)
def old_range_looked_at_after_growth(X):
    S = X.draw(2)
    old = S.range()
    S.more(2)
    if old <= 0:
        return S.mean()
    return S.mean() * 2 - S.max()


@table(SCALAR)
def looked_at_grown_looked_at(X):
    S = X.draw(2)
    first = S.mean()
    if S.range() <= 1:
        S.more(1)
        if S.variance() > 0:
            S.more(1)
            return S.mean() + first
        return S.mean()
    S.more(1)
    return first * S.mean()


@table(SCALAR)
def grown_before_any_look(X):
    S = X.draw(1)
    first = S.mean()
    S.more(1)
    S.more(1)
    if S.max() > first:
        return S.mean()
    return first


@table(SCALAR)
def two_samples_grow_in_turn(X):
    S, T = X.draw(1), X.draw(1)
    if S.mean() < T.mean():
        S.more(1)
        if S.mean() < T.mean():
            T.more(1)
            return (S.sum() + T.sum()) / (S.size + T.size)
        return S.mean() - T.mean()
    T.more(1)
    return T.mean() if T.range() <= 0 else S.mean()


@table(SCALAR)
def growth_decided_by_another_sample(X):
    S, T = X.draw(1), X.draw(2)
    if T.range() > 0:
        S.more(2)
    if S.max() > 0:
        return S.mean()
    return T.mean()


@table(SCALAR)
def old_variance_against_new(X):
    S = X.draw(2)
    before = S.variance()
    S.more(2)
    return S.mean() if S.variance() <= before else X.true_mean()


@table(SCALAR)
def grown_by_a_random_number(X):
    S = X.draw(2)
    S.more(np.where(S.range() > 0, 2, 0))
    if S.mean() > 0:
        return S.sum() / S.size
    return S.max()


@table(SCALAR)
def grown_by_its_own_mean_and_never_looked_at_again(X):
    S = X.draw(2)
    S.more(np.where(S.mean() > 0, 1, 0))
    return S.mean()


@table(SCALAR)
def sizes_another_sample_then_grows_unseen(X):
    S = X.draw(2)
    T = X.draw(np.where(S.all_equal(), 2, 1))
    S.more(1)
    return T.mean() + S.mean()


@table(SCALAR)
def sequential(X, eps=Fraction(2, 5)):
    S = X.draw(2)
    while S.std_error() > eps and S.size < 5:
        S.more(1)
    return S.mean()


@table(SCALAR)
def until_standard_error(X, eps=Fraction(2, 5)):
    return X.draw_until(lambda S: S.std_error() <= eps, start=2, step=1, most=5).mean()


@table(SCALAR)
def until_range_last_step_cut(X):
    S = X.draw_until(lambda S: S.range() > 0, start=2, step=2, most=5)
    return S.mean() * S.size + S.max()


@table(SCALAR)
def until_halves_agree(X):
    def agree(A, B):
        return np.abs(A.mean() - B.mean()) <= Fraction(1, 2) * B.size

    return X.draw_until(agree, start=2, step=2, most=5, parts=2).mean()


@table(SCALAR)
def until_extremes_then_grown_and_looked_at(X):
    S = X.draw_until(lambda S: (S.max() > 0) | (S.min() < 0), start=1, step=1, most=3)
    before = S.mean()
    if before > X.mean:
        S.more(1)
    return S.mean() * before


# -- sizes by row ----------------------------------------------------------------------------------


@table(SCALAR)
def pilot_sizes_the_second_stage(X):
    S = X.draw(2)
    return X.draw(np.where(S.range() <= 0, 1, 3)).mean()


@table(SCALAR)
def pilot_sizes_and_is_pooled(X):
    S = X.draw(2)
    T = X.draw(np.where(S.range() <= 1, 0, 3))
    return (S.sum() + T.sum()) / (S.size + T.size)


@table(SCALAR)
def second_stage_of_random_size_decides(X):
    S = X.draw(2)
    T = X.draw(1 + np.minimum(2, np.floor(S.range())))
    return T.mean() if T.range() <= 0 else S.mean()


@table(SCALAR)
def coefficient_chosen_by_the_pilot(X):
    S, T, U = X.draw(2), X.draw(1), X.draw(2)
    a = np.where(S.mean() > 0, Fraction(1, 4), Fraction(2, 3))
    return a * T.mean() + (1 - a) * U.mean()


# -- choices of the estimator ----------------------------------------------------------------------


@table(SCALAR)
def roulette(X):
    S = X.draw(2)
    if X.coin(Fraction(1, 3)):
        return S.mean() + 3 * (X.draw(2).mean() - S.mean())
    return S.mean()


@table(SCALAR)
def coin_by_the_pilot(X):
    S = X.draw(2)
    if X.coin(np.clip(S.mean(), 0, 1)):
        return X.draw(2).mean()
    return S.min()


@table(SCALAR)
def coin_without_a_path(X):
    S, heads = X.draw(2), X.coin("1/4")
    return np.where(heads, S.mean() * 2, S.max()) + np.where(heads, 1, 0)


@table(SCALAR)
def certain_coins(X):
    S = X.draw(2)
    return S.mean() if X.coin(1) and not X.coin(0) else 1 / (S.max() - S.max())


@table(SCALAR)
def picked(X):
    which = X.pick([1, 0, "1/2"])
    if which == 0:
        return X.draw(1).mean() * which
    return X.draw(which).mean() + which


@table(SCALAR)
def picked_without_a_path(X):
    return X.draw(2).mean() * X.pick(["1/3", "1/6", "1/2"])


@table(SCALAR)
def weighted_by_a_function(X):
    S = X.draw(3)
    return S.mean(weight=lambda value: value * value + 1) if S.min() < S.max() else S.mean(weight=lambda value: 2)


# -- sub-estimates ---------------------------------------------------------------------------------


def inner(X, n=2, bonus=0):
    S = X.draw(n)
    return S.mean() + bonus if S.range() <= 0 else X.true_mean()


@table(SCALAR)
def sub_estimate(X):
    return X.estimate(inner, n=2) / 2 + X.draw(1).mean() / 2


@table(SCALAR)
def sub_estimate_decides(X):
    first = X.estimate(inner, n=2)
    return first if first > X.mean else X.estimate(inner, n=1)


@table(SCALAR)
def sub_estimate_with_random_parameter(X):
    S = X.draw(2)
    return X.estimate(inner, n=2, bonus=np.where(S.range() <= 0, 0, 1))


# -- regions ---------------------------------------------------------------------------------------


@table(PARTED)
def figure_2(X):
    R, rest = X.regions["R"], X.regions["rest"]
    S = R.draw(2)
    n = 1 if S.range() <= 0 else 3
    return S.mean() * R.area + rest.draw(n).mean() * rest.area


@table(PARTED)
def regions_against_the_whole(X):
    R, rest = X.regions["R"], X.regions["rest"]
    S, T = R.draw(2), X.draw(2)
    if S.max() > T.max():
        return R.area * S.mean() + rest.area * rest.true_mean()
    return T.mean() - R.mean * S.mean()


@table(PARTED)
def sub_estimates_of_regions(X):
    return sum(part.area * part.estimate(inner, n=2) for part in X.regions.values())


@table(SCALAR)
def split_in_scattered_parts(X, area="1/4"):
    R, rest = X.split(area)
    S = R.draw(2)
    T = rest.draw(1 if (S.range() <= 0).all() else 2)
    return S.mean() * R.area + T.mean() * rest.area


# -- colours ---------------------------------------------------------------------------------------


@table(COLOUR)
def colour_fixed(X):
    return X.draw(2).mean()


@table(COLOUR)
def colour_figure_1(X):
    S = X.draw(3)
    return S.mean() if (S.range() <= 0).all() else X.true_mean()


@table(COLOUR)
def colour_range_in_all(X):
    S = X.draw(3)
    return S.mean() if (S.range() <= Fraction(1, 3)).all() else X.draw(1).mean()


@table(COLOUR)
def colour_range_in_any(X):
    S = X.draw(3)
    return S.mean() / 2 if (S.range() > (0, Fraction(1, 3))).any() else S.max()


@table(COLOUR)
def colour_one_channel_decides(X):
    S = X.draw(2)
    return S.mean() * 2 if S.mean()[0] <= S.max()[1] else X.draw(1).mean() + S.min()


@table(COLOUR)
def colour_variance(X):
    S = X.draw(3)
    return S.mean() if (S.variance() <= S.mean() / 2).all() else X.draw(2).mean()


@table(COLOUR)
def colour_clamped(X):
    S = X.draw(2)
    chosen = np.where(S.mean() > X.mean, S.min(), S.max())
    return np.minimum(S.mean(), Fraction(1, 2)) * chosen + np.clip(chosen, 0, Fraction(1, 2))


@table(COLOUR)
def colour_grown(X):
    S = X.draw(2)
    old = S.mean()
    if (S.range() > 0).any():
        S.more(1)
    return (old + S.mean()) / 2


@table(COLOUR)
def colour_sequential(X):
    S = X.draw(2)
    while (S.variance() > Fraction(1, 9)).any() and S.size < 4:
        S.more(1)
    return S.mean()
