"""Files of detections: read in whatever units and coordinates they have, cut into scans, tracked."""

from gmr_gym.recorded.configuration import Configuration, read_configuration
from gmr_gym.recorded.detections import Detections, SensorSpec, from_arrays
from gmr_gym.recorded.model import TrackingModel, tracking_model
from gmr_gym.recorded.proposal import Proposal, propose
from gmr_gym.recorded.reading import read
from gmr_gym.recorded.scans import Scan, cut
from gmr_gym.recorded.sensor_settings import SensorSettings
from gmr_gym.recorded.smoothing import smooth
from gmr_gym.recorded.tracking import LiveTracker, track
from gmr_gym.recorded.tracks import STATUS, Tracks

__all__ = [
    "STATUS", "Configuration", "Detections", "LiveTracker", "Proposal", "Scan", "SensorSettings",
    "SensorSpec", "TrackingModel", "Tracks", "cut", "from_arrays", "propose", "read", "read_configuration",
    "smooth", "track", "tracking_model",
]  # fmt: skip
