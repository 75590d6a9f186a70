"""Plans for the structural rule: unbiased by their structure, or biased by a leak."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from tests.oracle.small_plans import Group, table

UNBIASED: Group = {}
PLACED: Group = {}  # on pixels of a scene
BIASED: Group = {}

# -- unbiased by their structure -------------------------------------------------------------------


@table(UNBIASED)
def pilot_kept_at_a_fixed_weight(X):
    S = X.draw(3)
    m = 1 if S.variance() <= 1 else 3
    return S.mean() / 4 + 3 * X.draw(m).mean() / 4


@table(UNBIASED)
def figure_2_by_if(X):
    R, rest = X.split("1/4")
    S = R.draw(3)
    m = 1 if S.range() <= 0 else 3
    return S.mean() * R.area + rest.draw(m).mean() * rest.area


@table(UNBIASED)
def figure_2_by_where(X):
    R, rest = X.split("1/4")
    S = R.draw(3)
    return S.mean() * R.area + rest.draw(np.where(S.range() <= 0, 1, 3)).mean() * rest.area


@table(UNBIASED)
def roulette(X):
    return X.draw(2).mean() * 3 if X.coin(Fraction(1, 3)) else 0


@table(UNBIASED)
def roulette_by_a_pilot(X):
    p = np.where(X.draw(3).range() <= 0, Fraction(1, 4), Fraction(1, 2))
    return X.draw(2).mean() / p if X.coin(p) else 0


@table(UNBIASED)
def roulette_by_a_clamped_pilot(X):
    p = np.clip(X.draw(2).range(), Fraction(1, 10), 1)
    return X.draw(2).mean() / p if X.coin(p) else 0


@table(UNBIASED)
def roulette_of_roulettes(X):
    T = X.draw(1).mean()
    if X.coin(Fraction(1, 2)):
        return 8 * T if X.coin(Fraction(1, 4)) else 0
    return 0


@table(UNBIASED)
def coin_without_a_path(X):
    return np.where(X.coin(Fraction(1, 4)), 4 * X.draw(1).mean(), 0)


@table(UNBIASED)
def picked_of_three(X):
    which = X.pick(["1/2", "1/3", "1/6"])
    if which == 0:
        return X.draw(1).mean() * Fraction(2, 3)
    return X.draw(1).mean() if which == 1 else 2 * X.draw(1).mean()


@table(UNBIASED)
def size_picked_from_a_list(X):
    return X.draw([1, 2, 3][X.pick([1, 1, 2])]).mean()


@table(UNBIASED)
def output_buffer_drawn_first(X):
    B, A = X.draw(1), X.draw(2)
    if A.range() > 0:
        B.more(2)
    return B.mean()


@table(UNBIASED)
def two_buffers_grow_together(X):
    A, B = X.draw(2), X.draw(1)
    while A.std_error() > Fraction(1, 10) and B.size < 3:
        A.more(1)
        B.more(1)
    return B.mean()


@table(UNBIASED)
def the_whole_or_its_parts(X):
    R, rest = X.split("1/4")
    if X.draw(3).range() <= 0:
        return X.draw(2).mean()
    return R.area * R.draw(2).mean() + rest.area * rest.draw(1).mean()


@table(UNBIASED)
def parted_in_two_ways(X):
    (A, B), (C, D) = X.split("1/4"), X.split("1/3")
    one, other = (A, B) if X.draw(2).range() <= 0 else (C, D)
    return one.area * one.draw(1).mean() + other.area * other.draw(1).mean()


@table(UNBIASED)
def weight_chosen_by_a_later_sample(X):
    T, U, S = X.draw(1), X.draw(2), X.draw(2)
    a = np.where(S.mean() > 0, Fraction(1, 4), Fraction(2, 3))
    return a * T.mean() + (1 - a) * U.mean()


@table(UNBIASED)
def weight_decided_by_a_later_sample(X):
    T, U, S = X.draw(1), X.draw(2), X.draw(2)
    a = Fraction(1, 4) if S.mean() > 0 else Fraction(2, 3)
    return a * T.mean() + (1 - a) * U.mean()


@table(UNBIASED)
def weight_that_is_a_mean(X):
    q = X.draw(2).mean()
    return q * X.draw(2).mean() + (1 - q) * X.draw(1).mean()


@table(UNBIASED)
def weight_that_is_a_ratio_of_what_was_seen(X):
    S = X.draw(2)
    q = S.mean() / (1 + S.max() * S.max())
    T = X.draw(1) if S.range() > 0 else X.draw(2)
    return q * T.mean() + (1 - q) * X.draw(1).mean()


@table(UNBIASED)
def crossed_weights(X):
    S, T, U = X.draw(2), X.draw(1), X.draw(1)
    a, b = (
        np.where(S.range() > 0, Fraction(1, 3), Fraction(3, 4)),
        np.where(S.range() <= 0, Fraction(1, 4), Fraction(2, 3)),
    )
    return a * T.mean() + b * U.mean()


@table(UNBIASED)
def loop_that_only_sizes(X):
    L = X.draw_until(lambda S: S.std_error() <= Fraction(1, 10), start=2, most=4)
    return X.draw(L.size).mean()


@table(UNBIASED)
def control_variate(X):
    return X.draw(2).mean() + Fraction(1, 2) * (X.mean - X.draw(3).mean())


@table(UNBIASED)
def grown_unseen(X):
    return X.draw(2).more(1).mean()


@table(UNBIASED)
def decided_twice_alike(X):
    S, T = X.draw(2), X.draw(1)
    weight = 1 if S.range() <= 1 else Fraction(1, 2)
    return weight * T.mean() + (0 if S.range() <= 1 else X.draw(1).mean() / 2)


@table(UNBIASED)
def estimated_by_a_proved_plan(X):
    S = X.draw(2)
    return X.estimate(small_fixed, n=np.where(S.range() <= 0, 1, 2)) / 2 + X.estimate(figure_2_by_if) / 2


def small_fixed(X, n=1):
    return X.draw(n).mean()


@table(UNBIASED)
def a_biased_plan_only_decides(X):
    return X.draw(2 if X.estimate(figure_1) > 0 else 1).mean()


@table(PLACED)
def quadrants_of_a_quadrant(X):
    Q = X.quadrants()
    if X.draw(3).range() <= 0:
        return X.draw(2).mean()
    return sum(q.area * q.draw(1).mean() for q in Q[:3]) + sum(p.draw(1).mean() for p in Q[3].quadrants()) / 16


@table(PLACED)
def one_draw_in_each_cell(X):
    S = X.draw(2)
    cells = X.grid(3) if (S.range() <= 0).all() else X.grid(2)
    return sum(cell.area * cell.draw(1).mean() for cell in cells)


@table(PLACED)
def a_cell_of_a_quadrant(X):
    Q = X.grid(2)
    return sum(q.area * q.draw(2).mean() for q in Q[1:]) + sum(c.area * c.draw(1).mean() for c in Q[0].grid(3)) / 4


@table(PLACED)
def regions_of_a_scene(X):
    S = X.draw(2)
    if S.mean() > X.mean:
        return X.draw(1).mean()
    return sum(part.area * part.draw(1).mean() for part in X.regions.values()) if X.regions else X.draw(2).mean()


# -- biased by a leak ------------------------------------------------------------------------------


@table(BIASED)
def figure_1(X):
    S = X.draw(3)
    return S.mean() if S.range() <= 0 else X.true_mean()


@table(BIASED)
def a_branch_beyond_the_values_of_small_pixels(X):
    S = X.draw(2)
    return S.mean() if S.max() > 5 else X.draw(1).mean()


@table(BIASED)
def pooled(X):
    S = X.draw(3)
    return S.more(3).mean() if S.range() > 0 else S.mean()


@table(BIASED)
def stopped_by_a_while(X):
    S = X.draw(2)
    while S.std_error() > Fraction(1, 10) and S.size < 5:
        S.more(1)
    return S.mean()


@table(BIASED)
def stopped_by_draw_until(X):
    return X.draw_until(lambda S: S.std_error() <= Fraction(1, 10), start=2, most=5).mean()


@table(BIASED)
def redrawn_by_variance(X):
    S = X.draw(2)
    return X.draw(2).mean() if S.variance() > Fraction(1, 3) else S.mean()


@table(BIASED)
def half(X):
    return 0.5 * X.draw(2).mean()


@table(BIASED)
def a_constant(X):
    return 0.5


@table(BIASED)
def the_largest(X):
    return X.draw(2).max()


@table(BIASED)
def clamped(X):
    return np.minimum(X.draw(2).mean(), 1)


@table(BIASED)
def product_of_means(X):
    return X.draw(1).mean() * X.draw(1).mean()


@table(BIASED)
def equal_weights_for_regions_of_unequal_area(X):
    R, rest = X.regions["R"], X.regions["rest"]
    return (R.draw(1).mean() + rest.draw(1).mean()) / 2


@table(BIASED)
def roulette_with_a_wrong_weight(X):
    return X.draw(2).mean() * 2 if X.coin(Fraction(1, 3)) else 0


@table(BIASED)
def roulette_that_may_never_go_on(X):
    p = np.clip(X.draw(2).range(), 0, 1)
    return X.draw(2).mean() / p if X.coin(p) else 0


@table(BIASED)
def the_same_coin_twice(X):
    heads = X.coin(Fraction(1, 2))
    if heads:
        return 4 * X.draw(1).mean() if heads else 0
    return 0


@table(BIASED)
def size_chosen_by_what_is_then_weighted(X):
    S = X.draw(2)
    T = X.draw(np.where(S.mean() > 0, 3, 1))
    a = np.where(T.range() <= 0, Fraction(1, 4), Fraction(3, 4))
    return a * S.mean() + (1 - a) * X.draw(1).mean()


@table(BIASED)
def size_decided_by_what_is_then_weighted(X):
    S = X.draw(2)
    T = X.draw(3 if S.mean() > 0 else 1)
    a = Fraction(1, 4) if T.range() <= 0 else Fraction(3, 4)
    return a * S.mean() + (1 - a) * X.draw(1).mean()


@table(BIASED)
def leak_by_a_coin(X):
    S = X.draw(2)
    heads = X.coin(np.where(S.mean() > 0, Fraction(1, 4), Fraction(3, 4)))
    return S.mean() if heads else X.draw(1).mean()


@table(BIASED)
def leak_by_a_coin_without_a_path(X):
    S = X.draw(2)
    heads = X.coin(np.where(S.mean() > 0, Fraction(1, 4), Fraction(3, 4)))
    return np.where(heads, S.mean(), X.draw(1).mean())


@table(BIASED)
def leak_by_the_parameter_of_a_sub_estimate(X):
    S = X.draw(2)
    E = X.estimate(small_fixed, n=np.where(S.mean() > 0, 3, 1))
    a = np.where(E > 0, Fraction(1, 4), Fraction(3, 4))
    return a * S.mean() + (1 - a) * X.draw(1).mean()


@table(BIASED)
def estimated_by_a_biased_plan(X):
    return X.estimate(figure_1)


@table(BIASED)
def functions_of_one_code(X):
    S = X.draw(2)
    first, second = (S.statistic(lambda values, i=i: values[i]) for i in range(2))
    return X.draw(1).mean() + first - second
