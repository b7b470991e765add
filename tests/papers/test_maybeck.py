"""Maybeck's table, figures and sentences, and Maybeck against Zhang, on runs made up by hand."""

import json
import statistics
from dataclasses import replace
from itertools import product
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import reference
from reference import runs_of
from scipy.stats import norm
from test_tables_of_papers import catch_drawings

import gmr_gym  # noqa: F401  registers the environments
from gmr_gym.baselines.bank_of_mhts import BankOfMhts
from gmr_gym.envs.lookup import parsed
from gmr_gym.evaluation import curves as module
from gmr_gym.evaluation.summary import Estimate, wilson
from gmr_gym.experiments.claims import no_event_width
from gmr_gym.experiments.evidence import Evidence, all_measured, measured
from gmr_gym.experiments.papers import maybeck, maybeck_zhang
from gmr_gym.experiments.papers.maybeck_claims import (
    ARCHITECTURES,
    CLEAR,
    CLUTTER,
    FAILING,
    RIVALS,
    TUNING,
)
from gmr_gym.experiments.papers.maybeck_numbers import QUANTITIES, offset, rms
from gmr_gym.filters.registry import make_tracker
from gmr_gym.scenarios.maybeck import agile_flight

WORLD = agile_flight()
SCANS = 350
EPOCH = np.arange(1, SCANS + 1)
LEVEL = (EPOCH >= 120) & (EPOCH <= 199)  # 80 of them
TURNS = (EPOCH >= 45) & (EPOCH <= 100)
JINKS = (EPOCH >= 200) & (EPOCH <= 250)  # 51 of them
AFTER = EPOCH > 250
EARLY, LATE = LEVEL & (EPOCH < 160), LEVEL & (EPOCH >= 160)  # the halves of level flight
JUNK = 1e8  # of a run that is lost, and must not count
TABLES = {table.name: table for table in maybeck.TABLES}
MIXED = {table.name: table for table in maybeck_zhang.TABLES}
ASKED_OF = {name for asked in maybeck_zhang.PAPER.claims for name in asked.tables}
claims, mixed_claims = maybeck.PAPER.claim_records, maybeck_zhang.PAPER.claim_records


@pytest.fixture(autouse=True)
def few_resamples(monkeypatch):
    monkeypatch.setattr(module, "RESAMPLES", 8)


@pytest.fixture
def drawn(monkeypatch):
    return catch_drawings(monkeypatch, maybeck, maybeck_zhang)


def made(position=1.0, velocity=1.0, error=0.0, claimed=1.0, aggressive=0.5, lost=()):
    """A tracker's runs: squared errors (T,) and the probability of the aggressive motion (T,) or (runs, T),
    errors and variances (T, 4) or (runs, T, 4). The first of four runs is lost, and full of junk, or those
    of `lost`, the scan at which each of the runs is lost."""
    at = np.array(lost if len(lost) else (7, -1, -1, -1))
    scans, states = (len(at), SCANS), (len(at), SCANS, 4)
    shapes = (position, scans), (velocity, scans), (error, states), (claimed, states), (aggressive, scans)
    values = [np.broadcast_to(value, shape).astype(float) for value, shape in shapes]
    for value in values:
        value[at >= 0] = JUNK
    return Evidence(**dict(zip(QUANTITIES, (*values, at < 0, at), strict=True)))


def changed(one, **quantities):
    """The evidence with other quantities."""
    return Evidence(**vars(one) | quantities)


def span(*during, otherwise=0.0):
    """A curve (T,) of this level in each of the spans."""
    curve = np.full(SCANS, float(otherwise))
    for epochs, level in during:
        curve[epochs] = level
    return curve


def by_state(north, up=0.0, speed=50.0):
    """Errors or variances (T, 4) of position, and of either velocity."""
    return np.stack([np.broadcast_to(values, SCANS) for values in (north, up, speed, speed)], axis=-1)


# what is measured


def made_up(seed, runs=5, scale=3.0):
    """Every number of every run another, none lost."""
    rng = np.random.default_rng(seed)
    squares = scale**2 * rng.exponential(size=(2, runs, SCANS))
    return made(*squares, lost=[-1] * runs)


@pytest.mark.parametrize("quantity", ["position", "velocity"])
@pytest.mark.parametrize("part", [slice(None), slice(119, 199), slice(3, 4)])
def test_the_rms_is_a_root_over_runs_averaged_over_scans(quantity, part):
    one, weight = made_up(0), np.array([1.0, 0, 3, 1, 2])
    roots, pooled = [], []
    for t in range(SCANS)[part]:
        square = sum(weight[i] * getattr(one, quantity)[i, t] for i in range(5)) / 7
        roots.append(np.sqrt(square))
        pooled.append(square)
    got = rms(one, quantity, part, weight)
    assert got == pytest.approx(np.mean(roots), rel=1e-12)
    # the root of all, as in Zhang's tables and in `summary`, is never less
    if len(roots) > 1:
        assert got < 0.99 * np.sqrt(np.mean(pooled))
    assert np.isnan(rms(one, quantity, part, np.zeros(5)))


@pytest.mark.parametrize(
    ("text", "asked"),
    [
        ("MHT of MMAEs against MHT of IMMs: velocity, level", lambda a, b: [{"mmae": a, "imm": b}]),
        ("MMAE against IMM: velocity, level", lambda a, b: [{"imm": b, "mmae": a}]),
        ("the IMM's matrix is the best achievable: velocity, level", lambda a, b: [{"imm": a}, {"imm": b}]),
    ],
)
def test_two_trackers_are_compared_over_the_runs_that_both_kept_as_often_as_they_are_drawn(text, asked):
    value, weight = CLAIMS[text].value, np.array([2.0, 1, 1, 3, 0])
    pair, lost = [made_up(1, scale=2.0), made_up(2)], ((20, -1, -1, -1, -1), (-1, 300, -1, -1, -1))
    for i, at in enumerate(lost):
        for field in ("position", "velocity"):
            getattr(pair[i], field)[np.array(at) >= 0] = JUNK
        pair[i] = changed(pair[i], kept=np.array(at) < 0, lost_at=np.array(at))
    average = []
    for one in pair:
        # once the third run, three times the fourth
        roots = [np.sqrt((one.velocity[2, t] + 3 * one.velocity[3, t]) / 4) for t in range(119, 199)]
        average.append(sum(roots) / 80)
    wanted = 100 - 100 * average[0] / average[1]
    assert 10 < wanted < 60
    assert value(weight, *asked(*pair)) == pytest.approx(wanted, rel=1e-9)
    assert value(2 * weight, *asked(*pair)) == pytest.approx(wanted, rel=1e-9)
    # none that both kept
    assert np.isnan(value(np.array([1.0, 1, 0, 0, 0]), *asked(*pair)))


def test_the_offset_is_the_mean_less_its_sampling_variance_of_the_runs_as_they_are_drawn():
    error = np.random.default_rng(7).normal(3.0, 9.0, (5, SCANS, 4))
    table = {"imm": made(error=error, lost=(30, -1, -1, -1, -1))}
    squares = []
    for t in range(44, 100):
        for state in (0, 1):  # the second run once, the fourth twice, the fifth three times
            drawn = [error[run, t, state] for run in (1, 3, 3, 4, 4, 4)]
            squares.append(statistics.mean(drawn) ** 2 - statistics.variance(drawn) / 6)
    assert sum(squares) > 0
    got = offset("imm", slice(44, 100))(np.array([4.0, 1, 0, 2, 3]), table)
    assert got == pytest.approx(np.sqrt(sum(squares) / 56), rel=1e-9)
    # how much a mean scatters, one run cannot tell
    assert np.isnan(offset("imm", slice(44, 100))(np.array([4.0, 1, 0, 0, 0]), table))


