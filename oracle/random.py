"""Counter-based random numbers: Philox4x32-10 (Salmon, Moraes, Dror & Shaw 2011), vectorised."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["philox", "uniforms"]

Words = NDArray[np.uint64]
_MASK = np.uint64(0xFFFFFFFF)
_HALF = np.uint64(32)
_ROUND = (np.uint64(0xD2511F53), np.uint64(0xCD9E8D57))
_WEYL = (0x9E3779B9, 0xBB67AE85)


def philox(counter: tuple[Words, Words, Words, Words], key: int) -> tuple[Words, Words, Words, Words]:
    """Four 32-bit words (held in uint64) for each counter of four 32-bit words and a 64-bit key.

    >>> zero = np.zeros(1, dtype=np.uint64)
    >>> [hex(int(w[0])) for w in philox((zero, zero, zero, zero), 0)]
    ['0x6627e8d5', '0xe169c58d', '0xbc57ac4c', '0x9b00dbd8']
    """
    a, b, c, d = counter
    low, high = key & 0xFFFFFFFF, key >> 32
    for _ in range(10):
        left, right = _ROUND[0] * a, _ROUND[1] * c
        a, b, c, d = (
            (right >> _HALF) ^ b ^ np.uint64(low),
            right & _MASK,
            (left >> _HALF) ^ d ^ np.uint64(high),
            left & _MASK,
        )
        low, high = (low + _WEYL[0]) & 0xFFFFFFFF, (high + _WEYL[1]) & 0xFFFFFFFF
    return a, b, c, d


def uniforms(identity: Words, draws: int, key: int) -> NDArray[np.float64]:
    """Numbers in [0, 1) with 53 bits, ``[len(identity), draws]``, two per counter."""
    pairs = (draws + 1) // 2
    who = identity[:, None]
    number = np.broadcast_to(np.arange(pairs, dtype=np.uint64), (len(identity), pairs))
    low = np.broadcast_to(who & _MASK, number.shape)
    high = np.broadcast_to(who >> _HALF, number.shape)
    a, b, c, d = philox((low, high, number, np.zeros_like(number)), key)
    first, second = ((x << np.uint64(21)) ^ (y >> np.uint64(11)) for x, y in ((a, b), (c, d)))
    both = np.stack([first, second], axis=2).reshape(len(identity), 2 * pairs)[:, :draws]
    return np.asarray(both.astype(np.float64) * 2.0**-53)
