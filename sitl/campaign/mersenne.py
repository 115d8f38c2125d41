"""Python's own random numbers in compiled code: the Mersenne Twister and `random.gauss`, number by number the same.

Source: Matsumoto and Nishimura, "Mersenne Twister", 1998 (MT19937); `random.gauss` of CPython, which draws by Box and
Muller and keeps the second number of each pair.
"""

from __future__ import annotations

import math
from random import Random
from typing import Final

import numpy as np
import numpy.typing as npt

_N: Final = 624
_M: Final = 397
_INDEX: Final = 624  # place of the index in the state, behind the words
_KEPT: Final = 0  # places of the pair's second number, and of whether there is one
_HAS: Final = 1

Words = npt.NDArray[np.uint32]
Floats = npt.NDArray[np.float64]


def state_of(random: Random) -> tuple[Words, Floats]:
    """The state of a generator, to go on from: words and index, and what `gauss` has kept."""
    _, words, kept = random.getstate()
    return np.array(words, dtype=np.uint32), np.array([kept or 0.0, float(kept is not None)])


def _refill(words: Words) -> None:
    for i in range(_N):
        y = (words[i] & np.uint32(0x80000000)) | (words[(i + 1) % _N] & np.uint32(0x7FFFFFFF))
        twisted = words[(i + _M) % _N] ^ (y >> np.uint32(1))
        if y & np.uint32(1):
            twisted ^= np.uint32(0x9908B0DF)
        words[i] = twisted
    words[_INDEX] = np.uint32(0)


def _word(words: Words) -> int:
    """32 random bits."""
    if words[_INDEX] >= np.uint32(_N):
        _refill(words)
    y = np.int64(words[words[_INDEX]])
    words[_INDEX] += np.uint32(1)
    y ^= y >> 11
    y ^= (y << 7) & 0x9D2C5680
    y ^= (y << 15) & 0xEFC60000
    y ^= y >> 18
    return y & 0xFFFFFFFF  # type: ignore[return-value]


def uniform(words: Words) -> float:
    """As `Random.random`: in [0, 1), 53 bits."""
    a, b = _word(words) >> 5, _word(words) >> 6
    return (a * 67108864.0 + b) * (1.0 / 9007199254740992.0)


def normal(words: Words, kept: Floats) -> float:
    """As `Random.gauss(0, 1)`."""
    if kept[_HAS] != 0.0:
        kept[_HAS] = 0.0
        return 0.0 + kept[_KEPT] * 1.0  # type: ignore[no-any-return]
    angle = uniform(words) * (2.0 * math.pi)
    size = math.sqrt(-2.0 * math.log(1.0 - uniform(words)))
    kept[_KEPT] = math.sin(angle) * size
    kept[_HAS] = 1.0
    return 0.0 + math.cos(angle) * size * 1.0