@pytest.mark.parametrize("correlated", [True, False])
def test_errors_without_an_offset_show_none_on_average_however_unlike_they_scatter(correlated):
    text = "MHT of MMAEs: the jinking leaves an offset in the mean error that the turns do not"
    runs, seeds, parts = 50, 300, ((slice(44, 100), 20.0), (slice(199, 250), 60.0))  # m
    one, weight = made(lost=[-1] * runs), np.ones(runs)
    offsets, plain, excess = np.empty((seeds, 2)), np.empty((seeds, 2)), np.empty(seeds)
    for seed in range(seeds):
        rng, error = np.random.default_rng(seed), np.zeros((runs, SCANS, 4))
        for part, deviation in parts:
            scans = 1 if correlated else part.stop - part.start
            error[:, part, :2] = rng.normal(0.0, deviation, (runs, scans, 2))
        table = {"mmae": changed(one, error=error)}
        offsets[seed] = [offset("mmae", part)(weight, table) for part, _ in parts]
        plain[seed] = [np.sqrt(2 * (error[:, part, :2].mean(axis=0) ** 2).mean()) for part, _ in parts]
        excess[seed] = CLAIMS[text].value(weight, table)
    squares = np.sign(offsets) * offsets**2
    reach = 4 * squares.std(axis=0) / np.sqrt(seeds)  # standard errors
    assert (np.abs(squares.mean(axis=0)) < reach).all()
    # the mean of 50 is off by a 50th of the variance, in two coordinates; unlike in turns and in jinking
    np.testing.assert_allclose((plain**2).mean(axis=0), [16, 144], rtol=0.25)
    assert ((plain**2).mean(axis=0) > 2 * reach).all()
    assert (plain[:, 1] - plain[:, 0]).mean() > 6
    assert abs(excess.mean()) < 2


@pytest.mark.parametrize("patience", [1, 2])
def test_what_the_sentences_need_is_plain_loops_whatever_the_order_of_the_states(patience):
    world = replace(WORLD, position=(4, 1), velocity=(3, 0), patience=patience)
    rng, n, scans = np.random.default_rng(3), 4, 6
    off = np.zeros((n, scans), bool)
    off[0, 3:5] = off[1, 2] = off[1, 4] = True
    covariances = reference.random_mixture(rng, n * scans, 6)[2].reshape(n, scans, 6, 6)
    runs = runs_of(rng.standard_normal((n, scans, 6)), off, covariances)
    runs = runs._replace(modes=rng.dirichlet(np.ones(3), (n, scans)))
    got = measured(QUANTITIES, world, runs)
    assert got.lost_at.tolist() == ([3, 2, -1, -1] if patience == 1 else [4, -1, -1, -1])
    assert got.kept.tolist() == [at < 0 for at in got.lost_at]
    for i, t in product(range(n), range(scans)):
        e = runs.x[i, t] - runs.truth[i, t]
        assert got.position[i, t] == pytest.approx(e[4] ** 2 + e[1] ** 2, rel=1e-12)
        assert got.velocity[i, t] == pytest.approx(e[3] ** 2 + e[0] ** 2, rel=1e-12)
        assert got.error[i, t].tolist() == [e[4], e[1], e[3], e[0]]
        assert got.claimed[i, t].tolist() == [runs.P[i, t, state, state] for state in (4, 1, 3, 0)]
        assert got.aggressive[i, t] == runs.modes[i, t, 2]
    results = {"first": runs, "second": runs._replace(x=runs.truth)}
    told = all_measured(QUANTITIES, world, results, ("mmae", "imm"))
    assert list(told) == ["mmae", "imm"]
    np.testing.assert_array_equal(told["mmae"].error, got.error)
    assert not told["imm"].error.any()


# the sentences, each of evidence of which it is true and of evidence of which it is not

PHRASES = {
    "aggressive": "MHT of aggressive filters", "benign": "MHT of benign filters", "mmae": "MHT of MMAEs",
    "imm": "MHT of IMMs", "mmae_of": "MMAE of MHTs", "imm_of": "IMM of MHTs",
}  # fmt: skip
MULTIPLE = "mmae", "imm", "mmae_of", "imm_of"
PAIRS = [
    *((who, "aggressive") for who in MULTIPLE),
    ("mmae", "mmae_of"), ("imm", "imm_of"), ("mmae_of", "imm_of"), ("mmae", "imm_of"), ("mmae", "imm"),
]  # fmt: skip


# a root mean square error in level flight and elsewhere, the rival's, and by how much they differ
LEVELS = {
    "whole": ((6.0, 3.0), (4.5, 4.0), 1 - (80 * 6 + 270 * 3) / (80 * 4.5 + 270 * 4)),
    "level": ((3.0, 30.0), (4.0, 1.0), 1 - 3 / 4),
}


def errs(quantity, inside, outside, other):
    """In level flight and elsewhere; in the other quantity it errs as its rival does in this."""
    (what,) = {"position", "velocity"} - {quantity}
    return made(**{
        quantity: span((LEVEL, inside**2), otherwise=outside**2),
        what: span((LEVEL, other[0] ** 2), otherwise=other[1] ** 2),
    })  # fmt: skip


def rivals(better, worse, quantity, part):
    """A comparison's two sides: the second with the names changed over."""
    little, much, saved = LEVELS[part]
    low, high = errs(quantity, *little, much), errs(quantity, *much, little)
    return (
        [{better: low, worse: high}], 100 * saved,
        [{better: high, worse: low}], 100 * (1 - 1 / (1 - saved)),
    )  # fmt: skip


def tuned(quantity, part):
    """The IMM of one table against that of the other."""
    (true,), number, (untrue,), other = rivals("imm", "stickier", quantity, part)
    tables = [[{"imm": table["imm"]}, {"imm": table["stickier"]}] for table in (true, untrue)]
    return tables[0], number, tables[1], other


def alike(who, part, error):
    """An error of position in this part of the flight, where the rival's is 10; neither is so elsewhere."""
    return [{
        who: made(span((part, error**2), otherwise=1), 9.0),
        "aggressive": made(span((part, 100), otherwise=900), 25.0),
    }]  # fmt: skip


def losing(who, count, others):
    """Of twenty runs."""
    at = [[90] * lost + [-1] * (20 - lost) for lost in (count, others)]
    return [{who: made(lost=at[0]), "aggressive": made(lost=at[1])}]


def drifting(who, jinking, turning):
    """Mean errors, north and up."""
    sides = zip(jinking, turning, (80.0, 90.0), strict=True)
    curves = [span((JINKS, jink), (TURNS, turn), otherwise=far) for jink, turn, far in sides]
    return [{who: made(error=by_state(*curves))}]


def cancelling(who):
    """Errors to either side while it jinks, and to one in the turns."""
    sides = [by_state(span((JINKS, far), (TURNS, 2.0))) for far in (0.0, 30.0, -30.0, 0.0)]
    return [{who: made(error=np.array(sides))}]


def turning(who, north, up):
    """Mean errors in the turns, where the claimed deviations are of 6 and 8 m."""
    one = drifting(who, (70.0, 70.0), (north, up))[0][who]
    variances = by_state(span((TURNS, 36), otherwise=1), span((TURNS, 64), otherwise=2), 1e4)
    return [{who: changed(one, claimed=np.broadcast_to(variances, one.claimed.shape))}]


def necking(**variances):
    """Claimed variances of either velocity in the two halves of level flight, half of them in one run kept
    and half as much again in another."""
    share = np.array([1, 1.5, 1, 0.5])[:, None, None]
    return [{
        who: made(claimed=share * by_state(7e3, 8e3, span((EARLY, early), (LATE, late), otherwise=5e3)))
        for who, (early, late) in variances.items()
    }]  # fmt: skip


def agreeing(who, *ratios):
    """Errors of these times the claimed deviation, one curve per state, to either side."""
    ratio = np.stack([np.broadcast_to(curve, SCANS) for curve in ratios], axis=-1)
    sign = np.array([1, 1, -1])[:, None, None]
    return [{who: made(error=7.0 * sign * ratio, claimed=49.0, lost=(7, -1, -1))}]


def flowing(who, jinking, level, turns=0.5, otherwise=0.5):
    return {who: made(aggressive=span((JINKS, jinking), (LEVEL, level), (TURNS, turns), otherwise=otherwise))}


