"""Estimators to judge: honest, biased, broken."""

import numpy as np

from truemean.oracle.pixel import Pixel

EIGHTH = {"eighth": Pixel.two("1/8")}
COLOUR = {"colour": Pixel({(1, 0, 0): "1/2", (0, 1, 0): "1/4", (0, 0, 1): "1/4"})}


def uniforms(seeds, number):
    """Numbers in [0, 1), ``[seeds, number]``, by splitmix64: the same for the same seed in any batch."""
    z = (seeds.astype(np.uint64)[:, None] << np.uint64(8)) + np.arange(number, dtype=np.uint64)
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        z = (z ^ (z >> np.uint64(shift))) * np.uint64(factor)
    return (z ^ (z >> np.uint64(31))) / 2**64


def draws(pixel, seeds, number):
    values, weights = pixel.arrays()
    return values[np.minimum(np.searchsorted(np.cumsum(weights), uniforms(seeds, number), "right"), len(weights) - 1)]


def fixed(pixel, seeds):
    return draws(pixel, seeds, 8).mean(axis=1)


def kirk_arvo(pixel, seeds):
    sample = draws(pixel, seeds, 8)
    values, weights = pixel.arrays()
    easy = (sample == sample[:, :1]).reshape(seeds.size, -1).all(axis=1)
    return np.where(easy.reshape(-1, *[1] * (values.ndim - 1)), sample[:, 0], weights @ values)


def only(report):
    (case,) = report.cases
    return case


def breaking(value, after=148):  # 48 of them are drawn to check the seeds
    drawn = {}

    def broken(pixel, seeds):
        estimates = np.array(fixed(pixel, seeds))
        drawn[id(pixel)] = drawn.get(id(pixel), 0) + seeds.size
        if drawn[id(pixel)] > after:
            estimates[-1] = value
        return estimates

    return broken


class Together:
    """Renders many pixels at once, from the same seeds."""

    name = "together"
    versions = {"renderer": "1.2"}  # noqa: RUF012 - a fake

    def __init__(self, estimator):
        self.estimator, self.calls = estimator, []

    def run(self, pixel, seeds):
        return self.estimator(pixel, seeds)

    def run_many(self, pixels, seeds):
        self.calls.append((len(pixels), seeds.tolist()))
        return np.stack([self.estimator(pixel, seeds) for pixel in pixels], axis=1)

    def costs(self, pixel, seeds):
        return np.where(seeds % 2, 8, 4)

    def pixels(self):
        return EIGHTH | COLOUR | {"quarter": Pixel.two("1/4")}
