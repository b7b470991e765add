"""Keys of many episodes at once: NumPy's SeedSequence, compiled."""

import numpy as np
from numba import njit

POOL = 4  # words of 32 bits
# of O'Neill's seed_seq, as numpy/random/bit_generator.pyx has them
FIRST, FIRST_FACTOR = np.uint32(0x43B0D7E5), np.uint32(0x931E8875)
SECOND, SECOND_FACTOR = np.uint32(0x8B51F9DD), np.uint32(0x58F38DED)
LEFT, RIGHT = np.uint32(0xCA01F9DD), np.uint32(0x4973F715)
HALF = np.uint32(16)


@njit(cache=True, error_model="numpy")
def keys_of(seeds):
    """What `simulate.key_of` says of each of the seeds (n,), int64 and not negative: keys (n, 2)."""
    pool, keys = np.empty(POOL, np.uint32), np.empty((len(seeds), 2), np.uint32)
    for n in range(len(seeds)):
        factor = FIRST
        for i in range(POOL):
            word = np.uint32(seeds[n] >> (32 * i)) if i < 2 else np.uint32(0)
            pool[i], factor = _hashed(word, factor, FIRST_FACTOR)
        for source in range(POOL):
            for i in range(POOL):
                if i != source:
                    word, factor = _hashed(pool[source], factor, FIRST_FACTOR)
                    mixed = np.uint32(np.uint32(LEFT * pool[i]) - np.uint32(RIGHT * word))
                    pool[i] = mixed ^ (mixed >> HALF)
        factor = SECOND
        for i in range(keys.shape[1]):
            keys[n, i], factor = _hashed(pool[i], factor, SECOND_FACTOR)
    return keys


@njit(cache=True, error_model="numpy")
def _hashed(word, factor, multiplier):
    """The word hashed by a factor, and the next factor."""
    following = np.uint32(factor * multiplier)
    word = np.uint32((word ^ factor) * following)
    return word ^ (word >> HALF), following