def hovering(*levels):
    """Probabilities in the jinking, in level flight and else, and to either side of them in two runs."""
    curve = span((JINKS, levels[0]), (LEVEL, levels[1]), otherwise=levels[2])
    return [{"imm": made(aggressive=curve + np.array([0, 0.05, 0, -0.05])[:, None])}]


def returning(there, back):
    """A probability of 0.1 in level flight that passes 0.4 so many scans after the jinking begins, on its
    way to 0.7, and so many after it ends."""
    curve = span((LEVEL, 0.1), (JINKS, 0.7), (AFTER, 0.2), otherwise=0.9)
    curve[199 : 199 + there] = 0.39
    curve[250 : 250 + back] = 0.41
    return [{"mmae": made(aggressive=curve)}]


def scattered(early, late, jinking=0.4):
    """Probabilities this far to either side of a half in the runs kept, in the two halves of level flight
    and in the jinking."""
    parts = (EARLY, early), (LATE, late), (JINKS, jinking)
    runs = [0.5 + sign * span(*parts, otherwise=0.45) for sign in (0, 1, -1)]
    return {"mmae": made(aggressive=np.array(runs), lost=(4, -1, -1))}


def benefit(quantity, mine, rival, who="mmae"):
    """In this error alone, in level flight and elsewhere."""
    return {
        name: made(**{quantity: span((LEVEL, level**2), otherwise=far**2)})
        for name, (level, far) in ((who, mine), ("aggressive", rival))
    }


THIRD = (EPOCH >= 200) & (EPOCH < 217)  # of the jinking
# sentence -> tables of which it is true, its number, tables of which it is not, its number
SIDES = {
    f"{PHRASES[better]} against {PHRASES[worse]}: {quantity}, {part}": rivals(better, worse, quantity, part)
    for better, worse in PAIRS
    for quantity in ("position", "velocity")
    for part in LEVELS
} | {
    f"MMAE against IMM: {quantity}, {part}": rivals("mmae", "imm", quantity, part)
    for quantity in ("position", "velocity")
    for part in LEVELS
} | {
    f"the IMM's matrix is the best achievable: {quantity}, {part}": tuned(quantity, part)
    for quantity in ("position", "velocity")
    for part in LEVELS
} | {
    f"{PHRASES[who]} loses no more tracks than the MHT of aggressive filters": (
        losing(who, *fewer), 0.05 + (fewer[1] - fewer[0]) / 20, losing(who, *more), -0.05,
    ) for who, fewer, more in zip(
        MULTIPLE, ((3, 3), (0, 5), (2, 4), (9, 9)), ((5, 3), (2, 0), (20, 18), (12, 10)), strict=True
    )
} | {
    # better or worse, it is not about as well
    f"{PHRASES[who]} does about as well as the MHT of aggressive filters in the {named}": (
        alike(who, part, good), 10 - abs(10 - good) * 10, alike(who, part, bad), 10 - abs(10 - bad) * 10,
    )
    for named, part in (("turns", TURNS), ("jinking", JINKS))
    for who, good, bad in (("mmae", 9.5, 12.0), ("imm", 10.4, 8.5))
} | {
    f"{PHRASES[who]} improves level flight more than the whole ({quantity})": (
        [benefit(quantity, (3, 10), (4, 10), who)], 25 - 100 * (1 - (80 * 3 + 2700) / (80 * 4 + 2700)),
        [benefit(quantity, (3, 5), (4, 10), who)], 25 - 100 * (1 - (80 * 3 + 1350) / (80 * 4 + 2700)),
    )
    for who in ("mmae", "imm")
    for quantity in ("position", "velocity")
} | {
    f"{PHRASES[who]}: the turns are tracked with zero-mean error": (
        turning(who, -2.4, 1.8), 5 - 3.0, turning(who, 3.6, -4.8), 5 - 6.0,
    ) for who in ("aggressive", "mmae", "imm")
} | {
    f"{PHRASES[who]}: the jinking leaves an offset in the mean error that the turns do not": (
        drifting(who, (3.0, 4.0), (0.6, 0.8)), 4.0,
        # of 30, -30 and 0 the variance is 900, that of their mean a third of it
        cancelling(who), -np.sqrt(300) - 2,
    ) for who in ("aggressive", "mmae", "imm")
} | {
    f"{PHRASES[who]}: actual and computed deviations agree for most of the time": (
        agreeing(who, 1.24, 1 / 1.24, 1.26, span((LEVEL, 1.0), otherwise=1 / 1.26)), (700 + 80) / 1400,
        agreeing(who, 1.24, 1.26, 1 / 1.26, span((LEVEL, 3.0), otherwise=1.0)), (350 + 270) / 1400,
    ) for who in ("aggressive", "mmae", "imm")
} | {
    f"{PHRASES[who]} makes the errors of deferred decisions greater": (
        [{who: made(span((JINKS, 9), otherwise=1)), "aggressive": made(span((JINKS, 4), otherwise=25))}],
        50.0,
        [{who: made(span((JINKS, 1), otherwise=25)), "aggressive": made(span((JINKS, 4), otherwise=1))}],
        -50.0,
    ) for who in ("mmae", "imm")
} | {
    "the IMM's probabilities hover around 50 %": (
        hovering(0.7, 0.45, 0.52), 0.1 - (51 * 0.2 + 80 * 0.05 + 219 * 0.02) / 350,
        # a half on average, and in level flight
        hovering(0.05, 0.5, 0.5 + 0.45 * 51 / 219), 0.1 - 2 * 0.45 * 51 / 350,
    ),
    "the MMAE tells the models better apart than the IMM": (
        [flowing("mmae", 0.9, 0.2) | flowing("imm", 0.6, 0.5)], 0.6,
        [flowing("mmae", 0.5, 0.4) | flowing("imm", 0.9, 0.1)], -0.7,
    ),
    "the MMAE's claimed velocity deviations neck down in level flight and the IMM's do not": (
        # root mean squares of two velocities
        necking(mmae=(9, 9), imm=(1, 49)), np.sqrt(50) - np.sqrt(18),
        necking(mmae=(1, 49), imm=(9, 9)), np.sqrt(18) - np.sqrt(50),
    ),
    "the MMAE's probability flows with the manoeuvres": (
        [flowing("mmae", 0.9, 0.2) | flowing("imm", 0, 1)], 0.7,
        [flowing("mmae", 0.3, 0.4) | flowing("imm", 1, 0)], -0.1,
    ),
    "the MMAE finds the motion that fits": (
        [flowing("mmae", 0.9, 0.3, 0.8, 0.1) | flowing("imm", 0, 1)], 0.7,
        [flowing("mmae", 0.9, 0.1, 0.4, 0.9) | flowing("imm", 1, 0, 1)], 0.4,
    ),
    "clutter corrupts the probabilities in level flight and not in the jinking": (
        [scattered(0.3, 0.1, 0.15)], 0.05, [scattered(0.05, 0.25, 0.2)], -0.05,
    ),
    "it flows rapidly to the aggressive filter and slowly back": (
        returning(there=2, back=11), 9.0, returning(there=11, back=2), -9.0,
    ),
    "the benign filter loses over 90 % of the runs": (
        [{"benign": made(lost=[120] * 19 + [-1])}], 0.95, [{"benign": made(lost=[120] * 18 + [-1] * 2)}], 0.9,
    ),
    "it loses over 90 % of the runs between epochs 100 and 180": (
        # counted from 0, epoch 100 is scan 99
        [{"benign": made(lost=[99] * 9 + [179] * 10 + [-1])}], 0.95,
        [{"benign": made(lost=[98] + [140] * 18 + [180])}], 0.9,
    ),
    "clutter does not significantly impede the flow of probability": (
        [flowing("mmae", 0.8, 0.2), flowing("mmae", 0.8, 0.1)], 0.6 - 0.8 * 0.7,
        [flowing("mmae", 0.8, 0.3), flowing("mmae", 0.8, 0.1)], 0.5 - 0.8 * 0.7,
    ),
    "clutter shows as a higher variance of the probability": (
        [scattered(0.3, 0.1), scattered(0.05, 0.15)], 0.1, [scattered(0.0, 0.1), scattered(0.2, 0.1)], -0.1,
    ),
    "the offset while jinking does not exist without clutter": (
        [drifting("mmae", (3.0, 4.0), (9.0, 9.0))[0], drifting("mmae", (0.0, 2.0), (50.0, 0.0))[0]], 0.5,
        # less, and yet more than half: 6 m for a third of the time is a root mean square of 6 / sqrt(3)
        [{"mmae": made(error=by_state(span((THIRD, 6.0), (TURNS, 90.0))))},
         {"mmae": made(error=by_state(0.0, span((JINKS, -2.0))))}], 3 / np.sqrt(3) - 2,
    ),
} | {
    f"the benefit of the benign filters is reduced in clutter ({quantity})": (
        [benefit(quantity, (3, 1), (4, 1)), benefit(quantity, (1, 1), (4, 1))], 50.0,
        [benefit(quantity, (3, 1), (4, 1)), benefit(quantity, (5, 1), (4, 1))], -50.0,
    ) for quantity in ("position", "velocity")
}  # fmt: skip
ASKED = ARCHITECTURES, RIVALS, CLEAR, FAILING, CLUTTER, TUNING
CLAIMS = {claim.sentence: claim for about in ASKED for claim in about}


