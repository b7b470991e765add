"""How likely a tracker held every scan of a recording before it saw it: consistency without a truth."""

import numpy as np

from gmr_gym.filters.tracker import Report
from gmr_gym.mixture import Mixture, log_density
from gmr_gym.models.model import Model


def log_likelihood(model: Model, report: Report, before: np.ndarray, z: np.ndarray, volume: float) -> float:
    r"""Log likelihood of a scan given those before it.

    Parameters
    ----------
    model : Model
        What the tracker assumes.
    report : Report
        The tracker's report of the scan.
    before : ndarray (n,)
        Weights of the hypotheses that it kept of the scan before, or of the prior.
    z : ndarray (k, p)
        Detections.
    volume : float
        Of the region in which clutter falls, m^p.

    Raises
    ------
    ValueError
        For a tracker whose gates are neither one for each hypothesis nor one for all.

    Notes
    -----
    With clutter density :math:`\lambda` in a volume V and the predicted detections :math:`\hat z_i` of
    hypotheses of weight :math:`w_i`,

    .. math::

       k \ln\lambda - \lambda V + \ln\Big(1 - P_D
           + \frac{P_D}{\lambda} \sum_{j=1}^{k} \sum_i w_i N(z_j; \hat z_i, S_i)\Big)

    less ln k!, which no parameter changes. It is of all detections, gated or not.

    Examples
    --------
    >>> import numpy as np
    >>> from gmr_gym.evaluation.innovations import log_likelihood
    >>> from gmr_gym.filters.registry import make_tracker
    >>> from gmr_gym.scenarios.dortenzio import turning_target
    >>> tracker = make_tracker("pda", turning_target().model)
    >>> z = np.array([[10.0, -10.0]])
    >>> _, report = tracker.step(tracker.init(), z)
    >>> round(log_likelihood(tracker.model, report, np.ones(1), z, volume=1e4), 2)
    -7.96
    """
    n, density = len(report.gates.z), model.clutter_density
    if n == 1:
        before = np.ones(1)
    elif len(before) != n:
        raise ValueError(
            "the likelihood needs a gate for each hypothesis of the scan before, or one for all: this one "
            f"has {n} gates and kept {len(before)} hypotheses; choose another, such as pda or runnalls-10"
        )
    predicted = Mixture(before / before.sum(), report.gates.z, report.gates.S)
    found = np.exp(log_density(predicted, z)).sum() if len(z) else 0.0
    detection = model.detection_probability
    return float(
        len(z) * np.log(density) - density * volume + np.log(1 - detection + detection * found / density)
    )
