"""What choices by instance and by episode gain over the best constant."""

import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("optuna")
sys.path.insert(0, str(Path(__file__).parents[2] / "agents"))

from ceilings import Question, gains, grid, played

from gmr_gym.scenarios.williams import meeting_targets
from gmr_gym.scenarios.zhang import jump_markov


def test_an_instance_has_a_constant_of_its_own_only_where_that_holds_on_other_episodes():
    apart = np.array([[[1.0, 2.0]] * 4, [[2.0, 1.0]] * 4])
    assert gains(apart) == (0, 1.5, pytest.approx(1 / 3), pytest.approx(1 / 3))
    luck = np.array([[[1.0, 3.0], [3.0, 1.0]] * 2])
    _, cost, instance, episode = gains(luck + np.array([0.0, 0.1]))
    assert cost == 2.0 and instance == 0.0 and episode == pytest.approx(1 - 1.05 / 2)


@pytest.mark.parametrize(
    ("tracker", "scenario", "options"),
    [
        ("imm-mht", jump_markov("2"), grid(prune_weight=(1e-4, 5e-2))),
        ("gm-phd", meeting_targets(horizon=12), grid(prune_weight=(1e-4, 1e-2))),
    ],
)
def test_pruning_more_takes_less_work(tracker, scenario, options):
    error, work = played(Question(tracker, [scenario], options), 2, 0)
    assert error.shape == (1, 2, 2) and (error >= 0).all()
    assert work[..., 1].sum() < 0.9 * work[..., 0].sum()