def test_every_claim_has_evidence_on_either_side():
    assert set(SIDES) == set(CLAIMS) and set(RIVALS) <= set(ARCHITECTURES)
    for about in ASKED:
        assert len({claim.sentence for claim in about}) == len(about)
        assert all(CLAIMS[claim.sentence] is claim for claim in about)  # no sentence is two claims
    # without clutter the same numbers are taken
    assert CLEAR[4:] == RIVALS[4:] and len(CLEAR) == 6
    assert [claim.value.args for claim in CLEAR[:4]] == [claim.value.args for claim in RIVALS[:4]]


@pytest.mark.parametrize("text", SIDES)
def test_a_claims_number_lies_above_its_threshold_for_runs_of_which_it_is_true(text):
    true, number, untrue, other = SIDES[text]
    claim = CLAIMS[text]
    for tables, wanted in ((true, number), (untrue, other)):
        runs = len(next(iter(tables[0].values())).kept)
        assert claim.value(np.ones(runs), *tables) == pytest.approx(wanted, rel=1e-9, abs=1e-12)
        # no matter that the lost are drawn more often, but where they are what is counted
        weight = np.where(np.arange(runs) == 0, 5.0, 1.0)
        if "lose" not in text:
            assert claim.value(weight, *tables) == pytest.approx(wanted, rel=1e-9, abs=1e-12)
    assert number > claim.threshold
    assert other <= claim.threshold  # 18 of 20 is nine tenths itself, and not over them


@pytest.mark.parametrize("text", [text for text in SIDES if "loses" not in text])
def test_a_claim_without_a_run_kept_knows_no_number(text):
    tables = [{who: made(lost=[3, 3]) for who in table} for table in SIDES[text][0]]
    assert np.isnan(CLAIMS[text].value(np.ones(2), *tables))


def test_what_is_averaged_over_the_runs_kept_is_so_as_often_as_they_are_drawn():
    weight, flows = np.array([4.0, 1, 2, 3]), (0.9, 0.1, 0.3, 0.8)
    table = {"mmae": made(aggressive=np.array([span((JINKS, flow)) for flow in flows]))}
    flow, scatter = (
        CLAIMS[text].value
        for text in (
            "the MMAE's probability flows with the manoeuvres",
            "clutter shows as a higher variance of the probability",
        )
    )
    assert flow(weight, table) == pytest.approx((0.1 + 2 * 0.3 + 3 * 0.8) / 6, rel=1e-9)
    # and so is the deviation: in level flight 0 and 1 of two runs drawn once and three times
    table["mmae"] = made(aggressive=np.array([[0], [0], [0], [1]]))
    wanted = np.sqrt((1 * 0.75**2 + 3 * 0.25**2) / 4)
    level = {"mmae": made()}
    assert scatter(np.array([4.0, 1, 0, 3]), table, level) == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize("missed", range(3))
def test_the_motion_that_fits_is_to_be_found_in_level_flight_turns_and_jinking(missed):
    found = [0.7, 0.8, 0.9]
    found[missed] = 0.45
    level, turns, jinks = found
    curve = span((LEVEL, 1 - level), (TURNS, turns), (JINKS, jinks), otherwise=0.5)
    for part in (LEVEL, TURNS, JINKS):  # what counts is the mean, and every epoch is part of it
        curve[part] += np.linspace(-0.1, 0.1, part.sum())
    value = CLAIMS["the MMAE finds the motion that fits"].value
    assert value(np.ones(4), {"mmae": made(aggressive=curve)}) == pytest.approx(0.45, rel=1e-9)


def test_a_probability_that_never_comes_back_does_so_no_sooner_than_the_flight_ends():
    back = CLAIMS["it flows rapidly to the aggressive filter and slowly back"].value
    (never,) = returning(there=2, back=len(EPOCH[AFTER]))
    assert back(np.ones(4), never) == 100 - 2


@pytest.mark.parametrize(("jinking", "known"), [(0.52, True), (0.48, False), (0.4, False), (0.1, False)])
def test_a_probability_that_hardly_flows_has_no_way_back(jinking, known):
    back = CLAIMS["it flows rapidly to the aggressive filter and slowly back"].value
    assert np.isfinite(back(np.ones(4), flowing("mmae", jinking, 0.4))) == known


def test_a_lost_share_is_of_the_runs_as_they_are_drawn():
    tables = [{"benign": made(lost=[100, 300, -1])}]
    weight = np.array([3.0, 1, 4])
    share = CLAIMS["the benign filter loses over 90 % of the runs"].value
    between = CLAIMS["it loses over 90 % of the runs between epochs 100 and 180"].value
    assert share(weight, *tables) == pytest.approx(4 / 8)
    assert between(weight, *tables) == pytest.approx(3 / 8)
    # not of those lost
    assert between(np.array([0.0, 0, 1]), *tables) == 0


# which sentences are asked of which tables


def everyone(*who, aggressive=0.3):
    return {name: made(i + 1.0, i + 1.0, aggressive=aggressive) for i, name in enumerate(who)}


THREE = "aggressive", "mmae", "imm"


FIVE = "mmae", "aggressive", "imm", "mmae_of", "imm_of"  # in any order


def test_the_sentences_asked_are_those_of_the_trackers_in_a_table():
    tables = {
        "1": everyone(*FIVE), "benign": everyone("benign", "benign-runnalls"),
        "clear": everyone(*THREE), "missed": everyone(*FIVE), "switching": everyone(*THREE),
        "clear-switching": everyone(*THREE),
    }  # fmt: skip
    records = claims(tables)
    json.dumps(records, allow_nan=False)
    asked = {}
    for record in records:
        asked.setdefault(record["table"], []).append(record["claim"])
        assert record["runs"] == "of 4"
    about = {
        "1": ARCHITECTURES, "benign": FAILING, "clear": CLEAR, "missed": ARCHITECTURES, "switching": RIVALS,
        "clear-switching": CLEAR, "1 against clear": CLUTTER, "1 against switching": TUNING,
        "clear against clear-switching": TUNING,
    }  # fmt: skip
    assert asked == {name: [claim.sentence for claim in those] for name, those in about.items()}
    # squared errors of 1 and 2, whatever the epoch and the run: nothing is left to chance
    first = next(r for r in records if r["claim"].startswith("MHT of MMAEs against MHT of aggressive"))
    assert first["value"] == pytest.approx(100 * (1 - np.sqrt(1 / 2)), rel=1e-9)
    assert first["verdict"] == "too few runs"
    shares = [r["value"] for r in records if r["table"] == "benign"]
    assert shares == [pytest.approx(0.25), 0.0]  # of four runs one, at epoch 8


@pytest.mark.parametrize(
    "names",
    [
        ("1",), ("clear", "switching"), ("1-runnalls", "clear"), ("1", "clear-switching"),
        ("1-runnalls", "switching", "clear-switching"),
    ],
)  # fmt: skip
def test_a_table_is_held_against_another_only_where_both_were_run(names):
    tables = {name: everyone(*(FIVE if name[0] == "1" else THREE)) for name in names}
    assert {record["table"] for record in claims(tables)} == set(names)


