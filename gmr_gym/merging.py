"""Greedy merging by Runnalls' cost.

With a = wi / (wi + wj), b = 1 - a, and Pij = a Pi + b Pj + a b (mi - mj)(mi - mj)' the covariance
of the merged pair, merging i and j costs

    B = 1/2 ((wi + wj) log|Pij| - wi log|Pi| - wj log|Pj|)            (D'Ortenzio, eq. 13)

Each pair stands in one row of a table of costs, that of the component born later. A merge then
changes one row, and rows whose least it takes away are searched again only when they come up. Costs
are formed a block of components at a time, component axis last, so that the compiler turns every
loop into vector instructions.
"""

import numpy as np
from numba import njit

BLOCK = 128  # components: a block of 4-D covariances stays in the nearest cache


@njit(cache=True, error_model="numpy")
def merge_greedily(w, m, P, components, budget):
    """Merges the cheapest pair while more than `components` remain or its cost is still within
    `budget`, which every merge lowers: w, m, P and origin (n,) of what is left. The last component
    moves into the place that a merge leaves."""
    n = len(w)
    w, means, entries = by_entry(w, m, P)
    room = np.empty((len(entries), BLOCK)), np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
    w_log_det = weighted_log_determinants(w, entries, room)
    table, born, births = np.empty((n, n)), np.arange(n), n
    # the row's cheapest partner, or -1 when it is gone and the row holds nothing below `least`
    nearest, least = np.full(n, -1), np.zeros(n)
    for i in range(n):
        form_costs(i, i, w, means, entries, w_log_det, room, table[i])
    name, into = np.arange(n), np.arange(n)
    while n > 1:
        i = first_least(least, n)
        if nearest[i] < 0:
            nearest[i], least[i] = _cheapest(table[i], born, born[i], n)
            continue
        if least[i] == np.inf:
            raise ValueError("components lie too far apart to tell what merging them costs")
        budget -= least[i]
        if n <= components and budget < 0.0:
            break
        i, j = min(i, nearest[i]), max(i, nearest[i])
        into[name[j]] = name[i]
        w_log_det[i] = merge_pair(i, j, w, means, entries, room)
        n -= 1
        for r in range(n + 1):
            if nearest[r] == i or nearest[r] == j:
                nearest[r] = -1
            elif nearest[r] == n:
                nearest[r] = j
        if j != n:
            name[j], born[j], w[j], w_log_det[j] = name[n], born[n], w[n], w_log_det[n]
            nearest[j], least[j] = nearest[n], least[n]
            for r in range(len(means)):
                means[r, j] = means[r, n]
            for q in range(len(entries)):
                entries[q, j] = entries[q, n]
            for r in range(n):
                table[j, r], table[r, j] = table[n, r], table[r, n]
        form_costs(i, n, w, means, entries, w_log_det, room, table[i])
        born[i] = births
        births += 1
        nearest[i], least[i] = -1, 0.0
    return _by_component(n, w, means, entries, name, into)


