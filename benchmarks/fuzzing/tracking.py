"""Trackers as targets: every one that is installed, over hostile models and scans."""

from collections.abc import Iterator
from functools import cache, partial
from importlib.metadata import entry_points
from inspect import signature
from time import monotonic
from typing import Any

import numpy as np

from fuzzing import checks
from fuzzing.cases import Finding, Spoilt, Target
from fuzzing.inputs import LAYOUTS, Rng, in_layout, spoilt_points
from fuzzing.worlds import MODELS, POPULATIONS, hostile_model, hostile_population, hostile_scan
from gmr_gym.filters.registry import GROUP, MULTI_TARGET_GROUP, make_tracker, trackers

UNFIT = "knows one motion|needs a radar|linear sensor|of one motion|has an update of its own"
BEYOND = "1e10|1e\\+10"  # coordinates that a tracker refuses
SLOW = ("fmm-em", "fmm-gibbs", "fitted-phd", "learning-phd", "gm-cphd", "ise", "mmae-of-mhts", "imm-of-mhts")
LONG = 100_000  # scans of one belief, or as many as there is time for


def tracker_targets() -> Iterator[Target]:
    """Every tracker, over a few scans and over very many."""
    for group, world, pool in (
        (GROUP, hostile_model, MODELS),
        (MULTI_TARGET_GROUP, hostile_population, POPULATIONS),
    ):
        for name in trackers(group):
            share = 0.5 if name in SLOW else 2.0
            few = Target(
                f"tracker/{name}",
                partial(_draw, name, world, pool),
                partial(_track, world),
                partial(_check, world, group == MULTI_TARGET_GROUP),
                _spoil,
                share,
                refuses=BEYOND,
                patience=3.0,
            )
            yield few
            yield Target(
                f"tracker/{name}/made",
                partial(_draw_parameters, world, 5 if group == GROUP else 3, name),
                partial(_parameters, world),
                lambda arguments, tracker: None,
                _spoil_parameters,
                share / 5,
                refuses=UNFIT,
                patience=3.0,
            )
            yield few._replace(
                name=f"tracker/{name}/5000",
                draw=partial(_draw_huge, name, world, pool),
                spoil=None,
                share=share / 500,
                patience=12.0,
            )
            yield few._replace(
                name=f"tracker/{name}/long",
                draw=partial(_draw_long, name, world, pool),
                call=partial(_track_long, world, group == MULTI_TARGET_GROUP),
                check=lambda arguments, result: None,
                spoil=None,
                share=share / 5000,
                patience=12.0,
            )


def _draw(name: str, world, pool: int, rng: Rng) -> tuple:
    index = _fitting(world, pool, name, rng)
    told = world(index)
    plain = [hostile_scan(rng, told, alone=name == "clairvoyant") for _ in range(rng.integers(1, 5))]
    given = plain
    if rng.random() < 0.15:
        layout = LAYOUTS[rng.integers(len(LAYOUTS))]
        if layout in ("float32", "whole"):
            plain = [in_layout(z, layout).astype(float) for z in plain]
            plain = [_settled(told, z) for z in plain]
        given = [in_layout(z, layout) for z in plain]
        if layout == "masked":
            hidden = [rng.random(len(z)) < 0.3 for z in plain]
            given = [
                np.ma.array(z, mask=np.repeat(h[:, None], z.shape[1], 1))
                for z, h in zip(plain, hidden, strict=True)
            ]
            plain = [z[~h] for z, h in zip(plain, hidden, strict=True)]
    return name, index, given, plain


def _settled(told, z: np.ndarray) -> np.ndarray:
    """Without what rounding has made impossible."""
    return z[told.sensor.wrap_and_validate(z)[1]]


def _draw_huge(name: str, world, pool: int, rng: Rng) -> tuple:
    index = _fitting(world, pool, name, rng)
    z = hostile_scan(rng, world(index), alone=name == "clairvoyant", k=5000)
    return name, index, [z], [z]


def _draw_long(name: str, world, pool: int, rng: Rng) -> tuple:
    return name, _fitting(world, pool, name, rng), int(rng.integers(2**31))


def _spoil(rng: Rng, arguments: tuple) -> Spoilt:
    name, index, _, plain = arguments
    spoilt = spoilt_points(rng, plain[-1], ("z",))
    scans = [*plain[:-1], *spoilt.arguments]
    return Spoilt((name, index, scans, scans), spoilt.names, f"a scan with {spoilt.what}")


@cache
def _defaults(group: str, name: str) -> dict[str, Any]:
    """The numbers and names that a tracker takes, as they are by default."""
    takes = [
        each
        for factory in entry_points(group=group, name=name)
        for each in list(signature(factory.load()).parameters.values())[1:]
    ]
    return {each.name: each.default for each in takes if type(each.default) in (int, float, str)}


def _draw_parameters(world, pool: int, name: str, rng: Rng) -> tuple:
    given = {key: value for key, value in _defaults_of(name).items() if rng.random() < 0.5}
    for key, _value in given.items():
        if key == "components":
            given[key] = int(rng.integers(2, 200))
    return name, _fitting(world, pool, name, rng), given


