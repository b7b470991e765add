"""The assumptions of a tracker: motion models, sensors, gates, mode switching, clutter, priors.

Depends on `mixture` and `linalg` alone, and contains no filter. Open `model.py` first, then `kalman.py`.
"""

from gmr_gym.models.clutter import Clutter, uniform_clutter
from gmr_gym.models.kalman import Motion, Sensor, motion, position_sensor, sensor
from gmr_gym.models.model import Model, model
from gmr_gym.models.motions import constant_velocity
from gmr_gym.models.multi_target import MultiTargetModel, multi_target_model

__all__ = [
    "Clutter", "Model", "Motion", "MultiTargetModel", "Sensor", "constant_velocity", "model", "motion",
    "multi_target_model", "position_sensor", "sensor", "uniform_clutter",
]  # fmt: skip
