"""A scan in two halves, the thresholds in between, what is known before they are set, and who sets them."""

from dataclasses import replace

import numpy as np
import pytest
import reference

from gmr_gym.baselines.mht import adaptive
from gmr_gym.filters.association import Expansion, expand
from gmr_gym.filters.mht import (
    ScanUpdate,
    gate_and_log_weights,
    predict_and_update,
    prune_and_reduce,
    reduce_scan,
)
from gmr_gym.mixture import Mixture, mixture, moments, normalised
from gmr_gym.models.gating import gates
from gmr_gym.models.kalman import predict
from gmr_gym.reduction.merge_cost import merge_costs, total_cost
from gmr_gym.reduction.pruning import capping, prune, prune_density
from gmr_gym.reduction.runnalls import adaptive as reduction_adaptive
from gmr_gym.reduction.runnalls import greedy, total_merge_cost
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.simulation.single_target import draw, scan
from gmr_gym.tuning.features import BOUND, FEATURES, Memory, at_start, model_features, observe_into
from gmr_gym.tuning.policies import ByTable, Constant, Random, Rule, Schedule
from gmr_gym.tuning.thresholds import (
    DORTENZIO,
    RANGES,
    Thresholds,
    adapt,
    check_parameters,
    from_action,
    to_action,
)

WORLD = turning_target()
TOLD = WORLD.model
KNOWN = model_features(TOLD)
EVERY = Thresholds._fields
FIRST = at_start(TOLD)


def scans(seed, count=100):
    episode = draw(WORLD, seed)
    return [scan(WORLD, episode, t, np.zeros(2)).z for t in range(count)]


def named(values):
    return dict(zip(FEATURES, values.tolist(), strict=True))


def posterior_of(p, detection=None, log_density=-8.0):
    """The mixture as the posterior of a scan, its own components having been predicted."""
    detection = np.full(len(p.w), -1) if detection is None else detection
    density = np.where(detection < 0, np.inf, log_density)
    looked = gates(p, TOLD.sensor, TOLD.gate_probability)
    return ScanUpdate(Expansion(p, np.arange(len(p.w)), detection, density), looked)


def features(full, memory, model=TOLD, known=KNOWN):
    """What is seen of a posterior."""
    log_detect, values = gate_and_log_weights(model)[2], np.empty(len(FEATURES))
    (w, m, P), _, detection, log_density = full.posterior
    observe_into(
        values, (w, detection, log_density), total_cost(w, m, P), full.gates.S, model.sensor[:2], log_detect,
        known, memory,
    )  # fmt: skip
    return values


def spread_out(n, seed=0, scale=20.0):
    rng = np.random.default_rng(seed)
    w, m, P = reference.random_mixture(rng, n, 4)
    return mixture(w, scale * m, scale * P)


@pytest.mark.parametrize(
    "thresholds",
    [
        DORTENZIO,
        Thresholds(0.01, 1e-4, 1e-12, 30),
        Thresholds(0.3, 5e-3, 1e-8, 5),
        Thresholds(1e-3, 1e-5, 0.0, 60),
    ],
)
@pytest.mark.parametrize("seed", [0, 1])
def test_constant_thresholds_are_the_adaptive_tracker_scan_for_scan(thresholds, seed):
    tracker = adaptive(
        TOLD, thresholds.components, thresholds.alpha, thresholds.prune, thresholds.prune_density
    )
    belief = mine = tracker.init()
    for z in scans(seed):
        belief, report = tracker.step(belief, z)
        full = predict_and_update(mine, TOLD, z)
        mine = Mixture(*adapt(*full.posterior.mixture, np.array(thresholds, float), 1.0, 0)[:3])
        for a, b in zip((*mine, *full.gates), (*belief, *report.gates), strict=True):
            np.testing.assert_array_equal(a, b)


