"""The Gaussian-mixture PHD filter: predict, update, reduce, and report targets (Vo and Ma 2006).

The intensity's weights are expected numbers of targets. Only detections, survival, births, spawning and
pruning change their sum.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gmr_gym.filters.intensity_update import log_ratios, posteriors
from gmr_gym.filters.tracker import MultiTargetReport
from gmr_gym.kernels import kernel
from gmr_gym.mixture import Mixture, joined
from gmr_gym.models.clutter import Clutter
from gmr_gym.models.kalman import Sensor
from gmr_gym.models.kalman import predict as predict_components
from gmr_gym.models.multi_target import MultiTargetModel
from gmr_gym.reduction.protocol import Reduced
from gmr_gym.reduction.pruning import capping


class LabelledIntensity(NamedTuple):
    """An intensity whose components have labels of targets.

    Attributes
    ----------
    intensity : Mixture
        n components.
    label : ndarray, shape (n,)
        Label of each; several components may share one.
    next_label : int
        Next unused label.
    """

    intensity: Mixture
    label: np.ndarray
    next_label: int


def initial(model: MultiTargetModel) -> LabelledIntensity:
    """The intensity one period before the first scan.

    Parameters
    ----------
    model : MultiTargetModel

    Returns
    -------
    LabelledIntensity
    """
    n = len(model.initial.w)
    return LabelledIntensity(model.initial, np.arange(n), n)


def predict(belief: LabelledIntensity, model: MultiTargetModel) -> LabelledIntensity:
    """Predict the intensity by one period: surviving, spawned and born targets.

    Spawned targets are distributed around their parent's prediction. They and the born have new labels.

    Parameters
    ----------
    belief : LabelledIntensity
    model : MultiTargetModel

    Returns
    -------
    LabelledIntensity

    References
    ----------
    Vo and Ma 2006, eqs. 24-29.
    """
    moved = predict_components(belief.intensity, model.motion)
    parts = [moved._replace(w=model.survival_probability * moved.w)]
    if model.spawn_weight > 0:
        parts.append(Mixture(model.spawn_weight * moved.w, moved.m, moved.P + model.spawn_covariance))
    intensity = joined([*parts, model.births])
    new = len(intensity.w) - len(moved.w)
    label = np.append(belief.label, belief.next_label + np.arange(new))
    return LabelledIntensity(intensity, label, belief.next_label + new)


def update(
    predicted: LabelledIntensity,
    sensor: Sensor,
    z: np.ndarray,
    detection_probability: float,
    kappa: np.ndarray,
    prune_weight: float,
) -> tuple[LabelledIntensity, np.ndarray]:
    r"""Update the intensity with a scan.

    Parameters
    ----------
    predicted : LabelledIntensity
    sensor : Sensor
    z : ndarray, shape (k, p)
        Detections.
    detection_probability : float
        P_D.
    kappa : ndarray, shape (k,)
        Intensity of clutter at the detections.
    prune_weight : float
        Components below `prune_weight` are dropped; the weights of the rest are not rescaled.

    Returns
    -------
    posterior : LabelledIntensity
        Every component with a missed detection and with every detection; labels are the parents'.
    p_clutter : ndarray, shape (k,)
        Probability that each detection is a false alarm.

    Notes
    -----
    .. math::

        w_{i0} = (1 - P_D) w_i, \qquad
        w_i(z) = \frac{P_D w_i \mathcal{N}(z; H m_i, S_i)}
                      {\kappa(z) + P_D \sum_l w_l \mathcal{N}(z; H m_l, S_l)}

    and a detection is a false alarm with probability

    .. math:: \frac{\kappa(z)}{\kappa(z) + P_D \sum_l w_l \mathcal{N}(z; H m_l, S_l)}

    References
    ----------
    Vo and Ma 2006, eqs. 30-35.
    """
    p = predicted.intensity
    predicted_z = sensor.predict_detections(p, *sensor.gates(p), z)
    posterior, parent, p_clutter = _updated(
        p, predicted_z, np.log(kappa), detection_probability, prune_weight
    )
    return predicted._replace(intensity=posterior, label=predicted.label[parent]), p_clutter


def reduce_intensity(
    belief: LabelledIntensity, reduce: Callable[[Mixture], Reduced], max_components: int
) -> LabelledIntensity:
    """Reduce the intensity; a merged component keeps the label of its heaviest part.

    Parameters
    ----------
    belief : LabelledIntensity
    reduce : callable
        A reduction of a Mixture.
    max_components : int
        Most components that enter `reduce`; the heaviest are kept.

    Returns
    -------
    LabelledIntensity
    """
    p, label, next_label = belief
    if len(p.w) == 0:
        return belief
    if len(p.w) > max_components:
        p, place = capping(p, max_components)
        label = label[place >= 0]
    q, origin = reduce(p)
    return LabelledIntensity(q, labels_of_heaviest(p.w, label, origin, len(q.w)), next_label)


def labels_of_heaviest(w: np.ndarray, label: np.ndarray, origin: np.ndarray, count: int) -> np.ndarray:
    """Label (count,) of the heaviest of the components that each merged one was made of."""
    heaviest_last = np.argsort(-w, kind="stable")[::-1]
    heaviest_last = heaviest_last[origin[heaviest_last] >= 0]
    merged = np.full(count, -1)
    merged[origin[heaviest_last]] = label[heaviest_last]  # the last write wins: the heaviest
    return merged


def report(
    belief: LabelledIntensity, clutter: Clutter, number: int | None = None
) -> tuple[LabelledIntensity, MultiTargetReport]:
    """Declare targets, by decreasing existence.

    A component of weight w stands for one target of existence min(w, 1), a second of min(w - 1, 1) and so on.
    Those above 1/2 are declared, round(w) in all, or the `number` most certain. A second target of one
    component has no label, -1. Of components that share a label the heaviest keeps it, and the others get
    new ones.

    Parameters
    ----------
    belief : LabelledIntensity
    clutter : Clutter
        Clutter to report.
    number : int, optional
        Number of targets to declare.

    Returns
    -------
    belief : LabelledIntensity
        With the labels of the declared targets.
    report : MultiTargetReport

    References
    ----------
    Vo and Ma 2006, Table III.
    """
    p, label, next_label = belief
    copies = np.ceil(p.w - (0.5 if number is None else 0.0)).clip(0).astype(int)
    at = np.repeat(np.arange(len(p.w)), copies)
    copy = np.arange(len(at)) - np.repeat(np.cumsum(copies) - copies, copies)
    existence = np.minimum(p.w[at] - copy, 1.0)
    order = np.lexsort((-p.w[at], -existence))[:number]
    at, copy, existence = at[order], copy[order], existence[order]
    first = at[copy == 0]  # heaviest first
    _, keeps = np.unique(label[first], return_index=True)
    others = np.delete(first, keeps)
    label = label.copy()
    label[others] = next_label + np.arange(len(others))
    out = MultiTargetReport(
        p.m[at], existence, np.where(copy == 0, label[at], -1), float(p.w.sum()), p, clutter
    )
    return LabelledIntensity(p, label, next_label + len(others)), out


@kernel
def _updated(predicted, predicted_z, log_kappa, detection_probability, least):
    z_hat, S, z = predicted_z.z_hat, predicted_z.S, predicted_z.z[0]
    table = log_ratios(predicted.w, z_hat, S, z, log_kappa, detection_probability)
    n, k = table.shape
    top = np.zeros(k)  # log ratio of the clutter to itself
    for i in range(n):
        for j in range(k):
            top[j] = max(top[j], table[i, j])
    p_clutter = np.exp(-top)
    total = p_clutter.copy()
    for i in range(n):
        for j in range(k):
            if table[i, j] > -np.inf:
                table[i, j] = np.exp(table[i, j] - top[j])
                total[j] += table[i, j]
            else:
                table[i, j] = 0.0
    for i in range(n):
        for j in range(k):
            table[i, j] /= total[j]
    missed = Mixture((1.0 - detection_probability) * predicted.w, predicted.m, predicted.P)
    return *posteriors(missed, table, predicted_z, least), p_clutter / total
