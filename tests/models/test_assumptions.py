"""Numbers of a filter model changed one by one, by themselves and through the name of a tracker."""

import numpy as np
import pytest

from gmr_gym import make_tracker
from gmr_gym.models.assumptions import assumptions, with_assumptions
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.scenarios.li import airborne_radar
from gmr_gym.scenarios.lv import unknown_clutter
from gmr_gym.scenarios.zhang import jump_markov

TURNING, JUMP, RADAR, MANY = (
    scenario().model for scenario in (turning_target, jump_markov, airborne_radar, unknown_clutter)
)


@pytest.mark.parametrize("model", [TURNING, JUMP, RADAR, MANY], ids=["turning", "jump", "radar", "many"])
def test_what_a_model_assumes_already_changes_nothing(model):
    same = with_assumptions(model, assumptions(model))
    for one, other in zip(same.motions, model.motions, strict=True):
        assert np.array_equal(one.Q, other.Q)
    assert same.sensor.R == pytest.approx(model.sensor.R)
    assert same.switching == pytest.approx(model.switching)
    for field in {"clutter_density", "detection_probability", "gate_probability"} & {*model._fields}:
        assert getattr(same, field) == getattr(model, field)


def test_factors_are_of_standard_deviations_and_of_the_clutter_density():
    changed = with_assumptions(
        TURNING, {"assumed_process_noise": 3, "assumed_measurement_noise": 0.5, "assumed_clutter": 4.0}
    )
    assert changed.motion.Q == pytest.approx(9 * TURNING.motion.Q)
    assert changed.sensor.R == pytest.approx(TURNING.sensor.R / 4)
    assert changed.clutter_density == 4 * TURNING.clutter_density
    thick = with_assumptions(MANY, {"assumed_clutter": 4.0}).clutter
    assert thick.expected == pytest.approx(4 * MANY.clutter.expected)
    wide = with_assumptions(RADAR, {"assumed_measurement_noise": 2})
    assert wide.sensor.deviations == pytest.approx(2 * RADAR.sensor.deviations)


def test_the_modes_that_follow_another_keep_their_ratios():
    switching = np.array([[0.8, 0.1, 0.0], [0.05, 0.9, 0.0], [0.15, 0.0, 1.0]])
    changed = with_assumptions(
        JUMP._replace(motions=JUMP.motions[:3], switching=switching), {"assumed_stay": 0.6}
    )
    wanted = [[0.6, 0.4, 0.2], [0.1, 0.6, 0.2], [0.3, 0.0, 0.6]]  # the third was never left: equal shares
    assert changed.switching == pytest.approx(np.array(wanted))


def test_every_tracker_takes_them_by_name():
    tracker = make_tracker(
        "runnalls-5", TURNING, assumed_process_noise=2.0, assumed_detection_probability=0.7
    )
    assert tracker.model.motion.Q == pytest.approx(4 * TURNING.motion.Q)
    assert tracker.model.detection_probability == 0.7
    assert make_tracker("gm-phd", MANY, assumed_survival_probability=0.5) is not None


@pytest.mark.parametrize(
    ("model", "assumed", "said"),
    [
        (TURNING, {"assumed_stay": 0.5}, "filter model has no assumed_stay; it has assumed_process_noise, "),
        (TURNING, {"assumed_survival_probability": 0.5}, "has no assumed_survival_probability"),
        (MANY, {"assumed_gate_probability": 0.5}, "has no assumed_gate_probability"),
        (TURNING, {"assumed_process_noise": 0.0}, "assumed_process_noise, a factor, must be positive"),
        (TURNING, {"assumed_clutter": float("inf")}, "assumed_clutter, a factor, must be positive"),
        (TURNING, {"assumed_measurement_noise": -1.0}, "assumed_measurement_noise, a factor, must be pos"),
        (TURNING, {"assumed_measurement_noise": 1e-200}, "assumed_measurement_noise, a factor, must be pos"),
        (TURNING, {"assumed_process_noise": 1e200}, "must be positive, from 1e-12 to 1e.12, got 1e.200"),
        (TURNING, {"assumed_detection_probability": 1.5}, "assumed_detection_probability must lie in"),
        (TURNING, {"assumed_clutter": "thick"}, "assumed_clutter must be a number, got 'thick'"),
        (JUMP, {"assumed_stay": 1.0}, r"assumed_stay must lie in \[0, 1\), got 1.0"),
    ],
)  # fmt: skip
def test_what_cannot_be_assumed_is_refused_by_name(model, assumed, said):
    with pytest.raises(ValueError, match=said):
        with_assumptions(model, assumed)