def test_the_two_halves_are_the_papers_steps_one_after_another():
    belief = TOLD.prior
    for z in scans(2, 30):
        predicted = predict(belief, TOLD.motion)
        looked = gates(predicted, TOLD.sensor, TOLD.gate_probability)
        p = expand(predicted, looked, TOLD.sensor, z, 0.9, 0.999, TOLD.clutter_density).mixture
        p = normalised(capping(prune(p, 1e-3)[0], 12)[0])
        p = normalised(reduction_adaptive(p, 0.02, 6)[0])
        p = normalised(prune_density(p, 1e-9)[0])
        full = predict_and_update(belief, TOLD, z)
        for reduce in (greedy(6, 0.02), lambda q: reduction_adaptive(q, 0.02, 6)):
            kept = prune_and_reduce(full.posterior.mixture, reduce, 1e-3, 1e-9, max_hypotheses=12)
            for a, b in zip(kept, p, strict=True):
                np.testing.assert_array_equal(a, b)
        belief = p


def counted(w, m, P, components):
    """Evaluations of a pair's cost on the greedy way down to `components`, none of them made twice."""
    parts, names, costs, count = list(zip(w, m, P, strict=True)), list(range(len(w))), {}, 0
    while True:
        for i in range(len(parts)):
            for j in range(i):
                if (names[i], names[j]) not in costs:
                    pair = (np.array(values) for values in zip(parts[i], parts[j], strict=True))
                    costs[names[i], names[j]] = reference.merge_cost(*pair)
                    count += 1
        if len(parts) <= components:
            return count
        alive = [(names[i], names[j]) for i in range(len(parts)) for j in range(i)]
        i, j = (names.index(name) for name in min(alive, key=costs.get))
        pair = (np.array(values) for values in zip(parts[i], parts[j], strict=True))
        parts = [part for k, part in enumerate(parts) if k not in (i, j)] + [reference.moment_match(*pair)]
        names = [name for k, name in enumerate(names) if k not in (i, j)] + [max(costs)[0] + 1]


@pytest.mark.parametrize(("n", "r"), [(1, 1), (2, 2), (2, 1), (7, 7), (7, 6), (7, 3), (7, 1), (12, 2)])
def test_merge_costs_are_those_that_greedy_merging_has_to_evaluate(n, r):
    assert merge_costs(n, r) == counted(*spread_out(n), r)


def test_work_counts_updated_gaussians_and_merge_costs_and_what_was_given_up_is_of_the_whole_cost():
    belief, rows = TOLD.prior, Thresholds(0.2, 1e-3)
    for z in scans(3, 20):
        full = predict_and_update(belief, TOLD, z)
        whole = full.posterior.mixture
        gated = (full.posterior.detection >= 0).sum()
        *kept, entered, left = reduce_scan(
            *whole, rows.prune, 2000, rows.components, rows.alpha, rows.prune_density
        )
        *done, given_up, work = adapt(*whole, np.array(rows, float), total_merge_cost(whole), gated)
        belief = Mixture(*kept)
        assert work == gated + merge_costs(entered, left)
        for a, b in zip(done, (*kept, *moments(belief)), strict=True):
            np.testing.assert_array_equal(a, b)
        costs = [reference.merge_cost(*p) for p in (whole, belief)]
        assert given_up == pytest.approx(max(0.0, 1 - costs[1] / costs[0]), abs=1e-9)
    *_, given_up, work = adapt(*(a[:1] for a in TOLD.prior), np.array(DORTENZIO, float), 0.0, 0)
    assert given_up == 0.0 and work == 0


@pytest.mark.parametrize("n", [1, 2, 50, 2000])
@pytest.mark.parametrize("kind", ["random", "equal", "alike", "far"])
def test_features_are_finite_and_in_their_box(n, kind):
    p = spread_out(n, scale=3000.0 if kind == "far" else 20.0)
    if kind == "equal":
        p = p._replace(w=np.full(n, 1 / n))
    if kind == "alike":
        p = Mixture(p.w, np.repeat(p.m[:1], n, axis=0), np.repeat(p.P[:1], n, axis=0))
    rng = np.random.default_rng(n)
    for detection in (None, rng.integers(-1, 5, n), np.zeros(n, int)):
        for memory in (FIRST, Memory(2000, 1.0, 10**7)):
            found = features(posterior_of(p, detection), memory)
            assert found.shape == (len(FEATURES),) and found.dtype == float
            assert (np.abs(found) <= BOUND).all()  # a nan compares as False


