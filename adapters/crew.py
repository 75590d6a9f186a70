"""The same subject in several processes, each of which runs its share of the seeds."""

from __future__ import annotations

import io
import pickle
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from truemean.adapters.host import Host
from truemean.subject import PixelLike, PlainPixel, as_estimator

__all__ = ["Crew", "Member"]

LEAST = 8  # seeds that are worth sending to one more process


class Crew:
    """An estimator that is loaded from ``subject`` in ``jobs`` processes; what it says of itself, it says here.

    A replicate depends on its seed alone, so that it is the same in any of them. A process that crashes or takes more
    than ``timeout`` seconds for a batch breaks the batch, with the seed that did it, and is started again.
    """

    def __init__(self, subject: str, local: Any, jobs: int, timeout: float) -> None:
        self._local = local
        self._hosts = [Host("truemean.adapters.crew:Member", (subject,), timeout) for _ in range(jobs)]
        self._sent: dict[int, tuple[PixelLike, str | bytes]] = {}
        self._last: tuple[Any, ...] = ()

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        found = getattr(self._local, name)
        return self._run_many if name == "run_many" and callable(found) else found

    def run(self, pixel: PixelLike, seeds: ArrayLike) -> Any:
        """Estimates ``[seeds]`` or ``[seeds, channels]``, one share of the seeds from each process."""
        return self._replicates([pixel], False, np.asarray(seeds, dtype=np.int64))[0]

    def _run_many(self, pixels: Sequence[PixelLike], seeds: ArrayLike) -> Any:
        return self._replicates(pixels, True, np.asarray(seeds, dtype=np.int64))[0]

    def costs(self, pixel: PixelLike, seeds: ArrayLike) -> Any:
        """Samples drawn ``[seeds]``, None where the subject does not say."""
        numbers = np.asarray(seeds, dtype=np.int64)
        known = self._last and np.array_equal(self._last[1], numbers) and any(p is pixel for p in self._last[0])
        if not known:
            self.run(pixel, numbers)
        place = next(i for i, p in enumerate(self._last[0]) if p is pixel)
        return self._last[2][1][place]

    def _replicates(self, pixels: Sequence[PixelLike], together: bool, seeds: NDArray[np.int64]) -> Any:
        jobs = max(1, min(len(self._hosts), seeds.size // LEAST))
        given = [self._reference(pixel) for pixel in pixels]
        for host in self._hosts:
            host.child.resume()
        with ThreadPoolExecutor(jobs) as pool:
            waiting = [
                pool.submit(host.replicates, "replicates", share, given, together)
                for host, share in zip(self._hosts, np.array_split(seeds, jobs), strict=False)
            ]
            try:
                shares = [share.result() for share in waiting]
            except KeyboardInterrupt:  # which would wait for them
                for host in self._hosts:
                    host.child.interrupt()
                raise
        estimates = np.concatenate([share[0] for share in shares])
        columns = zip(*(share[1] for share in shares), strict=True)
        costs = [None if any(part is None for part in column) else np.concatenate(column) for column in columns]
        self._last = (list(pixels), seeds, (estimates, costs))
        return self._last[2]

    def _reference(self, pixel: PixelLike) -> str | bytes:
        """The name of a pixel that the subject brings itself, or any other as a process is sent it."""
        if not self._sent:
            own = getattr(self._local, "pixels", None)
            self._sent = {id(mine): (mine, name) for name, mine in own().items()} if own else {}
        if id(pixel) not in self._sent or self._sent[id(pixel)][0] is not pixel:
            self._sent[id(pixel)] = pixel, _pickled(pixel)
        return self._sent[id(pixel)][1]


class _Pickler(pickle.Pickler):
    """One that knows read-only mappings too."""

    def reducer_override(self, thing: Any) -> Any:
        return (_read_only, (dict(thing),)) if isinstance(thing, MappingProxyType) else NotImplemented


def _read_only(mapping: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(mapping)


def _pickled(pixel: PixelLike) -> bytes:
    """A pixel with all that a plan may ask of it, or, where that can't be sent, its values and weights."""
    sent = io.BytesIO()
    try:
        _Pickler(sent).dump(pixel)
        return sent.getvalue()
    except Exception:  # noqa: BLE001 - whatever keeps it from being sent
        return pickle.dumps(PlainPixel.of(pixel))


class Member:
    """The subject in one of the processes."""

    def __init__(self, subject: str) -> None:
        from truemean.adapters import load

        self.subject = as_estimator(load(subject))
        own = getattr(self.subject, "pixels", None)
        self.pixels: dict[str | bytes, Any] = dict(own()) if own else {}

    def replicates(self, given: Sequence[str | bytes], together: bool, seeds: NDArray[np.int64]) -> Any:
        """Estimates, and the costs on each pixel."""
        for each in given:
            if isinstance(each, bytes) and each not in self.pixels:
                self.pixels[each] = pickle.loads(each)  # noqa: S301 - of the process that started this one
        pixels = [self.pixels[each] for each in given]
        estimates = self.subject.run_many(pixels, seeds) if together else self.subject.run(pixels[0], seeds)
        costs = getattr(self.subject, "costs", None)
        return np.asarray(estimates), [costs(pixel, seeds) if costs else None for pixel in pixels]