@pytest.mark.parametrize("names", [("1", "switching"), ("clear", "clear-switching")])
def test_the_matrix_is_the_best_where_the_stickier_imm_errs_more_in_whatever_order(names):
    told = [everyone(*(FIVE if name == "1" else THREE)) | {"imm": made(far, far)}
            for name, far in zip(names, (4.0, 25.0), strict=True)]  # fmt: skip
    tables = dict(zip(names, told, strict=True))
    for each in (tables, dict(reversed(tables.items()))):
        found = [r["value"] for r in claims(each) if r["table"] == " against ".join(names)]
        assert found == [pytest.approx(100 * (1 - 2 / 5), rel=1e-9)] * 4


# intervals


@pytest.mark.parametrize("runs", [4, 50])
def test_just_the_intervals_without_width_are_widened_to_those_of_no_event(runs):
    figures = [
        Estimate(3.0, 3.0, 3.0), Estimate(0.5, 0.5 - 1e-6, 0.5), Estimate(0.5, 0.4, 0.7), Estimate(np.nan),
        Estimate(0.0, 0.0, 0.0),
    ]  # fmt: skip
    square = norm.ppf(0.975) ** 2
    most = square / (runs + square)  # Wilson's upper end for none
    none, *others, nothing = no_event_width(iter(figures), runs)
    assert none == pytest.approx((3, 3 - most, 3 + most), rel=1e-9)
    assert nothing == pytest.approx((0, -most, most), rel=1e-9)
    assert all(got is given for got, given in zip(others, figures[1:4], strict=True))


@pytest.mark.parametrize(("runs", "verdict"), [(20, "too few runs"), (30, "tie"), (50, "holds")])
def test_a_filter_that_loses_every_run_does_so_for_certain_only_in_many(runs, verdict):
    every, some = (made(lost=[120] * (runs - kept) + [-1] * kept) for kept in (0, 5))
    record, _ = claims({"benign": {"benign": every}})
    assert record["value"] == 1 and record["verdict"] == verdict
    assert record["high"] - 1 == pytest.approx(wilson(0, runs).high, rel=1e-9)
    record, _ = claims({"benign": {"benign": some}})
    assert record["value"] == 1 - 5 / runs
    # else as wide as eight resamples make it
    reach = norm.ppf(0.975) * np.sqrt(5 / runs * (1 - 5 / runs) / runs)
    assert 0.5 < (record["high"] - record["low"]) / (2 * reach) < 2


def test_in_clutter_is_table_1_and_without_is_table_clear_in_whatever_order():
    clear = everyone(*THREE) | scattered(0.05, 0.05)
    tables = {"clear": clear, "1": everyone(*FIVE) | scattered(0.2, 0.2)}
    for told in tables.values():  # as many runs in all
        for who, one in told.items():
            told[who] = Evidence(**{name: part[-3:] for name, part in vars(one).items()})
    text = "clutter shows as a higher variance of the probability"
    (found,) = (r for r in claims(tables) if r["claim"] == text)
    assert found["value"] == pytest.approx(0.15, rel=1e-9)
    assert claims({}) == []


# what is printed, and the tables

# Table I: position and velocity over the whole flight, position and velocity over its benign part
PRINTED = {
    "aggressive": (22.9, 17.5, 18.1, 15.4), "mmae": (18.6, 13.1, 11.9, 7.8), "imm": (20.9, 14.4, 15.1, 11.6),
    "mmae_of": (22.7, 16.7, 16.1, 13.4), "imm_of": (26.6, 15.4, 15.6, 12.4),
}  # fmt: skip
ERRORS = "rmse", "velocity_rmse", "level_rmse", "level_velocity_rmse"
NAMES = {
    "aggressive": "one-motion", "benign": "one-motion", "benign-runnalls": "one-motion", "mmae": "mmae-mht",
    "imm": "imm-mht", "mmae_of": "mmae-of-mhts", "imm_of": "imm-of-mhts",
}  # fmt: skip


def roles(table, world=WORLD):
    """The tracker's spec by role: the i-th tracker's errors are i."""
    results = {spec: runs_of(np.full((1, 2, 6), float(i))) for i, spec in enumerate(table.trackers)}
    told = maybeck.PAPER.evidence(table, world, results)
    return {role: list(table.trackers)[round(one.error[0, 0, 0])] for role, one in told.items()}


def test_the_printed_figures_are_those_of_table_1():
    table = TABLES["1"]
    by_role = roles(table)
    assert list(by_role) == list(PRINTED) and len(table.published) == 5
    for role, figures in PRINTED.items():
        metrics = (f"{error}_own" for error in ERRORS)
        wanted = dict(zip(metrics, figures, strict=True)) | {"track_loss": 0.1}
        assert table.published[by_role[role]] == wanted
    assert TABLES["clear"].published == {"mmae": {"rmse_own": 10.6, "velocity_rmse_own": 10.5}}
    assert {name for name, table in TABLES.items() if table.published} == {"1", "clear"}


@pytest.mark.parametrize(("who", "gained"), [("mmae", (19, 34, 25, 49)), ("imm", (9, 17, 18, 25))])
def test_the_percentages_of_the_text_come_out_of_table_1(who, gained):
    of = product(("position", "velocity"), ("whole", "level"))
    for (quantity, part), printed in zip(of, gained, strict=True):
        text = f"{PHRASES[who]} against MHT of aggressive filters: {quantity}, {part}"
        assert CLAIMS[text].measure == f"error saved, % (printed {printed})"
        column = ("position", "velocity").index(quantity) + 2 * (part == "level")
        saved = 1 - PRINTED[who][column] / PRINTED["aggressive"][column]
        assert 100 * saved == pytest.approx(printed, abs=0.5)


@pytest.mark.parametrize("table", maybeck.TABLES, ids=lambda table: table.name)
def test_the_roles_of_a_table_are_its_trackers_in_their_order(table):
    by_role = roles(table)
    scenario = gym.make(table.env_id, **table.settings).unwrapped.scenario
    assert list(by_role.values()) == list(table.trackers)
    # without clutter there is nothing to associate
    clear = table.name.startswith("clear")
    assert (scenario.clutter_rate == 0) == clear
    wanted = ("benign", "benign-runnalls") if table.name == "benign" else (
        tuple(PRINTED) if table.name in ("1", "1-runnalls", "missed") else THREE
    )  # fmt: skip
    assert tuple(by_role) == wanted
    for role, spec in by_role.items():
        name, parameters = parsed(spec)
        assert name == (NAMES[role].removesuffix("-mht") if clear else f"{NAMES[role]}-15")
        tracker = make_tracker(name, scenario.model, **parameters, **table.trackers[spec])
        assert len(tracker.model.motions) == (1 if "one-motion" in name else 2)
        if "one-motion" in name:  # the aggressive motion has the most noise of all
            noise = [np.trace(motion.Q) for motion in scenario.model.motions]
            assert noise[1] > noise[0]
            assert np.trace(tracker.model.motions[0].Q) == noise[role == "aggressive"]
            assert isinstance(tracker, BankOfMhts)  # gates as the MHTs of the two motions do
        if clear:
            assert set(parameters) <= {"mode"} and not table.trackers[spec]
            continue
        by_runnalls = "runnalls" in role or table.name in ("1-runnalls", "missed")
        assert parameters["reduction"] == ("runnalls" if by_runnalls else "ise")
        # two MHTs have half the hypotheses each
        assert tracker.work_limits.max_hypotheses == (100 if role.endswith("_of") else 200)


def test_the_tables_worlds_are_as_their_titles_say():
    worlds = {
        name: gym.make(table.env_id, **table.settings).unwrapped.scenario for name, table in TABLES.items()
    }
    assert {name for name, world in worlds.items() if world.model.switching[0, 0] == 0.98} == {
        "switching", "clear-switching"
    }  # fmt: skip
    assert {name: world.detection_probability for name, world in worlds.items()} == {
        **dict.fromkeys(worlds, 1.0), "missed": 0.9
    }  # fmt: skip
    assert {world.horizon for world in worlds.values()} == {SCANS}