def test_features_do_not_depend_on_the_order_of_hypotheses():
    p, rng = spread_out(60), np.random.default_rng(5)
    detection = rng.integers(-1, 4, 60)
    order = rng.permutation(60)
    shuffled = Mixture(*(a[order] for a in p))
    a = features(posterior_of(p, detection), FIRST)
    b = features(posterior_of(shuffled, detection[order]), FIRST)
    np.testing.assert_allclose(a, b, rtol=0, atol=1e-12)  # sums in another order


def test_features_are_what_they_are_called():
    w = np.array([0.5, 0.3, 0.2])
    p = spread_out(3)._replace(w=w)
    found = named(features(posterior_of(p, np.array([4, -1, 4]), log_density=-9.0), Memory(20, 0.25, 999)))
    H, R, lam = TOLD.sensor.H, TOLD.sensor.R, TOLD.clutter_density
    entropy, cost = -(w * np.log(w)).sum(), reference.merge_cost(*p)
    predicted = np.linalg.det(H @ p.P @ H.T + R)
    whole = np.linalg.det(H @ reference.moment_match(*p)[2] @ H.T + R)
    area = np.pi * 13.815510557964274 * np.sqrt([np.linalg.det(R), *predicted])  # chi-square at 0.999
    log_most = np.log(2000)
    wanted = {
        "size": 2 * np.log(3) / log_most - 1,
        "entropy": 2 * entropy / log_most - 1,
        "effective": 2 * np.log(1 / (w**2).sum()) / log_most - 1,
        "heaviest": 0.0,
        "second": 0.2,
        **{f"over_1e-{k}": 2 * np.log((w > 10.0**-k).sum()) / log_most - 1 for k in (2, 3, 4, 5)},
        "missed": -0.4,
        "spread": np.log(whole / np.linalg.det(R)) / 4 - 1,
        "widest": np.log(predicted.max() / np.linalg.det(R)) / 4 - 1,
        "merge_cost": np.log10(cost) / 2,
        "separation": 2 * cost / (cost + entropy) - 1,
        "gated": np.log10(1 + 2 / 3),
        "evidence": (np.log(0.9 / lam) - 9.0) / 5,
        "given_up": -0.5,
        "kept": 2 * np.log(20) / log_most - 1,
        "work": 0.0,
        "expected": np.log10(lam * area[1:].mean()),
        "clutter": np.log10(lam * area[0]),
        "detection": 0.5,
        "manoeuvre": np.log10(2 * (3.0 / 2) ** 2 / 140) / 2 + 0.5,  # q T^2 / 2 on each axis
    }
    assert list(wanted) == list(FEATURES)
    for name, value in wanted.items():
        assert found[name] == pytest.approx(value, abs=1e-9), name


def test_hypotheses_are_counted_by_what_pruning_would_leave():
    w = np.array([0.9, 0.09, 5e-3, 4e-3, 5e-4, 4e-4, 9e-5, 6e-6])
    found = named(features(posterior_of(spread_out(len(w))._replace(w=w)), FIRST))
    for k, left in ((2, 2), (3, 4), (4, 6), (5, 7)):
        assert found[f"over_1e-{k}"] == pytest.approx(2 * np.log(left) / np.log(2000) - 1)


def test_a_motion_without_noise_has_features_too():
    still = TOLD._replace(motions=(TOLD.motion._replace(Q=np.zeros((4, 4))),))
    found = named(features(posterior_of(spread_out(3)), FIRST, still, model_features(still)))
    assert found["manoeuvre"] == -BOUND


