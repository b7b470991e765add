"""Keys of many episodes at once: NumPy's SeedSequence, compiled."""

import numpy as np

from gmr_gym.kernels import kernel
from gmr_gym.simulation.philox import HALF, WORD

POOL = 4  # words of 32 bits
# of O'Neill's seed_seq, as numpy/random/bit_generator.pyx has them
FIRST, FIRST_FACTOR = np.uint64(0x43B0D7E5), np.uint64(0x931E8875)
SECOND, SECOND_FACTOR = np.uint64(0x8B51F9DD), np.uint64(0x58F38DED)
LEFT, RIGHT = np.uint64(0xCA01F9DD), np.uint64(0x4973F715)
FOLD, OVER = np.uint64(16), WORD + np.uint64(1)


@kernel
def keys_of(seeds):
    """Keys (n, 2) of the seeds (n,), int64 and not negative; each as `single_target.key_of` gives it."""
    pool, keys = np.zeros(POOL, np.uint64), np.empty((len(seeds), 2), np.uint32)
    for n in range(len(seeds)):
        seed, factor = np.uint64(seeds[n]), FIRST
        for i in range(POOL):  # missing words of a seed are hashed as zeros
            pool[i], factor = _hashed(seed & WORD, factor, FIRST_FACTOR)
            seed >>= HALF
        for source in range(POOL):
            for i in range(POOL):
                if i != source:
                    word, factor = _hashed(pool[source], factor, FIRST_FACTOR)
                    # OVER keeps the difference of products from going below zero
                    less = (RIGHT * word) & WORD
                    mixed = (((LEFT * pool[i]) & WORD) + OVER - less) & WORD
                    pool[i] = mixed ^ (mixed >> FOLD)
        factor = SECOND
        for i in range(keys.shape[1]):
            keys[n, i], factor = _hashed(pool[i], factor, SECOND_FACTOR)
    return keys


@kernel
def _hashed(word, factor, multiplier):
    """The word hashed by a factor, and the next factor."""
    following = (factor * multiplier) & WORD
    word = ((word ^ factor) * following) & WORD
    return word ^ (word >> FOLD), following
