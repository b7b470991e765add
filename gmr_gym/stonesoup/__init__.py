"""The bridge to Stone Soup: reductions, an IMM and trackers as its components, and its trackers, simulators
and readers as those here.

Needs the extra `stonesoup`; `stonesoup.plugins.gmr_gym` is the same module. Open `trackers.py` first, then
`models.py`, which says what has a counterpart.
"""

from gmr_gym.stonesoup.available import STONE_SOUP
from gmr_gym.stonesoup.detections import ScanReader, detections_of, scan_of
from gmr_gym.stonesoup.imm import ImmPredictor, ImmUpdater
from gmr_gym.stonesoup.mixtures import components_of, mixture_of
from gmr_gym.stonesoup.models import (
    measurement_model_of,
    model_of,
    motion_of,
    sensor_of,
    transition_model_of,
)
from gmr_gym.stonesoup.multi_target import MultiTargetTracker
from gmr_gym.stonesoup.recordings import recording_of, scans_of
from gmr_gym.stonesoup.reducers import Reducer
from gmr_gym.stonesoup.scenarios import (
    episode_of,
    scenario_of,
    seeded_copies,
    single_target_scenario_of,
)
from gmr_gym.stonesoup.stone_soup_trackers import (
    PriorInitiator,
    StoneSoupMultiTargetTracker,
    StoneSoupTracker,
    pda_of,
)
from gmr_gym.stonesoup.trackers import MhtTracker, PdaTracker, SingleTargetTracker
from gmr_gym.stonesoup.tracks import paths_of, track_rows_of, tracks_of, truth_of

__all__ = [
    "STONE_SOUP", "ImmPredictor", "ImmUpdater", "MhtTracker", "MultiTargetTracker", "PdaTracker",
    "PriorInitiator", "Reducer", "ScanReader", "SingleTargetTracker", "StoneSoupMultiTargetTracker",
    "StoneSoupTracker", "components_of", "detections_of", "episode_of", "measurement_model_of", "mixture_of",
    "model_of", "motion_of", "paths_of", "pda_of", "recording_of", "scan_of", "scans_of", "scenario_of",
    "seeded_copies", "sensor_of", "single_target_scenario_of", "track_rows_of", "tracks_of",
    "transition_model_of", "truth_of",
]  # fmt: skip
