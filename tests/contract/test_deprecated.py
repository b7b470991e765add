"""Former names go on working for a version, and say what they are called now."""

from operator import attrgetter

import pytest

import gmr_gym
from gmr_gym.envs.policy import MultiTargetPolicy
from gmr_gym.filters.registry import MULTI_TARGET_GROUP, make_tracker, trackers
from gmr_gym.models import multi_target
from gmr_gym.scenarios.lv import unknown_clutter
from gmr_gym.scenarios.zhang import jump_markov

MODES, MANY = jump_markov().model, unknown_clutter().model


def test_crowd_policy_is_multi_target_policy():
    with pytest.warns(DeprecationWarning, match="CrowdPolicy is now MultiTargetPolicy"):
        assert gmr_gym.CrowdPolicy is MultiTargetPolicy


@pytest.mark.parametrize(
    ("former", "new"), [("population", "multi_target_model"), ("Population", "MultiTargetModel")]
)
def test_population_is_the_multi_target_model(former, new):
    with pytest.warns(DeprecationWarning, match=f"{former} is now {new}"):
        assert getattr(multi_target, former) is getattr(multi_target, new)


@pytest.mark.parametrize(
    ("model", "name", "former", "value", "new"),
    [
        (MODES, "imm-pda", "hopeless", 7.0, "give_up_ratio"),
        (MODES, "mmg-5", "hopeless", 7.0, "work_limits.give_up_ratio"),
        (MODES, "mmg-5", "most", 40, "work_limits.max_hypotheses"),
        (MODES, "imm-mht-5", "most", 40, "work_limits.max_hypotheses"),
        (MANY, "pmb", "naming", 0.75, "limits.report_threshold"),
        (MANY, "learning-pmb", "naming", 0.75, "known.limits.report_threshold"),
    ],
)
def test_a_former_parameter_of_a_tracker_is_passed_on_by_its_new_name(model, name, former, value, new):
    said = f"parameter '{former}' is now '{new.rpartition('.')[2]}'"
    with pytest.warns(DeprecationWarning, match=said):
        tracker = make_tracker(name, model, **{former: value})
    assert attrgetter(new)(tracker) == value


def test_a_tracker_with_neither_name_refuses_the_former_one():
    with pytest.raises(ValueError, match="'pda' takes no parameter 'naming'"):
        make_tracker("pda", MODES, naming=0.5)


@pytest.fixture
def former_plugin(tmp_path, monkeypatch):
    """A package that offers trackers of many targets in the former group, as if it were installed."""
    installed = tmp_path / "former-0.dist-info"
    installed.mkdir()
    (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: former\nVersion: 0\n")
    (installed / "entry_points.txt").write_text(
        "[gmr_gym.crowd_trackers]\nformer-phd = gmr_gym.baselines.gm_phd:gm_phd\ngm-phd = nowhere:nothing\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))


@pytest.mark.usefixtures("former_plugin")
def test_trackers_of_the_former_group_are_found_and_hide_none_of_the_new():
    says = "'gmr_gym.crowd_trackers' of .* is now 'gmr_gym.multi_target_trackers'"
    with pytest.warns(DeprecationWarning, match=says):
        assert trackers(MULTI_TARGET_GROUP)["former-phd"] == trackers(MULTI_TARGET_GROUP)["gm-phd"]
    with pytest.warns(DeprecationWarning, match=says):
        assert type(make_tracker("former-phd", MANY)) is type(make_tracker("gm-phd", MANY))


def test_a_parameter_under_both_names_is_refused():
    with pytest.raises(ValueError, match="max_hypotheses is given twice, once by its former name 'most'"):
        make_tracker("mmg-5", MODES, most=5, max_hypotheses=6)
