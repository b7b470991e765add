"""All targets there are."""

from fuzzing.archives import archive_targets
from fuzzing.between import distance_targets
from fuzzing.cases import Target
from fuzzing.conversions import conversion_targets
from fuzzing.environments import environment_targets
from fuzzing.files import file_targets
from fuzzing.measures import metric_targets
from fuzzing.recorded import recorded_targets
from fuzzing.reductions import reduction_targets
from fuzzing.tracking import tracker_targets


def every_target() -> list[Target]:
    """Every public door; reductions, trackers and environments as the package lists them."""
    return [
        *reduction_targets(),
        *metric_targets(),
        *distance_targets(),
        *conversion_targets(),
        *tracker_targets(),
        *file_targets(),
        *archive_targets(),
        *recorded_targets(),
        *environment_targets(),
    ]
