"""The k best assignments of rows to columns, and of tracks to detections."""

import numpy as np

from gmr_gym.kernels import kernel, leaf_kernel


@kernel
def ranked_assignments(cost, count, spread=np.inf):
    r"""The assignments of least cost, best first.

    Every row has one column, and no column two rows.

    Parameters
    ----------
    cost : ndarray, shape (n, m)
        Infinite where a row cannot have a column; neither minus infinity nor nan.
    count : int
        Most assignments.
    spread : float
        Assignments that cost more than the best one by more than this are left out.

    Returns
    -------
    columns : ndarray of int, shape (j, n)
        Fewer than `count` where no more are possible.
    costs : ndarray, shape (j,)

    Notes
    -----
    Murty's partition: a set of assignments without its best one is split by the first row whose column is
    another than in that. The best one of each part follows by one shortest augmenting path from the dual
    variables of the set (Miller, Stone and Cox 1997), over the reduced costs

    .. math:: c_{ij} - u_i - v_j \ge 0

    Columns that no row has are those of one more row, of cost 0; Crouse 2016 adds as many rows as make the
    matrix square. Only as many parts are kept as assignments are still to be found.

    References
    ----------
    Murty 1968; Miller, Stone and Cox 1997; Crouse 2016.

    Examples
    --------
    >>> columns, costs = ranked_assignments(np.array([[1.0, 2.0, np.inf], [1.0, 5.0, 3.0]]), 2)
    >>> columns.tolist(), costs.tolist()
    ([[1, 0], [0, 2]], [3.0, 4.0])
    """
    n, m = cost.shape
    count = _at_most(cost, count)
    padded = np.zeros((n + 1, m))
    padded[:n] = cost
    columns, costs, found = np.empty((count, n), np.int64), np.empty(count), 0
    # Sets of assignments, each with its best one. `queue` has first those that wait, by increasing cost, then
    # those that are free, and last the one that is being split.
    column, first = np.full((count + 1, n + 1), -1), np.zeros(count + 1, np.int64)
    u, v, barred = np.zeros((count + 1, n + 1)), np.zeros((count + 1, m)), np.zeros((count + 1, m), np.bool_)
    value, queue, waiting = np.empty(count + 1), np.arange(count + 1), 0
    row, room = np.full(m, -1), (np.empty(m), np.empty(m, np.int64), np.empty(m, np.bool_))
    sets = column, u, v, barred
    if count > 0 and n <= m:
        waiting = 1
        for i in range(n):
            if waiting and not _augment(0, i, 0, padded, sets, row, np.inf, room):
                waiting = 0
        value[0] = _cost(padded, column[0]) if waiting else 0.0
        spread += value[0]
    while waiting:
        split, left = queue[0], count - found - 1
        for i in range(n):
            columns[found, i] = column[split, i]
        costs[found] = value[split]
        found += 1
        for a in range(waiting - 1):
            queue[a] = queue[a + 1]
        queue[waiting - 1], queue[count] = queue[count], split
        waiting = min(waiting - 1, left)
        for i in range(first[split], n if left else 0):
            part = queue[count - 1]
            last = value[queue[waiting - 1]] if waiting == left else spread
            _branch(split, part, i, i == first[split], sets, row)
            if _augment(part, i, i, padded, sets, row, min(spread, last) - value[split], room):
                first[part], value[part] = i, _cost(padded, column[part])
                waiting = _insert(queue, value, waiting, left)
    return columns[:found], costs[:found]


@leaf_kernel
def _branch(split, part, i, again, sets, row):
    """Makes set `part` those of set `split` in which row i has another column than in its best assignment;
    `again` where that row has been barred from columns before. row (m,) becomes the row of each column."""
    column, u, v, barred = sets
    n, m = column.shape[1] - 1, len(row)
    for j in range(m):
        v[part, j], row[j] = v[split, j], n
        barred[part, j] = again and barred[split, j]
    for r in range(n + 1):
        column[part, r], u[part, r] = column[split, r], u[split, r]
    for r in range(n):
        row[column[split, r]] = r
    barred[part, column[split, i]] = True
    row[column[split, i]] = -1


