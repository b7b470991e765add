"""Labels of estimates: what says which estimates of different scans are of one target."""

from collections.abc import Sequence
from itertools import count

import numpy as np

from gmr_gym.evaluation.trajectory_metrics import by_label, trajectory_gospa


def labels_of(rows: np.ndarray, counted: np.ndarray, where: str = "") -> np.ndarray:
    """Labels of the rows of an action that count.

    Parameters
    ----------
    rows : ndarray (targets, 2 + d)
        Rows [existence, state, label].
    counted : ndarray (targets,)
        Whether a row counts as an estimate.
    where : str
        What is added to an error.

    Returns
    -------
    ndarray (j,) of int
        The whole numbers next to the labels; negative for an estimate without one.

    Raises
    ------
    ValueError
        Where two estimates have the same label.
    """
    label, row = np.rint(rows[counted, -1]).astype(int), np.flatnonzero(counted)
    order = np.argsort(label, kind="stable")
    same = np.flatnonzero((np.diff(label[order]) == 0) & (label[order][1:] >= 0))
    if len(same):
        one, other = order[same[0]], order[same[0] + 1]
        raise ValueError(
            "labels, the last column, must differ among the estimates of a scan, "
            f"got {label[one]} in the rows {row[one]} and {row[other]}{where}"
        )
    return label


class Trajectories:
    """The estimates of an episode so far by label, compared with the true paths.

    Parameters
    ----------
    cutoff, order, switching : float
        As for `gmr_gym.evaluation.trajectory_metrics.trajectory_gospa`.
    """

    def __init__(self, cutoff: float, order: float, switching: float):
        self._rule = cutoff, order, switching
        self._scans: list[dict[int, np.ndarray]] = []  # label -> position, of each scan
        self._truth: list[np.ndarray] = []
        self._unlabelled = count(-1, -1)
        self._total = 0.0

    def grown_by(self, at: np.ndarray, labels: Sequence[int] | np.ndarray, truth: np.ndarray) -> float:
        """Adds a scan.

        Parameters
        ----------
        at : ndarray (j, p)
            Estimated positions, m.
        labels : sequence of int (j,)
            Negative for an estimate without one, which is a trajectory of one scan.
        truth : ndarray (m, p)
            True positions, m; nan where a target is absent.

        Returns
        -------
        float
            By how much the distance of the trajectories has grown, m.
        """
        names = [int(label) if label >= 0 else next(self._unlabelled) for label in labels]
        self._scans.append(dict(zip(names, at, strict=True)))
        self._truth.append(truth)
        tracks = by_label(self._scans, truth.shape[1])
        total = trajectory_gospa(tracks, np.array(self._truth), *self._rule).total
        grown, self._total = total - self._total, total
        return grown
