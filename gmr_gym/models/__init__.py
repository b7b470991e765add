"""What a tracker assumes: motions, sensors, gates, switching, clutter, priors.

Stands on `mixture` and `linalg` alone, and knows no filter. Open `model.py` first, then `kalman.py`.
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