@leaf_kernel
def _at_most(cost, count):
    """The count, or the number of choices of a possible column for every row where that is less."""
    choices = 1.0
    for i in range(len(cost)):
        if choices < count:
            possible = 0
            for j in range(cost.shape[1]):
                possible += cost[i, j] < np.inf
            choices *= possible
    return int(min(choices, count))


@leaf_kernel
def _augment(part, start, fixed, cost, sets, row, limit, room):
    """Gives row `start` of a set a column by the shortest augmenting path; False where none is up to `limit`.

    Column (n + 1,) of each row, row (m,) of each column, u (n + 1,) and v (m,) are changed in place. The path
    ends at a column whose row is -1. Rows before `fixed` keep their columns; row `start` cannot have those
    that are barred.
    """
    column, u, v, barred = sets[0][part], sets[1][part], sets[2][part], sets[3][part]
    (distance, before, done), n, m = room, len(cost) - 1, len(row)
    for j in range(m):
        distance[j], done[j] = np.inf, False
    for r in range(fixed):
        done[column[r]] = True
    i, reached, sink, spare = start, 0.0, -1, False
    while sink < 0:
        if not (i == n and spare):  # all spare columns are at one distance
            spare |= i == n
            for j in range(m):
                if not done[j] and not (i == start and barred[j]):
                    through = reached + (cost[i, j] - u[i] - v[j])
                    if through < distance[j]:
                        distance[j], before[j] = through, i
        nearest = -1
        for j in range(m):
            if not done[j] and (nearest < 0 or distance[j] < distance[nearest]):
                nearest = j
        if nearest < 0 or not distance[nearest] < np.inf or distance[nearest] > limit:
            return False
        reached, done[nearest], i = distance[nearest], True, row[nearest]
        if i == n and not spare:
            column[n] = nearest
        sink = nearest if i < 0 else -1
    for r in range(fixed):
        done[column[r]] = False
    u[start] += reached
    u[n] += reached - distance[column[n]] if spare else 0.0
    for j in range(m):
        if done[j] and j != sink:
            v[j] -= reached - distance[j]
            if row[j] < n:
                u[row[j]] += reached - distance[j]
    j = sink
    while j >= 0:
        i = before[j]
        row[j] = i
        j, column[i] = (-1 if i == start else column[i]), j
    return True


@leaf_kernel
def _cost(cost, column):
    """Cost of an assignment."""
    total = 0.0
    for i in range(len(cost) - 1):
        total += cost[i, column[i]]
    return total


@leaf_kernel
def _insert(queue, value, waiting, left):
    """Puts the last free set among those that wait, at most `left`; returns how many wait."""
    part, place = queue[-2], waiting
    while place > 0 and value[part] < value[queue[place - 1]]:
        place -= 1
    if place == left:
        return waiting
    end = min(waiting, left - 1)
    queue[-2] = queue[end]
    for a in range(end, place, -1):
        queue[a] = queue[a - 1]
    queue[place] = part
    return end + 1


@kernel
def ranked_events(log_psi, count, spread=np.inf):
    r"""The association events of greatest weight, best first.

    An event gives each of n tracks one of k detections or none, and no detection to two tracks. Its weight is
    the product of :math:`\psi_{ij}` over its pairs.

    Parameters
    ----------
    log_psi : ndarray, shape (n, k)
        Log weight of each pair; minus infinity where it is impossible.
    count : int
        Most events.
    spread : float
        Events whose log weight is less than the greatest by more than this are left out.

    Returns
    -------
    detection : ndarray of int, shape (j, n)
        That of each track, -1 for none.
    log_weight : ndarray, shape (j,)

    Examples
    --------
    >>> detection, log_weight = ranked_events(np.log(np.array([[8.0, 3.0], [2.0, 0.5]])), 3)
    >>> detection.tolist(), np.exp(log_weight).round(3).tolist()
    ([[0, -1], [1, 0], [0, 1]], [8.0, 6.0, 4.0])
    """
    n, k = log_psi.shape
    cost = np.full((n, k + n), np.inf)
    for i in range(n):
        cost[i, k + i] = 0.0
        for j in range(k):
            cost[i, j] = -log_psi[i, j]
    columns, costs = ranked_assignments(cost, count, spread)
    for c in range(len(costs)):
        costs[c] = -costs[c]
        for i in range(n):
            if columns[c, i] >= k:
                columns[c, i] = -1
    return columns, costs
