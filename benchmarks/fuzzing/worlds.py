"""What trackers are told and shown: the scenarios of the package, and hostile models by number."""

from functools import cache

import numpy as np

from fuzzing.inputs import Rng, decades, hostile_mixture
from gmr_gym.mixture import Mixture, normalised
from gmr_gym.models import kalman
from gmr_gym.models.clutter import Clutter, no_components, uniform_clutter
from gmr_gym.models.model import Model, model
from gmr_gym.models.motions import constant_velocity
from gmr_gym.models.multi_target import MultiTargetModel, multi_target_model
from gmr_gym.models.radar import Radar, radar
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.scenarios.li import airborne_radar
from gmr_gym.scenarios.lv import unknown_clutter
from gmr_gym.scenarios.maybeck import agile_flight
from gmr_gym.scenarios.recorded import recorded_flight
from gmr_gym.scenarios.zhang import jump_markov

SCENARIOS = (turning_target, agile_flight, jump_markov, airborne_radar, recorded_flight)
MODELS, POPULATIONS = 40, 24  # worlds there are
CHANCES = (0.01, 0.5, 0.9, 0.999, 1.0)


@cache
def hostile_model(index: int) -> Model:
    """One of MODELS: those of the scenarios, then drawn ones of one motion and of several."""
    if index < len(SCENARIOS):
        return SCENARIOS[index]().model
    rng = np.random.default_rng([1, index])
    base = airborne_radar(regime=("near", "far", "extreme")[index % 3]).model
    if index % 5 == 0:
        sensor = radar(base.sensor.deviations * decades(rng, -2, 0), base.sensor.H.shape[1])
        return base._replace(
            sensor=sensor, clutter_density=float(decades(rng, -300, 3)),
            detection_probability=float(rng.choice(CHANCES)), gate_probability=float(rng.choice(CHANCES)),
        )  # fmt: skip
    axes, r = int(rng.integers(1, 4)), (1, 1, 3)[index % 3]
    period = decades(rng, -2, 2)
    motions = tuple(constant_velocity(period, decades(rng, -6, 3), axes) for _ in range(r))
    prior = hostile_mixture(rng, 4, 2 * axes)
    prior = normalised(prior._replace(w=np.maximum(prior.w / prior.w.max(), 1e-300)))
    clutter = (1e-300, 1e-100, 1e-10, 1e-3, 1.0, 1e6)[rng.integers(6)]
    return model(
        motions,
        kalman.position_sensor(decades(rng, -3, 3), axes),
        float(rng.choice(CHANCES)),
        float(rng.choice(CHANCES)),
        clutter,
        prior,
        None if r == 1 else (np.eye(r), np.full((r, r), 1 / r))[rng.integers(2)],
    )


@cache
def hostile_population(index: int) -> MultiTargetModel:
    """One of POPULATIONS: those of UnknownClutter, then drawn ones."""
    if index < 3:
        return unknown_clutter(clutter=("groups", "uniform", "dense")[index]).model
    rng = np.random.default_rng([2, index])
    axes = int(rng.integers(1, 3))
    births = hostile_mixture(rng, 4, 2 * axes)
    total = decades(rng, -6, 1)
    births = normalised(births._replace(w=np.maximum(births.w / births.w.max(), 1e-300)))
    births = births._replace(w=births.w * total)
    reach = np.abs(births.m[:, :axes]).max() + decades(rng, 0, 4)
    expected = (1e-280, 1e-6, 1.0, 50.0, 1e4, 1e6)[rng.integers(6)]
    clutter = uniform_clutter(np.full(axes, -reach), np.full(axes, reach), expected)
    if rng.random() < 0.3:
        some = hostile_mixture(rng, 3, axes)
        clutter = Clutter(clutter.low, clutter.high, expected, some, no_components(axes))
    return multi_target_model(
        constant_velocity(decades(rng, -2, 2), decades(rng, -4, 2), axes),
        kalman.position_sensor(decades(rng, -3, 3), axes),
        float(rng.choice(CHANCES)),
        float(rng.choice(CHANCES[1:])),
        births,
        clutter,
        float(rng.choice([0.0, 0.05])),
    )


def hostile_scan(rng: Rng, told, alone: bool = False, k: int | None = None) -> np.ndarray:
    """A scan (k, p) of finite detections: near what is expected at first, far off, all in one place, none."""
    if k is None:
        k = int(rng.choice([0, 0, 1, 1, 1, 2, 3, 5, 8, 40]))
    k = min(k, 1) if alone else k
    start: Mixture = told.prior if isinstance(told, Model) else told.births
    p, sensor = len(told.sensor.H), told.sensor
    chosen = rng.integers(len(start.w), size=k)
    at = sensor.measure(start.m[chosen]).reshape(k, p)
    noise = np.sqrt(np.diag(sensor.R)) * rng.standard_normal((k, p))
    kind = rng.integers(8)
    if kind < 4:
        z = at + noise * decades(rng, -2, 3)
    elif kind == 4:
        z = np.repeat(at[:1], k, axis=0)
    elif kind == 5:
        z = decades(rng, 0, 8) * rng.uniform(-1, 1, (k, p))
    elif kind == 6:
        z = at + noise
        z[rng.random(k) < 0.5] = decades(rng, 8, 160) if rng.random() < 0.1 else 1e8
    else:
        z = at + noise
        z[rng.random(k) < 0.5] = 0.0
    return possible(z) if isinstance(sensor, Radar) else z


def possible(z: np.ndarray) -> np.ndarray:
    """Detections as a radar might say them."""
    z[:, 0] = np.clip(np.abs(z[:, 0]), 1e-3, 1e9)
    z[:, 1] = np.clip(z[:, 1], -1e3, 1e3)
    z[:, 2] = np.clip(z[:, 2], -np.pi / 2, np.pi / 2)
    return z
