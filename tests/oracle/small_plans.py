"""Small plans, each using the engine in its own way: one look at each level of observation."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np

Group = dict[str, Callable[..., Any]]

SCALAR: Group = {}
NONNEGATIVE: Group = {}


def table(group: Group) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Enter a plan in a group: the pixels that it runs on."""

    def enter(function: Callable[..., Any]) -> Callable[..., Any]:
        group[function.__name__] = function
        return function

    return enter


# -- unseen and flat -------------------------------------------------------------------------------


@table(SCALAR)
def fixed(X):
    return X.draw(3).mean()


@table(SCALAR)
def two_samples_weighted(X):
    S, T = X.draw(2), X.draw(1)
    return S.mean() * Fraction(2, 3) + T.sum() / 3 + 1


@table(SCALAR)
def drawn_for_nothing(X):
    X.draw(3)
    return X.true_mean()


@table(SCALAR)
def figure_1(X):
    S = X.draw(4)
    if (S.range() <= 0).all():
        return S.mean()
    return X.true_mean()


@table(SCALAR)
def figure_1_by_variance_then_more(X):
    S = X.draw(3)
    if S.variance() > 0:
        S.more(2)
    return S.mean()


@table(SCALAR)
def all_equal_then_mean(X):
    S = X.draw(3)
    if S.all_equal():
        return S.mean() / 2 if S.mean() > 0 else S.mean()
    return X.draw(1).mean()


@table(SCALAR)
def not_all_equal_of_two_samples(X):
    S, T = X.draw(2), X.draw(2)
    if not S.all_equal() and not T.all_equal():
        return (S.mean() + T.mean()) / 2
    return S.mean()


# -- extremes --------------------------------------------------------------------------------------


@table(SCALAR)
def range_with_ties(X):
    S = X.draw(3)
    return S.mean() if S.range() <= 1 else X.true_mean()


@table(SCALAR)
def range_without_ties(X):
    S = X.draw(3)
    return S.mean() if S.range() < 1 else X.draw(2).mean()


@table(SCALAR)
def midrange(X):
    S = X.draw(3)
    return (S.min() + S.max()) / 2


@table(SCALAR)
def chained_comparison(X):
    S = X.draw(3)
    return S.mean() if 0 <= S.min() < S.max() <= 2 else -S.max()


@table(SCALAR)
def negated(X):
    S = X.draw(3)
    if not (S.max() <= 1) or S.range() == 0:
        return 2 - S.mean()
    return 1 / Fraction(3) * S.sum()


@table(NONNEGATIVE)
def contrast(X):
    S = X.draw(3)
    return S.mean() if S.contrast(undefined=0) <= Fraction(1, 3) else X.draw(2).mean()


@table(NONNEGATIVE)
def contrast_guarded_by_where(X):
    S = X.draw(2)
    ratio = np.where(S.max() > 0, S.range() / (S.max() + S.min()), 0)
    return S.mean() if ratio <= Fraction(1, 2) else ratio


# -- sums, moments, counts, order ------------------------------------------------------------------


@table(SCALAR)
def mean_decides(X):
    S = X.draw(3)
    return S.mean() if S.mean() >= X.mean else X.draw(1).mean()


@table(SCALAR)
def product_of_two_means(X):
    return X.draw(2).mean() * X.draw(2).mean()


@table(SCALAR)
def mean_of_squares(X):
    S = X.draw(3)
    return S.mean() ** 2 - S.variance() / 3


@table(SCALAR)
def clamped(X):
    S = X.draw(3)
    return np.clip(S.mean(), Fraction(-1, 2), 1) + np.minimum(S.mean(), 0) + np.maximum(X.draw(1).mean(), 1)


@table(SCALAR)
def quantised(X):
    S = X.draw(3)
    return np.round(4 * S.mean()) / 4 + np.floor(S.max()) - np.ceil(S.min()) + round(S.mean() / 2, 1)


@table(SCALAR)
def variance_decides(X):
    S = X.draw(3)
    return S.mean() if S.variance() <= Fraction(1, 3) else X.draw(2).mean()


@table(SCALAR)
def standard_error_tie(X):
    S = X.draw(4)
    return S.mean() if S.std_error() <= Fraction(1, 2) * np.abs(S.mean()) else X.true_mean()


@table(SCALAR)
def two_standard_errors(X):
    S, T = X.draw(3), X.draw(2)
    if S.std_error() + T.std_error() < 2 * S.std_error():
        return S.mean()
    return T.mean()


@table(SCALAR)
def numpy_reductions(X):
    S = X.draw(3)
    if np.var(S) <= np.ptp(S) / 2 and np.std(S, ddof=1) <= np.max(S):
        return np.mean(S) + np.min(S)
    return np.median(S)


@table(SCALAR)
def custom_statistic(X):
    S = X.draw(3)
    middle = S.statistic(lambda values: values[1])
    return middle if middle >= S.mean() else S.statistic(lambda values: values[-1] - values[0])


@table(SCALAR)
def range_then_variance(X):
    S = X.draw(4)
    if S.range() <= 2 and S.variance() < 1:
        return S.mean()
    return S.max() - S.variance()


@table(SCALAR)
def order_of_the_draws(X):
    S = X.draw(3)
    return S.mean() if S[0] >= S[1] else S[2]


@table(SCALAR)
def loop_over_the_draws(X):
    total = 0
    for x in X.draw(3):
        total = x + total / 2
    return total


@table(SCALAR)
def constants_minus_one_and_minus_two(X):
    S = X.draw(2)
    return np.maximum(S.mean(), -1) * np.maximum(S.mean(), -2) + (-1 * S.min()) ** 2 - (-2 * S.min()) ** 2
