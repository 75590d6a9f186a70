"""E-processes as values, and the fixed blend of several, which is one again."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np

from truemean.conformance.evidence.outcomes import Batch

__all__ = ["Blend", "EProcess", "both"]


class EProcess(Protocol):
    """Money won by bets that are fair or worse under a hypothesis.

    Under it the money, 1 at first, ever reaches 1/a with probability at most a (Ville), so one may look
    after every batch and stop when one likes. ``log_evidence`` is its logarithm now, ``peak`` the maximum
    over the looks so far, ``lean`` the side, 1 or -1, that it speaks for, a label without a proof.
    """

    @property
    def log_evidence(self) -> float: ...

    @property
    def peak(self) -> float: ...

    @property
    def lean(self) -> int: ...

    def update(self, batch: Batch) -> Self:
        """The same process after one more look at more outcomes."""
        ...

    def merge(self, later: Self) -> Self:
        """This process, continued by one that saw other outcomes, from elsewhere or later, of the same question."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Blend:
    """Money divided among e-processes once, before the run, which in total is one again.

    It falls behind its best part by the logarithm of that part's share at most.

    >>> from truemean.conformance.evidence import Bounded, Mixture, hybrid
    >>> coin = both(lambda sign: Mixture.open(Bounded(sign, 0.5), hybrid(0.5, 0.01, 1000)))
    >>> heads = coin.update(Batch(np.array([0.0, 1.0]), np.array([10.0, 40.0])))
    >>> heads.log_evidence > math.log(100), heads.lean, heads.leading
    (True, 1, 'above')
    """

    names: tuple[str, ...]
    parts: tuple[EProcess, ...]
    log_shares: tuple[float, ...]
    log_evidence: float = 0.0
    peak: float = 0.0

    @classmethod
    def of(cls, **parts: tuple[float, EProcess]) -> Blend:
        """Parts by name, each with its share; shares sum to 1."""
        shares, processes = zip(*parts.values(), strict=True)
        return cls(tuple(parts), processes, tuple(math.log(share) for share in shares))

    @property
    def leading(self) -> str:
        """The part with the most money."""
        return self.names[self._first]

    @property
    def lean(self) -> int:
        return self.parts[self._first].lean

    @property
    def _first(self) -> int:
        return int(np.argmax([s + p.log_evidence for s, p in zip(self.log_shares, self.parts, strict=True)]))

    def update(self, batch: Batch) -> Blend:
        return self._with(tuple(part.update(batch) for part in self.parts))

    def merge(self, later: Blend) -> Blend:
        return self._with(tuple(a.merge(b) for a, b in zip(self.parts, later.parts, strict=True)))

    def _with(self, parts: tuple[EProcess, ...]) -> Blend:
        now = _log_sum([share + part.log_evidence for share, part in zip(self.log_shares, parts, strict=True)])
        return Blend(self.names, parts, self.log_shares, now, max(self.peak, now))


def both(open_side: Callable[[int], EProcess]) -> Blend:
    """Evidence for a mean above or below: half of the money on each."""
    return Blend.of(above=(0.5, open_side(1)), below=(0.5, open_side(-1)))


def _log_sum(logs: list[float]) -> float:
    """The logarithm of a sum of a few terms."""
    most = max(logs)
    return most + math.log(sum([math.exp(log - most) for log in logs])) if math.isfinite(most) else most