def _spoil_parameters(rng: Rng, arguments: tuple) -> Spoilt:
    name, index, given = arguments
    known = _defaults_of(name)
    key = [*known, "no_such"][rng.integers(len(known) + 1)]
    bad = ("no-such", 3, b"x") if isinstance(known.get(key), str) else (np.nan, -1, "x", 1j, -np.inf)
    value = bad[rng.integers(len(bad))]
    return Spoilt((name, index, given | {key: value}), (key,), f"{key}={value!r}")


def _defaults_of(name: str) -> dict[str, Any]:
    return _defaults(GROUP, name) or _defaults(MULTI_TARGET_GROUP, name)


def _parameters(world, name: str, index: int, given: dict) -> Any:
    return make_tracker(name, world(index), **given)


@cache
def _made(world, name: str, index: int) -> Any:
    """The tracker told world(index); None where it does not track such."""
    own = {} if index % 2 == 0 or "components" not in _defaults_of(name) else {"components": 2 + index % 7}
    try:
        return make_tracker(name, world(index), **own)
    except ValueError as error:
        if any(part in str(error) for part in UNFIT.split("|")):
            return None
        raise


def _fitting(world, pool: int, name: str, rng: Rng) -> int:
    """A world that the tracker tracks, or fails to be made for."""
    while True:
        index = int(rng.integers(pool))
        try:
            if _made(world, name, index) is not None:
                return index
        except Exception:
            return index


def _track(world, name: str, index: int, given: list, plain: list) -> list:
    """What a tracker reports of each scan."""
    tracker = _made(world, name, index)
    belief, reports = tracker.init(), []
    for z in given:
        belief, report = tracker.step(belief, z)
        reports.append(report)
    return reports


def _check(world, many: bool, arguments: tuple, reports: list) -> None:
    name, index, given, plain = arguments
    for report in reports:
        (check_account if many else check_report)(world(index), report)
    if given is not plain:
        again = _track(world, name, index, plain, plain)
        checks.same("variant", "scans otherwise laid out", tuple(reports), tuple(again))


def check_report(told, report) -> None:
    """What a tracker of one target says of a scan."""
    d, r = told.sensor.H.shape[1], len(told.motions)
    if report.x.shape != (1, d) or report.P.shape != (1, d, d) or report.modes.shape not in ((1,), (r,)):
        raise Finding("shape", f"x {report.x.shape}, P {report.P.shape}, modes {report.modes.shape}")
    checks.finite("x", report.x)
    checks.covariances("P", report.P)
    checks.mixture(report.mixture, d, 1.0)
    checks.finite("modes", report.modes)
    if (report.modes < 0).any() or abs(report.modes.sum() - 1) > 1e-9:
        raise Finding("moments", f"modes {report.modes.tolist()} do not sum to 1")
    checks.finite("gates.z", report.gates.z)
    checks.covariances("gates.S", report.gates.S)
    if not report.gates.threshold >= 0 or report.alive not in (True, False):
        raise Finding("value", f"gates of size {report.gates.threshold}, alive {report.alive}")


def check_account(told, account) -> None:
    """What a tracker of many targets says of a scan."""
    d, j = told.sensor.H.shape[1], len(account.x)
    if account.x.shape != (j, d) or account.existence.shape != (j,) or account.label.shape != (j,):
        raise Finding("shape", f"x {account.x.shape}, existence {account.existence.shape}")
    checks.finite("x", account.x)
    checks.finite("expected", account.expected_targets)
    if not ((account.existence >= 0) & (account.existence <= 1)).all():
        raise Finding("value", f"existence {account.existence.tolist()}")
    own = account.label[account.label >= 0]
    if len(np.unique(own)) < len(own):
        raise Finding("value", f"a label is there twice: {account.label.tolist()}")
    checks.mixture(account.intensity, d)
    whole = account.intensity.w.sum()
    if not abs(whole - account.expected_targets) <= 1e-6 * (1e-300 + whole):
        raise Finding(
            "moments", f"{account.expected_targets} targets are expected, and weights sum to {whole}"
        )
    if not 0 <= account.clutter.expected < np.inf:
        raise Finding("not finite", f"clutter of {account.clutter.expected} a scan")


def _track_long(world, many: bool, name: str, index: int, seed: int) -> None:
    """One belief through very many scans: some hostile ones, then what such a target might show, and over."""
    tracker, told, rng = _made(world, name, index), world(index), np.random.default_rng(seed)
    alone = name == "clairvoyant"
    scans = [hostile_scan(rng, told, alone=alone, k=None if rng.random() < 0.5 else 1) for _ in range(256)]
    scans = [np.clip(z[:20], -1e9, 1e9) for z in scans]  # none that would be refused
    belief, until = tracker.init(), monotonic() + 40
    for t in range(LONG):
        belief, report = tracker.step(belief, scans[(t * 7919 + t // 256) % 256])
        if t % 1000 == 0:
            (check_account if many else check_report)(told, report)
            if monotonic() > until:
                break
