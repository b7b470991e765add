"""Pictures of reduced mixtures show all that is there."""

import numpy as np

from gmr_gym.experiments.reduction_pictures import picture
from gmr_gym.mixture import log_density, mixture
from gmr_gym.reduction import runnalls


def test_a_density_is_drawn_to_its_peaks_however_narrow_they_are():
    p = mixture([0.5, 0.2, 0.3], [[0.0], [1.23456], [1e6]], [[[1.0]], [[1e-8]], [[4.0]]])
    (panel,) = picture(p, {"runnalls": runnalls(p, 3)}, (0, 1)).axes
    full, *_ = panel.get_lines()
    x, density = full.get_data()
    assert (np.diff(x) > 0).all() and x[0] == -4.0 and x[-1] == 1e6 + 8.0
    for peak in p.m:
        near = np.abs(x - peak) < 1e-3
        assert density[near].max() > 0.99 * np.exp(log_density(p, peak[None]))[0]