def some_results(names, lost, runs=8, seed=4):
    """Runs of these trackers in the world, of errors that grow from one to the next and of every run of
    another size, with the runs lost that each is to lose."""
    rng, results = np.random.default_rng(seed), {}
    for i, name in enumerate(names):
        off = np.zeros((runs, SCANS), bool)
        off[list(lost[i]), 60 + i : 65 + i] = True
        off[-1, 70:74] = True  # four in a row are not five
        error = (i + 1) * rng.uniform(0.5, 2, (runs, 1, 1)) * rng.standard_normal((runs, SCANS, 6))
        covariances = np.eye(6) * rng.uniform(1, 2, (runs, SCANS, 1, 1))
        results[name] = runs_of(error, off, covariances, seed=i)
        benign = rng.uniform(size=(runs, SCANS))
        results[name] = results[name]._replace(
            truth=np.zeros_like(error), x=error, modes=np.stack([benign, 1 - benign], axis=-1)
        )
    return results


def averaged(runs, chosen, states, epochs):
    """Temporally averaged rms error over some runs."""
    roots = []
    for t in np.flatnonzero(epochs):
        squares = [sum((runs.x[i, t, s] - runs.truth[i, t, s]) ** 2 for s in states) for i in chosen]
        roots.append(np.sqrt(sum(squares) / len(squares)))
    return sum(roots) / len(roots)


SETS = {
    "rmse": ((0, 1), EPOCH > 0), "velocity_rmse": ((2, 3), EPOCH > 0),
    "level_rmse": ((0, 1), LEVEL), "level_velocity_rmse": ((2, 3), LEVEL),
}  # fmt: skip


def test_a_row_has_errors_over_the_runs_kept_by_the_tracker_and_by_all():
    lost = {"few": (0, 2), "more": (1, 2, 4), "none": ()}
    results = some_results(lost, list(lost.values()))
    rows = TABLES["1"].summarise(WORLD, results)
    assert list(rows) == list(lost)
    times = "components", "gate_area", "time_per_scan", "time_worst"
    for name, runs in results.items():
        row = rows[name]
        assert set(row) == {
            "track_loss",
            *times,
            *(f"{e}_{which}" for e in ERRORS for which in ("own", "common")),
        }
        assert row["track_loss"] == wilson(len(lost[name]), 8)
        for which, chosen in (("own", set(range(8)) - set(lost[name])), ("common", (3, 5, 6, 7))):
            for error, (states, epochs) in SETS.items():
                figure = row[f"{error}_{which}"]
                assert figure.value == pytest.approx(averaged(runs, chosen, states, epochs), rel=1e-9)
                assert figure.low < figure.value < figure.high
        assert row["components"].value == pytest.approx(
            sum(map(sum, runs.components)) / (8 * SCANS), rel=1e-12
        )
        areas = [sum(runs.gate_volume[run]) for run in range(8) if run not in lost[name]]
        assert row["gate_area"].value == pytest.approx(sum(areas) / (len(areas) * SCANS), rel=1e-12)
        ordered = sorted(runs.seconds.ravel())  # 2800 of them
        assert row["time_per_scan"].value == pytest.approx((ordered[1399] + ordered[1400]) / 2, rel=1e-12)
        assert row["time_worst"].value == runs.seconds.max()
    assert rows["none"]["rmse_own"].value != rows["none"]["rmse_common"].value


def test_a_tracker_that_lost_every_run_has_no_errors_and_no_say_in_those_of_others():
    rows = TABLES["1"].summarise(WORLD, some_results(("all", "none"), [range(8), ()]))
    assert rows["all"]["track_loss"].value == 1 and np.isnan(rows["all"]["gate_area"].value)
    for error in ERRORS:
        assert np.isnan(rows["all"][f"{error}_own"].value)
        assert np.isnan(rows["all"][f"{error}_common"].value)
        assert np.isfinite(rows["none"][f"{error}_own"]).all()
        assert rows["none"][f"{error}_common"] == rows["none"][f"{error}_own"]


def test_differences_are_from_the_first_tracker_over_the_runs_that_the_two_kept():
    lost = {"first": (0, 2), "worse": (1, 2, 4), "worst": (7,)}
    results = some_results(lost, list(lost.values()))
    rows = TABLES["1"].paired(WORLD, results)
    assert list(rows) == ["worse - first", "worst - first"]
    for name in ("worse", "worst"):
        row = rows[f"{name} - first"]
        assert set(row) == {"track_loss", *(f"{error}_common" for error in ERRORS)}
        assert row["track_loss"].value == pytest.approx((len(lost[name]) - 2) / 8, rel=1e-12)
        both = set(range(8)) - set(lost["first"]) - set(lost[name])
        for error, (states, epochs) in SETS.items():
            figure = row[f"{error}_common"]
            mine, other = (averaged(results[who], both, states, epochs) for who in (name, "first"))
            assert figure.value == pytest.approx(mine - other, rel=1e-9)
            assert figure.value > 0 and figure.low < figure.value < figure.high


# figures


def only(lines, wanted):
    """The one line with these ordinates by epoch."""
    (line,) = (line for line in lines if np.allclose(line.get_ydata(), wanted, rtol=1e-9, atol=1e-12))
    np.testing.assert_array_equal(line.get_xdata(), EPOCH)
    return line


LOST = (0, 2), (1,), (1, 2, 4), (), (3,)


@pytest.fixture(scope="module")
def table_1():
    """Results and the drawings of Table I."""
    results = some_results(TABLES["1"].trackers, LOST)
    with pytest.MonkeyPatch.context() as patch:
        saved = catch_drawings(patch, maybeck)
        maybeck.figures(TABLES["1"], WORLD, results, {}, Path())
    return results, saved


def alive(lost, start):
    """Of eight runs, those not lost: the fifth scan off target is the last of a track."""
    return [8 - len(lost) * (epoch >= start) for epoch in EPOCH]


def test_table_1_has_errors_probabilities_and_the_three_figures_of_bands(table_1):
    results, drawn = table_1
    assert set(drawn) == {
        "errors-1.png", "probabilities-1-mmae-mht-15.png", "probabilities-1-mmae-of-mhts-15.png",
        "figure-5.png", "figure-6.png", "figure-7.png",
    }  # fmt: skip
    *panels, living = drawn["errors-1.png"].axes
    assert {text.get_text() for text in panels[0].figure.legends[0].get_texts()} == set(results)
    for i, (name, runs) in enumerate(results.items()):
        kept = [run for run in range(8) if run not in LOST[i]]
        colours = set()
        for axes, (a, b) in zip(panels, ((0, 1), (2, 3)), strict=True):
            squares = sum(runs.x[run, :, a] ** 2 + runs.x[run, :, b] ** 2 for run in kept)
            line = only(axes.lines, np.sqrt(squares / len(kept)))
            assert line.get_label() == name
            colours.add(line.get_color())
        # off target from scan 60 + i, counted from 0, for the fifth time at epoch 65 + i
        np.testing.assert_array_equal(living.lines[i].get_ydata(), alive(LOST[i], 65 + i))
        assert {living.lines[i].get_color()} == colours


