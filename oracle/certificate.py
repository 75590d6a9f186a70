"""Certificates that a bias is zero for all weights, and a checker that trusts nothing of the engine.

A certificate lists, path by path, the polynomial in the weights that the path adds to the bias.
The sum is zero on the simplex exactly if it vanishes once every term is brought to the same degree
in the weights, for there the sum of the weights is 1.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

__all__ = ["check_certificate"]


def check_certificate(certificate: Mapping[str, Any]) -> bool:
    """Whether the paths of a certificate add up to zero for all weights on the simplex.

    ``certificate`` has ``weights`` (how many of the variables are weights; they come first),
    ``paths`` (each with ``decisions`` and ``terms``, a list of ``[exponents, numerator]``) and
    ``denominator``, common to all. Only integers are added and multiplied.

    >>> pieces = [{"decisions": [], "terms": [[[1, 0], 1], [[0, 1], 1], [[0, 0], -1]]}]
    >>> check_certificate({"weights": 2, "denominator": 1, "paths": pieces})
    True
    """
    k = int(certificate["weights"])
    terms = [(tuple(e), int(c)) for path in certificate["paths"] for e, c in path["terms"]]
    if int(certificate["denominator"]) < 1 or any(min(e, default=0) < 0 or len(e) < k for e, _ in terms):
        return False
    degree = max((sum(e[:k]) for e, _ in terms), default=0)
    total: dict[tuple[int, ...], int] = {}
    for exponents, coefficient in terms:
        missing = degree - sum(exponents[:k])
        # Multiply by (omega_1 + ... + omega_k)^missing, which is 1.
        for counts in _compositions(missing, k):
            ways = math.factorial(missing) // math.prod(map(math.factorial, counts))
            raised = (*(e + c for e, c in zip(exponents, counts, strict=False)), *exponents[k:])
            total[raised] = total.get(raised, 0) + coefficient * ways
    return not any(total.values())


def _compositions(total: int, parts: int) -> Iterator[tuple[int, ...]]:
    """All ways to write ``total`` as a sum of ``parts`` numbers."""
    if parts == 1:
        yield (total,)
        return
    for first in range(total + 1):
        for rest in _compositions(total - first, parts - 1):
            yield (first, *rest)
