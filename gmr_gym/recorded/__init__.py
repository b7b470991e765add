"""Files of detections: read in whatever units and coordinates they have, cut into scans, tracked."""

from gmr_gym.recorded.configuration import Configuration, SensorSettings, read_configuration
from gmr_gym.recorded.detections import Detections, SensorSpec, from_arrays
from gmr_gym.recorded.reading import read
from gmr_gym.recorded.scans import Scan

__all__ = [
    "Configuration",
    "Detections",
    "Scan",
    "SensorSettings",
    "SensorSpec",
    "from_arrays",
    "read",
    "read_configuration",
]