@njit(cache=True, error_model="numpy")
def cost_of_all(w, m, P):
    """Cost of merging everything: the sum of the costs B of any way down to one; and the mean (d,) and
    covariance (d, d) of that one."""
    n, d = m.shape
    weight, mean, covariance = 0.0, np.zeros(d), np.zeros((d, d))
    for i in range(n):
        weight += w[i]
    for i in range(n):
        share = w[i] / weight
        for r in range(d):
            mean[r] += share * m[i, r]
    A, determinant, log_det = np.empty((d * (d + 1) // 2, BLOCK)), np.empty(BLOCK), np.empty(BLOCK)
    apart = 0.0
    for start in range(0, n, BLOCK):
        stop = min(start + BLOCK, n)
        for i in range(start, stop):
            share, q = w[i] / weight, 0
            for r in range(d):
                for c in range(r + 1):
                    A[q, i - start] = P[i, r, c]
                    covariance[r, c] += share * (P[i, r, c] + (m[i, r] - mean[r]) * (m[i, c] - mean[c]))
                    q += 1
        log_determinants(A, stop - start, determinant, log_det)
        for i in range(start, stop):
            apart += w[i] * log_det[i - start]
    q = 0
    for r in range(d):
        for c in range(r + 1):
            A[q, 0] = covariance[c, r] = covariance[r, c]
            q += 1
    log_determinants(A, 1, determinant, log_det)
    return max(0.0, 0.5 * (weight * log_det[0] - apart)), mean, covariance


# no comparison here meets a nan; told so, the compiler vectorises the search for a minimum
@njit(cache=True, error_model="numpy", fastmath={"nnan", "nsz"})
def first_least(row, n):
    least = np.inf
    for j in range(n):
        least = row[j] if row[j] < least else least
    for j in range(n):
        if row[j] == least:
            return j
    return 0


@njit(cache=True, error_model="numpy", fastmath={"nnan", "nsz"})
def _cheapest(row, born, birth, n):
    """Partner of least cost among those of the first n born before `birth`, and the cost; infinite
    where there is none."""
    least = np.inf
    for j in range(n):
        cost = row[j] if born[j] < birth else np.inf
        least = cost if cost < least else least
    for j in range(n):
        if row[j] == least and born[j] < birth:
            return j, least
    return 0, np.inf


@njit(cache=True, error_model="numpy")
def form_costs(i, n, w, means, entries, w_log_det, room, row):
    """Costs of merging component i with 0..n-1, written to row."""
    A, determinant, log_det, share = room
    for start in range(0, n, BLOCK):
        stop = min(start + BLOCK, n)
        if len(means) == 4:
            _planar_determinants(i, start, stop, w, means, entries, determinant)
        else:
            pair_covariances(i, start, stop, w, means, entries, share, A)
            _determinants(A, stop - start, determinant)
        _logarithms(determinant, stop - start, log_det)
        for j in range(start, stop):
            cost = (w[i] + w[j]) * log_det[j - start] - w_log_det[i] - w_log_det[j]
            # beyond 1e8 standard deviations apart the determinant drowns in rounding: never nearest
            known = 0.0 if cost < 0.0 else 0.5 * cost
            row[j] = known if determinant[j - start] > 0.0 else np.inf


@njit(cache=True, error_model="numpy")
def pair_covariances(i, start, stop, w, means, entries, share, A):
    """Covariances by entry of component i merged with each of start..stop-1, written to the first
    columns of A; share is left holding w_i / (w_i + w_j)."""
    n = stop - start
    for j in range(n):
        share[j] = w[i] / (w[i] + w[start + j])
    q = 0
    for r in range(len(means)):
        for c in range(r + 1):
            mean_r, mean_c, entry = means[r, i], means[c, i], entries[q, i]
            others_r, others_c = means[r, start:stop], means[c, start:stop]
            others, target = entries[q, start:stop], A[q]
            for j in range(n):
                spread = (mean_r - others_r[j]) * (mean_c - others_c[j])
                target[j] = share[j] * entry + (1 - share[j]) * (others[j] + share[j] * spread)
            q += 1


@njit(cache=True, error_model="numpy")
def _planar_determinants(i, start, stop, w, means, entries, out):
    """`_determinants` of `pair_covariances` for four states, the case of a planar position and
    velocity, written out: nothing leaves the registers, which halves the time of a reduction."""
    wi, m0i, m1i, m2i, m3i = w[i], means[0, i], means[1, i], means[2, i], means[3, i]
    m0, m1, m2, m3 = means[0, start:], means[1, start:], means[2, start:], means[3, start:]
    q00i, q10i, q11i, q20i, q21i = entries[0, i], entries[1, i], entries[2, i], entries[3, i], entries[4, i]
    q22i, q30i, q31i, q32i, q33i = entries[5, i], entries[6, i], entries[7, i], entries[8, i], entries[9, i]
    q00, q10, q11 = entries[0, start:], entries[1, start:], entries[2, start:]
    q20, q21, q22 = entries[3, start:], entries[4, start:], entries[5, start:]
    q30, q31, q32, q33 = entries[6, start:], entries[7, start:], entries[8, start:], entries[9, start:]
    others = w[start:]
    for j in range(stop - start):
        a = wi / (wi + others[j])
        b = 1 - a
        c = a * b
        d0, d1, d2, d3 = m0i - m0[j], m1i - m1[j], m2i - m2[j], m3i - m3[j]
        p00 = a * q00i + b * q00[j] + c * d0 * d0
        p10, p11 = a * q10i + b * q10[j] + c * d1 * d0, a * q11i + b * q11[j] + c * d1 * d1
        p20, p21 = a * q20i + b * q20[j] + c * d2 * d0, a * q21i + b * q21[j] + c * d2 * d1
        p30, p31 = a * q30i + b * q30[j] + c * d3 * d0, a * q31i + b * q31[j] + c * d3 * d1
        p22, p32 = a * q22i + b * q22[j] + c * d2 * d2, a * q32i + b * q32[j] + c * d3 * d2
        p33 = a * q33i + b * q33[j] + c * d3 * d3
        r1, r2, r3 = p10 / p00, p20 / p00, p30 / p00
        p11, p21, p31 = p11 - r1 * p10, p21 - r2 * p10, p31 - r3 * p10
        p22, p32, p33 = p22 - r2 * p20, p32 - r3 * p20, p33 - r3 * p30
        r2, r3 = p21 / p11, p31 / p11
        p22, p32, p33 = p22 - r2 * p21, p32 - r3 * p21, p33 - r3 * p31
        out[j] = p00 * p11 * p22 * (p33 - p32 / p22 * p32)


@njit(cache=True, error_model="numpy")
def merge_pair(i, j, w, means, entries, room):
    """Writes the moment match of i and j to place i; returns its weight times log determinant."""
    A, determinant, log_det, share = room
    pair_covariances(i, j, j + 1, w, means, entries, share, A)
    for q in range(len(entries)):
        entries[q, i] = A[q, 0]
    for r in range(len(means)):
        means[r, i] = share[0] * means[r, i] + (1 - share[0]) * means[r, j]
    w[i] += w[j]
    _determinants(A, 1, determinant)
    _logarithms(determinant, 1, log_det)
    return w[i] * log_det[0]


@njit(cache=True, error_model="numpy")
def weighted_log_determinants(w, entries, room):
    A, determinant, log_det, _ = room
    n = len(w)
    out = np.empty(n)
    for start in range(0, n, BLOCK):
        stop = min(start + BLOCK, n)
        for q in range(len(entries)):
            for j in range(start, stop):
                A[q, j - start] = entries[q, j]
        log_determinants(A, stop - start, determinant, log_det)
        for j in range(start, stop):
            out[j] = w[j] * log_det[j - start]
    return out


@njit(cache=True, error_model="numpy")
def log_determinants(A, n, determinant, log_det):
    """Logarithms of the determinants of the first n matrices of `_determinants`; A is overwritten. Raises
    ValueError for one that is not positive definite."""
    _determinants(A, n, determinant)
    for j in range(n):
        if not 1e-300 < determinant[j] < 1e300:
            raise ValueError(
                "a covariance of the mixture is not positive definite, or its determinant lies "
                "outside 1e-300 to 1e300: choose units nearer to the spread of the states"
            )
    _logarithms(determinant, n, log_det)


@njit(cache=True, error_model="numpy")
def _determinants(A, n, out):
    """Determinants of the first n symmetric matrices given by entry, A (d (d + 1) / 2, n), by LDL'
    without square roots; A is overwritten."""
    for j in range(n):
        out[j] = 1.0
    d = int(np.sqrt(2 * len(A)))
    for k in range(d):
        pivot = A[k * (k + 3) // 2]
        for j in range(n):
            out[j] *= pivot[j]
            pivot[j] = 1.0 / pivot[j]
        for r in range(k + 1, d):
            below = A[r * (r + 1) // 2 + k]
            for c in range(k + 1, r + 1):
                target, beside = A[r * (r + 1) // 2 + c], A[c * (c + 1) // 2 + k]
                for j in range(n):
                    target[j] -= below[j] * pivot[j] * beside[j]


@njit(cache=True, error_model="numpy")
def _logarithms(x, n, out):
    """Natural logarithms of the first n of the positive normal numbers x, to the last bit or the
    one before. A call of the library's logarithm would keep the loop from being vectorised."""
    x_bits, mantissa_bits = x.view(np.int64), out.view(np.int64)
    for j in range(n):
        mantissa_bits[j] = (x_bits[j] & 0x000FFFFFFFFFFFFF) | 0x3FF0000000000000
    for j in range(n):
        exponent, mantissa = float((x_bits[j] >> 52) - 1023), out[j]
        above = mantissa > 1.4142135623730951
        mantissa = 0.5 * mantissa if above else mantissa
        exponent = exponent + 1.0 if above else exponent
        # log(mantissa) = 2 (s + s^3/3 + s^5/5 + ...), |s| < 0.172
        s = (mantissa - 1.0) / (mantissa + 1.0)
        s2 = s * s
        # written out, since a loop over the coefficients would not be vectorised over j
        series = 1 / 15 + s2 * (1 / 17 + s2 * (1 / 19 + s2 * (1 / 21)))
        series = 1 / 7 + s2 * (1 / 9 + s2 * (1 / 11 + s2 * (1 / 13 + s2 * series)))
        series = 1 / 3 + s2 * (1 / 5 + s2 * series)
        out[j] = exponent * 0.6931471805599453 + 2.0 * (s + s * s2 * series)


@njit(cache=True, error_model="numpy")
def by_entry(w, m, P):
    """The mixture with the component axis last, so that a loop over components is vectorised: w
    (n,), means (d, n), lower triangles of the covariances row by row (d (d + 1) / 2, n)."""
    n, d = m.shape
    means, entries = np.empty((d, n)), np.empty((d * (d + 1) // 2, n))
    for i in range(n):
        q = 0
        for r in range(d):
            means[r, i] = m[i, r]
            for c in range(r + 1):
                entries[q, i] = P[i, r, c]
                q += 1
    return w.copy(), means, entries


@njit(cache=True, error_model="numpy")
def _by_component(n, w, means, entries, name, into):
    """Undoes `by_entry` for the first n components; origin from the chain of merges `into`."""
    d = len(means)
    m, P = np.empty((n, d)), np.empty((n, d, d))
    place, origin = np.empty(len(into), np.int64), np.empty(len(into), np.int64)
    for i in range(n):
        place[name[i]] = i
        q = 0
        for r in range(d):
            m[i, r] = means[r, i]
            for c in range(r + 1):
                P[i, r, c] = P[i, c, r] = entries[q, i]
                q += 1
    for i in range(len(into)):
        root = i
        while into[root] != root:
            root = into[root]
        origin[i] = place[root]
    return w[:n].copy(), m, P, origin
