"""
Gaussian-mixture MHT on Stone Soup's simulator
==============================================

A simulator, models and plotters of Stone Soup; a tracker of gmr_gym between them.
"""

# %%
# A target of nearly constant velocity, in clutter
# ------------------------------------------------
# All of it is Stone Soup's; `seeded_copies` gives all parts of a simulator one seed.

from datetime import datetime

import numpy as np
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
from stonesoup.plotter import AnimatedPlotterly, Plotter
from stonesoup.simulator.simple import SimpleDetectionSimulator, SingleTargetGroundTruthSimulator
from stonesoup.types.state import GaussianState

from gmr_gym.stonesoup import MhtTracker, seeded_copies

start = datetime(2024, 5, 1)
transition_model = CombinedLinearGaussianTransitionModel([ConstantVelocity(0.5)] * 2)
measurement_model = LinearGaussian(ndim_state=4, mapping=(0, 2), noise_covar=25 * np.eye(2))
prior = GaussianState([0, 12, 0, 5], np.diag([100, 25, 100, 25]), timestamp=start)
truth = SingleTargetGroundTruthSimulator(transition_model, prior, number_steps=40)
simulator = SimpleDetectionSimulator(
    truth, measurement_model, np.array([[-50, 600], [-150, 350]]), detection_probability=0.9, clutter_rate=40
)
(detector,) = seeded_copies(simulator, 1, seed=7)

# %%
# The tracker
# -----------
# It takes the detector, and gives tracks. Every state has the hypotheses of which it is the mean.

tracker = MhtTracker(
    prior=prior,
    transition_model=transition_model,
    measurement_model=measurement_model,
    clutter_spatial_density=detector.clutter_spatial_density,
    prob_detect=0.9,
    detector=detector,
    parameters={"components": 10, "reduction": "runnalls"},
)
tracks, detections = set(), []
for _, current in tracker:
    tracks |= current
    detections.append(set(detector.detections))

# %%
# Stone Soup's plotters
# ---------------------
# That of Matplotlib, and that of Plotly, which moves.

plotter = Plotter()
plotter.plot_ground_truths(detector.groundtruth.groundtruth_paths, [0, 2])
plotter.plot_measurements(set().union(*detections), [0, 2])
plotter.plot_tracks(tracks, [0, 2], uncertainty=True)
plotter.fig.savefig("stone-soup.png")

(track,) = tracks
moving = AnimatedPlotterly([state.timestamp for state in track[1:]], tail_length=1)
moving.plot_ground_truths(detector.groundtruth.groundtruth_paths, [0, 2])
moving.plot_measurements(set().union(*detections), [0, 2])
moving.plot_tracks(tracks, [0, 2], uncertainty=True)
moving.fig.write_html("stone-soup.html", include_plotlyjs="cdn")

# %%
# How far off it is
# -----------------
# The hypotheses of the last state, and the error of its mean.

(path,) = detector.groundtruth.groundtruth_paths
error = np.linalg.norm((track.state_vector - path.state_vector)[[0, 2]])
print(f"{len(track.components)} hypotheses, {error:.1f} m off")