@pytest.mark.parametrize(("file", "i"), [("figure-5", 0), ("figure-6", 1), ("figure-7", 2)])
def test_bands_are_twice_the_deviation_of_the_errors_and_of_the_filters(table_1, file, i):
    results, drawn = table_1
    drawing, (name, runs) = drawn[f"{file}.png"], list(results.items())[i]
    assert drawing.get_suptitle().startswith(name)
    kept, first = ([run for run in range(8) if run not in LOST[j]] for j in (i, 0))
    aggressive = next(iter(results.values()))
    for state, axes in enumerate(drawing.axes[:4]):
        error = np.array([runs.x[run, :, state] for run in kept])
        mean, deviation = error.sum(axis=0) / len(kept), error.std(axis=0)
        claimed = np.sqrt(sum(runs.P[run, :, state, state] for run in kept) / len(kept))
        bound = np.sqrt(sum(aggressive.P[run, :, state, state] for run in first) / len(first))
        only(axes.lines, mean)
        for sign in (-2, 2):
            only(axes.lines, mean + sign * deviation)
            solid = [line for line in axes.lines if line.get_linestyle() == "-"]
            only(solid, sign * claimed)
            only([line for line in axes.lines if line.get_linestyle() == ":"], sign * bound)
        assert len(axes.lines) == 7
    position, velocity, chances, living = drawing.axes[4:]
    for axes, (a, b) in ((position, (0, 1)), (velocity, (2, 3))):
        squares = sum(runs.x[run, :, a] ** 2 + runs.x[run, :, b] ** 2 for run in kept)
        only(axes.lines, np.sqrt(squares / len(kept)))
    for mode, label in enumerate(("benign", "aggressive")):
        mean = sum(runs.modes[run, :, mode] for run in kept) / len(kept)
        assert only(chances.lines, mean).get_label() == label
    only(living.lines, alive(LOST[i], 65 + i))


def test_probabilities_are_of_the_benign_motion_over_runs_and_in_the_first_that_was_kept(drawn, tmp_path):
    results = some_results(TABLES["clear"].trackers, [(), (0, 1), ()])
    flight = np.zeros((SCANS, 6))
    flight[:, 4], flight[:, 5] = 3 * EPOCH, np.cos(EPOCH / 9)
    results = {name: runs._replace(truth=np.tile(flight, (8, 1, 1))) for name, runs in results.items()}
    maybeck.figures(TABLES["clear"], WORLD, results, {}, tmp_path)
    assert set(drawn) == {"errors-clear.png", "probabilities-clear-mmae.png"}
    many, single, below = drawn["probabilities-clear-mmae.png"].axes
    benign = results["mmae"].modes[2:, :, 0]
    middle = only(many.lines, benign.sum(axis=0) / 6).get_ydata()
    edge = many.collections[0].get_paths()[0].vertices[:, 1]
    for sign in (-1, 1):
        assert np.isin(np.round(middle + sign * benign.std(axis=0), 9), np.round(edge, 9)).all()
    only(single.lines, benign[0])
    # a change of 3 m/s^2 in half a second, and of the cosine over the scans on either side, a second apart
    (line,) = below.lines
    wanted = [np.hypot(6.0, flight[t + 1, 5] - flight[t - 1, 5]) for t in range(1, SCANS - 1)]
    np.testing.assert_allclose(line.get_ydata()[1:-1], wanted, rtol=1e-9)


def test_a_tracker_that_lost_every_run_is_drawn_as_nothing(drawn, tmp_path):
    results = some_results(TABLES["clear"].trackers, [(), range(8), ()])
    maybeck.figures(TABLES["clear"], WORLD, results, {}, tmp_path)
    for drawing in drawn.values():
        drawing.draw_without_rendering()  # its scales and ticks
    errs, _, living = drawn["errors-clear.png"].axes
    assert [np.isnan(line.get_ydata()).all() for line in errs.lines] == [False, True, False]
    np.testing.assert_array_equal(living.lines[1].get_ydata(), alive(range(8), 66))


def test_the_bands_of_trackers_that_lost_every_run_are_empty(drawn, tmp_path):
    results = some_results(TABLES["1"].trackers, [range(8)] * 5)
    maybeck.figures(TABLES["1"], WORLD, results, {}, tmp_path)
    drawn["figure-6.png"].draw_without_rendering()
    panels = drawn["figure-6.png"].axes
    assert all(np.isnan(line.get_ydata()).all() for axes in panels[:7] for line in axes.lines)
    np.testing.assert_array_equal(panels[7].lines[0].get_ydata(), alive(range(8), 66))


def test_errors_can_be_drawn_where_every_tracker_lost_every_run(drawn, tmp_path):
    # as few runs of the benign filters do
    results = some_results(TABLES["benign"].trackers, [range(8)] * 2)
    maybeck.figures(TABLES["benign"], WORLD, results, {}, tmp_path)
    drawn["errors-benign.png"].draw_without_rendering()


# models in the mixture, or in banks of filters

SHORT, CUTOFF = 6, 100.0
JUMP = replace(gym.make("gmr_gym/JumpMarkov-v0").unwrapped.scenario, patience=2, cutoff=CUTOFF)


def outcomes_of(names, lost, seed=5, runs=7):
    """Short runs of four states, every tracker's errors another's, some beyond the cutoff."""
    rng, results = np.random.default_rng(seed), {}
    for i, name in enumerate(names):
        off = np.zeros((runs, SHORT), bool)
        off[list(lost[i]), 2:4] = off[-1, 0] = True
        error = rng.normal(0, 10.0 * (i + 1), (runs, SHORT, 4))
        error[i % runs, 3, 0] = 1e6  # a scan that counts no more than the cutoff
        error[list(lost[i]), 4:, :2] = 90.0  # nor is 127 m more than 100 m
        results[name] = runs_of(error, off, seed=i)
    return results


def capped(runs):
    """Mean position error of every run, no scan above the cutoff."""
    means = []
    for x, truth in zip(runs.x, runs.truth, strict=True):
        far = [min(np.hypot(*(x[t] - truth[t])[:2]), CUTOFF) for t in range(SHORT)]
        means.append(sum(far) / SHORT)
    return means


NAMED = {"mmg-15": (0, 4), "mmg-30": (), "mmae-mht-15": (1, 3, 5), "one-motion-15": (2,)}


def test_the_capped_error_is_capped_scan_by_scan_and_counts_the_lost_runs():
    results = outcomes_of(NAMED, list(NAMED.values()))
    rows = MIXED["jump"].summarise(JUMP, results)
    for (name, runs), lost in zip(results.items(), NAMED.values(), strict=True):
        wanted, row = capped(runs), rows[name]
        assert row["error_capped"].value == pytest.approx(sum(wanted) / 7, rel=1e-9)
        assert row["error_capped"].low < row["error_capped"].value < row["error_capped"].high
        assert row["track_loss"] == wilson(len(lost), 7)
        assert max(wanted) < CUTOFF
        # it is another over the runs kept
        own = [far for run, far in enumerate(wanted) if run not in lost]
        assert bool(lost) == (abs(sum(own) / len(own) - row["error_capped"].value) > 0.1)


def test_differences_of_capped_errors_are_from_the_first_tracker_over_all_runs():
    results = outcomes_of(NAMED, list(NAMED.values()))
    rows = MIXED["jump"].paired(JUMP, results)
    first, *others = NAMED
    assert list(rows) == [f"{other} - {first}" for other in others]
    for other in others:
        row = rows[f"{other} - {first}"]
        gain = [a - b for a, b in zip(capped(results[other]), capped(results[first]), strict=True)]
        assert set(row) == {"track_loss", "error_capped"}
        assert row["error_capped"].value == pytest.approx(sum(gain) / 7, rel=1e-9)
        assert row["track_loss"].value == pytest.approx((len(NAMED[other]) - 2) / 7, rel=1e-12)
    assert rows["one-motion-15 - mmg-15"]["error_capped"].value > 0
    assert rows["mmg-30 - mmg-15"]["track_loss"].value < 0 < rows["mmae-mht-15 - mmg-15"]["track_loss"].value


MEASURES = (
    "capped error over all runs, its less the other's, m", "share of runs lost, its less the other's",
    "capped error over the runs that both kept, its less the other's, m",
)  # fmt: skip


def told_of(rng, level, lost=(), runs=40):
    """Errors about this level, and far above it in the runs lost."""
    gone = np.isin(np.arange(runs), lost)
    return Evidence(error=np.where(gone, 90.0, level) + rng.normal(0, 0.1, runs), kept=~gone)


def excesses(mmg, bank):
    """The three numbers of a pair, by plain loops; None for no runs that both kept."""
    gain = [a - b for a, b in zip(mmg.error, bank.error, strict=True)]
    both = [gain[run] for run in range(len(gain)) if mmg.kept[run] and bank.kept[run]]
    more = sum(map(int, ~mmg.kept)) - sum(map(int, ~bank.kept))
    return sum(gain) / len(gain), more / len(gain), sum(both) / len(both) if both else None


