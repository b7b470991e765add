"""Files of detections: read in whatever units and coordinates they have, cut into scans, tracked."""

from gmr_gym.recorded.detections import Detections, SensorSpec, from_arrays
from gmr_gym.recorded.scans import Scan

__all__ = ["Detections", "Scan", "SensorSpec", "from_arrays"]
