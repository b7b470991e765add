"""Counter-based random numbers: any number is drawn from a key and a counter, without those before it.

Philox4x32-10 (Salmon, Moraes, Dror and Shaw 2011): two words of key and four of counter give four words of
32 bits. The first word of the counter holds the stream and, in its lower 28 bits, the number of the draw; the
other three are the caller's `at`: a scan and a cell of the ground. Words are kept in 64 bits, so that their
products fit; the compiler turns the loops into vectors of eight lanes.
"""

import math

import numpy as np

from gmr_gym.kernels import kernel, leaf_kernel

ROUNDS = 10
MULTIPLIERS = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
WEYL = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
WORD, HALF = np.uint64(0xFFFFFFFF), np.uint64(32)
DRAWS = 28  # bits of the first word that count the draws of a stream
LANES = 8  # of a vector; the number of words drawn is rounded up to a multiple of it
FEW = 10.0  # Poisson rate below which uniforms are multiplied; transformed rejection needs a larger one


# inlined as source: a loop with a call in it is not vectorised
@kernel(inline="always")
def block(c0, c1, c2, c3, k0, k1):
    """The four words of a counter c (4 words) under a key k (2 words), all uint64 below 2**32."""
    for _ in range(ROUNDS):
        a, b = MULTIPLIERS[0] * c0, MULTIPLIERS[1] * c2
        c0, c1, c2, c3 = (b >> HALF) ^ c1 ^ k0, b & WORD, (a >> HALF) ^ c3 ^ k1, a & WORD
        k0, k1 = (k0 + WEYL[0]) & WORD, (k1 + WEYL[1]) & WORD
    return c0, c1, c2, c3


@kernel(inline="always")
def uniform(a, b):
    """Two words as a number in [0, 1), a multiple of 2**-53."""
    return np.float64(np.int64(((a << HALF) | b) >> np.uint64(11))) * 2.0**-53


@leaf_kernel
def pair(key, stream, draw, at):
    """Two uniforms in [0, 1) of key (2,), stream, draw and the counter words `at` (3,)."""
    a, b, c, d = block(
        np.uint64((stream << DRAWS) + draw), np.uint64(at[0]), np.uint64(at[1]), np.uint64(at[2]),
        np.uint64(key[0]), np.uint64(key[1]),
    )  # fmt: skip
    return uniform(a, b), uniform(c, d)


@leaf_kernel
def points_into(z, low, high, centre, key, stream, at, buffer):
    """Fills z (n, p) with points, uniform between low and high (p,) about centre (p,).

    z is contiguous. Row i takes the i-th pairs of the stream and of those after it, one pair
    for two coordinates. `buffer` comes from `buffer_for`.
    """
    n, p = z.shape
    flat = z.reshape(-1)
    w0, w1, w2, w3 = buffer[0], buffer[1], buffer[2], buffer[3]
    c1, c2, c3 = np.uint64(at[0]), np.uint64(at[1]), np.uint64(at[2])
    k0, k1 = np.uint64(key[0]), np.uint64(key[1])
    for c in range(0, p, 2):
        first = np.uint32((stream + c // 2) << DRAWS)
        # words first, numbers after them: two loops are vectorised, one loop of both would not be. The number
        # of words is a multiple of the lanes, so that none is left for a scalar loop
        for i in range((n + LANES - 1) & -LANES):
            w0[i], w1[i], w2[i], w3[i] = block(np.uint64(first + np.uint32(i)), c1, c2, c3, k0, k1)
        start = low[c] + centre[c]
        side = high[c] + centre[c] - start
        if p == 2:
            other = low[1] + centre[1]
            length = high[1] + centre[1] - other
            for i in range(n):
                u = start + side * uniform(np.uint64(w0[i]), np.uint64(w1[i]))
                v = other + length * uniform(np.uint64(w2[i]), np.uint64(w3[i]))
                flat[2 * i] = u
                flat[2 * i + 1] = v
            return
        for i in range(n):
            flat[p * i + c] = start + side * uniform(np.uint64(w0[i]), np.uint64(w1[i]))
        if c + 1 < p:
            start = low[c + 1] + centre[c + 1]
            side = high[c + 1] + centre[c + 1] - start
            for i in range(n):
                flat[p * i + c + 1] = start + side * uniform(np.uint64(w2[i]), np.uint64(w3[i]))


@kernel(plain_first=True)
def buffer_for(n):
    """Buffer for the words of n points, which `points_into` writes to; it may be used again."""
    return np.empty((4, n + LANES), np.uint32)


@leaf_kernel
def normals_into(out, key, stream, at):
    """Fills out (n,) with standard normals, two of every pair of uniforms (Box and Muller 1958)."""
    for i in range(0, len(out), 2):
        u, v = pair(key, stream, i // 2, at)
        length = math.sqrt(-2.0 * math.log(1.0 - u))
        out[i] = length * math.cos(2.0 * math.pi * v)
        if i + 1 < len(out):
            out[i + 1] = length * math.sin(2.0 * math.pi * v)


@leaf_kernel
def poisson(rate, key, stream, at):
    """A Poisson number of the given rate, at least 0.

    By transformed rejection with squeeze (Hörmann 1993, PTRS); below the rate `FEW` by multiplying uniforms
    until their product is at most exp(-rate).
    """
    draw = np.int64(0)
    if rate < FEW:
        least, product, count = math.exp(-rate), 1.0, 0
        while True:
            u, v = pair(key, stream, draw, at)
            product *= u
            if product <= least:
                return count
            product *= v
            if product <= least:
                return count + 1
            count += 2
            draw += 1
    b = 0.931 + 2.53 * math.sqrt(rate)
    a = -0.059 + 0.02483 * b
    squeeze = 0.9277 - 3.6224 / (b - 2.0)
    while True:
        u, v = pair(key, stream, draw, at)
        draw += 1
        u -= 0.5
        inside = 0.5 - abs(u)
        if inside < 0.013 and v > inside:
            continue
        count = math.floor((2.0 * a / inside + b) * u + rate + 0.43)
        if inside >= 0.07 and v <= squeeze:
            return int(count)
        if count < 0:
            continue
        log_inverse_alpha = math.log(1.1239 + 1.1328 / (b - 3.4))
        log_ratio = math.log(v) + log_inverse_alpha - math.log(a / (inside * inside) + b)
        if log_ratio <= count * math.log(rate) - rate - math.lgamma(count + 1.0):
            return int(count)