def test_every_mmg_is_held_against_every_architecture_and_no_other_in_three_measures():
    rng = np.random.default_rng(6)
    told = {
        "mmg-15": told_of(rng, 12.0), "mmae-mht-15": told_of(rng, 10.0, range(15)),
        "mmg-30": told_of(rng, 7.0, range(30)), "imm-of-mhts-15": told_of(rng, 9.0, range(10, 40)),
        "one-motion-15": told_of(rng, 30.0),
    }  # fmt: skip
    drawn = {who: told[who] for who in ("imm-of-mhts-15", "mmg-30")}
    records = mixed_claims({"flight": told, "drawn": drawn})
    json.dumps(records, allow_nan=False)
    verdicts = {
        ("mmg-15", "mmae-mht-15"): ("fails", "fails", "holds"),
        ("mmg-15", "imm-of-mhts-15"): ("fails", "fails", "holds"),
        ("mmg-30", "mmae-mht-15"): ("holds", "holds", "fails"),
        ("mmg-30", "imm-of-mhts-15"): ("tie", "tie", "unknown"),
    }
    by_claim = {(r["table"], r["claim"], r["measure"]): r for r in records}
    asked = [("flight", *pair) for pair in verdicts] + [("drawn", "mmg-30", "imm-of-mhts-15")]
    assert len(records) == len(by_claim) == 3 * len(asked)
    for table, mmg, bank in asked:
        wanted = zip(MEASURES, excesses(told[mmg], told[bank]), verdicts[mmg, bank], strict=True)
        for measure, excess, verdict in wanted:
            record = by_claim[table, f"{mmg} is inferior to {bank}", measure]
            assert record["runs"] == "all 40" and record["threshold"] == 0
            assert record["value"] == (excess if excess is None else pytest.approx(excess, rel=1e-9))
            assert record["verdict"] == verdict
    assert mixed_claims({}) == []


@pytest.mark.parametrize(
    "table", [t for t in maybeck_zhang.TABLES if t.name in ASKED_OF], ids=lambda t: t.name
)
def test_the_claims_of_a_table_are_of_its_mmgs_against_the_four_architectures(table):
    told = {name: told_of(np.random.default_rng(i), 9.0) for i, name in enumerate(table.trackers)}
    records = mixed_claims({table.name: told})
    banks = "mmae-mht-15", "imm-mht-15", "mmae-of-mhts-15", "imm-of-mhts-15"
    mmgs = [name for name in table.trackers if name.startswith("mmg-")]
    wanted = {f"{mmg} is inferior to {bank}" for mmg in mmgs for bank in banks}
    assert {record["claim"] for record in records} == wanted and len(records) == 3 * len(wanted)


def test_a_lost_run_is_part_of_what_is_claimed():
    results = outcomes_of(NAMED, list(NAMED.values()))
    table = MIXED["jump"]
    told = maybeck_zhang.PAPER.evidence(table, JUMP, results)
    assert list(told) == list(NAMED)
    for name, lost in NAMED.items():
        assert np.flatnonzero(~told[name].kept).tolist() == list(lost)
        np.testing.assert_allclose(told[name].error, capped(results[name]), rtol=1e-9)
    records = mixed_claims({"jump": told})
    found = {r["measure"]: r["value"] for r in records if r["claim"] == "mmg-15 is inferior to mmae-mht-15"}
    gain = np.subtract(capped(results["mmg-15"]), capped(results["mmae-mht-15"]))
    assert found == pytest.approx(
        dict(zip(MEASURES, (gain.mean(), (2 - 3) / 7, (gain[2] + gain[6]) / 2), strict=True)), rel=1e-9
    )


@pytest.mark.parametrize("seeds", [1, 2, 3])
def test_a_run_drawn_more_often_counts_more_often(seeds):
    rng = np.random.default_rng(seeds)
    mmg, bank = told_of(rng, 8.0, (0, 3), runs=6), told_of(rng, 9.0, (3, 4), runs=6)
    weight = rng.multinomial(6, np.full(6, 1 / 6)).astype(float)
    drawn = np.repeat(np.arange(6), weight.astype(int))
    again = [Evidence(error=one.error[drawn], kept=one.kept[drawn]) for one in (mmg, bank)]
    for measure, wanted in zip(MEASURES, excesses(*again), strict=True):
        assert maybeck_zhang.MEASURES[measure](weight, mmg, bank) == pytest.approx(wanted, rel=1e-9)
    assert np.isnan(maybeck_zhang.MEASURES[MEASURES[2]](np.array([1.0, 0, 0, 2, 3, 0]), mmg, bank))


@pytest.mark.parametrize("table", maybeck_zhang.TABLES, ids=lambda table: table.name)
def test_either_papers_trackers_have_the_same_reduction_and_numbers_that_can_be_compared(table):
    scenario = gym.make(table.env_id, **table.settings).unwrapped.scenario
    flight = not table.name.startswith("jump")
    assert (table.env_id == "gmr_gym/AgileFlight-v0") == flight
    assert len(scenario.model.motions) == (2 if flight else 5)
    names = list(table.trackers)
    assert names[0].startswith("mmg") and not table.published
    reduction = "ise" if table.name.endswith("-ise") else "runnalls"
    for name, parameters in table.trackers.items():
        assert parameters.get("reduction", "runnalls") == reduction
        # two MHTs have half the hypotheses each; a MMG has four for each that it keeps
        wanted = {"mmg-60": 240, "mmg-75": 300}.get(name, 100 if "-of-mhts" in name else 200)
        assert parameters["max_hypotheses"] == wanted
    mmgs = [int(name.rpartition("-")[2]) for name in names if name.startswith("mmg")]
    banks = [name.rpartition("-")[0] for name in names if not name.startswith("mmg")]
    if table.name.endswith("-work"):
        assert set(banks) == {"mmae-mht", "imm-mht"} and mmgs == sorted(set(mmgs)) and len(mmgs) > 3
        assert table.name not in ASKED_OF
        return
    assert set(banks) == set(NAMES.values()) and table.name in ASKED_OF
    # as many as a bank has hypotheses; and as many as it has Gaussians in them
    assert mmgs == ([15] if reduction == "ise" else [15, 15 * len(scenario.model.motions)])
    alone = make_tracker("one-motion-15", scenario.model, **table.trackers["one-motion-15"])
    assert isinstance(alone, BankOfMhts)
    followed = [motion is alone.model.motions[0] for motion in scenario.model.motions]
    assert followed.index(True) == flight  # the aggressive one; the one that coasts


def test_a_target_that_does_as_the_trackers_are_told_is_drawn_anew():
    drawing, sticky = set(), set()
    for name, table in MIXED.items():
        scenario = gym.make(table.env_id, **table.settings).unwrapped.scenario
        truths = [scenario.truth(np.random.default_rng(seed)).x for seed in (0, 1)]
        drawing |= set() if np.array_equal(*truths) else {name}
        if np.array_equal(scenario.model.switching, [[0.98, 0.02], [0.02, 0.98]]):
            sticky.add(name)
    assert drawing == {"drawn", "drawn-sticky", "jump", "jump-quiet", "jump-quiet-ise", "jump-quiet-work"}
    assert sticky == {"flight-sticky", "drawn-sticky", "flight-work"}


def test_the_capped_error_is_drawn_against_time(drawn, tmp_path):
    rows = {
        f"mmg-{i}": {
            "error_capped": Estimate(5.0 + i, 4.0, 8.0 + i), "rmse_own": Estimate(1.0, 0.5, 2.0),
            "time_per_scan": Estimate(1e-3 * (i + 1)), "track_loss": Estimate(0.25),
        }
        for i in range(3)
    }  # fmt: skip
    maybeck_zhang.figures(MIXED["flight"], WORLD, {}, rows, tmp_path)
    (axes,) = drawn["figure-flight.png"].axes
    at = [(text.xy, text.get_text()) for text in axes.texts]
    assert at == [((pytest.approx(i + 1), 5 + i), f"mmg-{i} (25 % lost)") for i in range(3)]
    assert "at most 500 in a scan" in axes.get_ylabel()