def test_actions_and_thresholds_are_each_others_inverse():
    rng = np.random.default_rng(0)
    for action in rng.uniform(-1, 1, (20, 3)):
        thresholds = from_action(action, EVERY[:3])
        np.testing.assert_allclose(to_action(thresholds, EVERY[:3]), action, atol=1e-12)  # machine
        assert thresholds.components == DORTENZIO.components
    for end, edge in ((-1.0, 0), (1.0, 1)):
        edges = [limits[edge] for limits in RANGES.values()]
        assert from_action(np.full(len(EVERY), end), EVERY) == pytest.approx(edges, rel=1e-12)
    middle = from_action([0.0], ["components"])
    assert middle == DORTENZIO._replace(components=20) and type(middle.components) is int
    assert from_action([0.0], ["alpha"], Thresholds(components=7)).components == 7


@pytest.mark.parametrize(
    ("action", "message"),
    [
        ([0.0], r"action must have shape \(2,\), one number each for alpha, prune, got \(1,\)"),
        ([[0.0, 0.0]], r"got \(1, 2\)"),
        ([0.0, np.nan], r"action must be finite and within \[-1, 1\], got \[0.0, nan\]"),
        ([0.0, 1j], r"action must be numbers of shape \(2,\)"),
        ([0.0, "x"], "action must be numbers"),
        ([1.001, 0.0], r"within \[-1, 1\]"),
        (np.ma.array([0.0, 0.0], mask=[True, False]), "action must be given in full"),
    ],
)
def test_bad_actions_are_refused(action, message):
    with pytest.raises(ValueError, match=message):
        from_action(action, ("alpha", "prune"))


def test_bad_thresholds_and_names_are_refused():
    with pytest.raises(ValueError, match=r"alpha must lie in \[0.0001, 0.5\] to be an action, got 0.9"):
        to_action(DORTENZIO._replace(alpha=0.9), ("alpha",))
    for names, message in (
        ((), "parameters must be a list of different thresholds, got"),
        ("alpha", "parameters must be a list of different thresholds, got 'alpha'"),
        (("alpha", "alpha"), "different thresholds"),
        (("gamma",), "unknown threshold 'gamma'; choose from alpha, prune, prune_density, components"),
    ):
        with pytest.raises(ValueError, match=message):
            check_parameters(names)


def test_policies_do_as_they_say():
    seen = np.zeros(len(FEATURES))
    seen[FEATURES.index("clutter")], seen[FEATURES.index("detection")] = 0.3, -0.5
    np.testing.assert_array_equal(Constant(np.array([0.1]))(seen, 7), [0.1])
    schedule = Schedule(np.array([[0.1], [0.2], [0.3]]), every=5)
    assert [schedule(seen, t)[0] for t in (0, 4, 5, 14, 99)] == [0.1, 0.1, 0.2, 0.3, 0.3]
    rule = Rule(("clutter", "detection"), np.array([[1.0, 2.0], [9.0, 0.0]]), np.array([0.5, 0.0]))
    np.testing.assert_allclose(rule(seen, 0), [-0.2, 1.0])
    cells = np.array([[0.0, 0.0], [0.4, -0.4], [0.3, 0.5]])
    by_table = ByTable(("clutter", "detection"), cells, np.array([[0.1], [0.2], [0.3]]))
    assert by_table(seen, 0) == 0.2
    random = Random(2, 4, np.random.default_rng(0))
    drawn = np.array([random(seen, t) for t in range(8)])
    assert (drawn[:4] == drawn[0]).all() and (drawn[4:] == drawn[4]).all() and (drawn[0] != drawn[4]).all()
    assert (np.abs(drawn) <= 1).all()
    for every, message in ((0, "at least 1, got 0"), (1.5, "a whole number, got 1.5"), ("5", "1, got '5'")):
        for policy in (schedule, random):
            with pytest.raises(ValueError, match=f"every must be .*{message}"):
                replace(policy, every=every)
    with pytest.raises(ValueError, match="unknown feature 'entropie'"):
        replace(rule, names=("entropie",))(seen, 0)
