"""Fly the F-16 of JSBSim through level flight, 4 g turns and jinking: 175 s at 2 Hz.

    python fly_f16.py OUT.csv

A reconstruction, in kind and not in detail, of the flight that Maybeck, Kozak and Smith (2008,
section V) recorded in FlightGear, whose flight model is JSBSim, and did not publish. Their
schedule is kept, in epochs of 0.5 s: 1-44 level, 45-100 turns, 101-199 level, 200-250 jinking,
251-350 level. The banks and load factors are ours, so mild that the innovations of their aggressive
Kalman filter, fed the exact positions, peak at a squared Mahalanobis distance of 2.6 in the jinking
and 1.8 in the turns: that filter's lag, not the clutter, loses the tracks of wilder flights.

No random numbers: the same JSBSim writes the same file.
"""

import math
import sys
from pathlib import Path
from typing import NamedTuple

import jsbsim
import numpy as np

RATE = 120  # Hz, of the flight model and of the pilot
EPOCH = 60  # steps of 1 / RATE
EPOCHS = 350
SETTLING = 30 * RATE  # steps of level flight before epoch 1, not recorded
HEIGHT = 6000.0  # m above sea level
SPEED = 245.0  # m/s through the air, which is still
HEADING_DEG = 25.0  # a turn at heading 0 does not show in the north-up plane
FOOT = 0.3048  # m
GRAVITY = 9.81  # m/s^2


class Leg(NamedTuple):
    """Bank and load factor that the pilot holds from `epoch` to the next leg."""

    epoch: int
    bank_deg: float  # right wing down is positive
    load_factor: float = math.nan  # g; NaN: whatever holds the height at which the leg began
    aileron: float = 0.4  # most stick to the side, of 1: 80 degrees of roll a second


LEGS = (
    Leg(1, 0),
    Leg(45, 74.5),  # about 4 g, since 1 / cos(74.5 deg) = 3.7
    Leg(69, -74.5, aileron=0.2),
    Leg(97, 0),
    Leg(200, 69.5),
    Leg(207, -69.5),
    Leg(215, 69.5),
    Leg(222, 0),
    Leg(225, 0, 3.6),
    Leg(230, 0, -0.4),
    Leg(240, 0),
)

COLUMNS = (
    "time_s,north_m,up_m,north_velocity_mps,up_velocity_mps,north_acceleration_mps2,"
    "up_acceleration_mps2,load_factor_g,airspeed_mps,altitude_m,east_m"
)


def main(path):
    """Fly and write the file."""
    path.write_text(text(trajectory(flown(LEGS))), encoding="utf-8")


def flown(legs):
    """Every step (steps, 6) from settled flight to the last epoch: north, up and east velocity in
    m/s, load factor in g, airspeed in m/s, height above sea level in m."""
    fdm = started()
    starts = [(leg.epoch - 1) * EPOCH for leg in legs[1:]]
    lengths = np.diff([-SETTLING, *starts, (EPOCHS - 1) * EPOCH + 2])
    rows = []
    for leg, steps in zip(legs, lengths, strict=True):
        height = fdm["position/h-sl-meters"]
        for _ in range(steps):
            fly(fdm, leg, height)
            rows.append(instruments(fdm))
    return np.array(rows[SETTLING - 1 :])


def started():
    """A flight model in the air, roughly trimmed, gear up and engine running."""
    fdm = jsbsim.FGFDMExec(None)
    fdm.set_debug_level(0)
    fdm.load_model("f16")
    fdm.set_dt(1 / RATE)
    fdm["ic/h-sl-ft"] = HEIGHT / FOOT
    fdm["ic/vt-fps"] = SPEED / FOOT
    fdm["ic/psi-true-deg"] = HEADING_DEG
    fdm["ic/alpha-deg"] = 1.2
    fdm["ic/theta-deg"] = 1.2
    fdm["gear/gear-cmd-norm"] = fdm["gear/gear-pos-norm"] = 0
    fdm.run_ic()
    fdm["propulsion/set-running"] = -1  # every engine
    return fdm


def fly(fdm, leg, height):
    """One step with stick and throttle moved towards the leg; the fly-by-wire does the rest."""
    climb = -fdm["velocities/v-down-fps"] * FOOT
    wanted = leg.load_factor
    if math.isnan(wanted):
        lift = 1 + (clipped(0.15 * (height - fdm["position/h-sl-meters"]), 20) - climb) * 0.5 / GRAVITY
        wanted = min(max(lift / max(math.cos(fdm["attitude/phi-rad"]), 0.22), -1), 4.5)
    error = wanted - fdm["accelerations/Nz"]
    # full stick is 9 g above the 0.4 g of a free stick, and back is negative; trim takes the remainder
    fdm["fcs/elevator-cmd-norm"] = -(wanted - 0.4) / 9 - 0.05 * error
    fdm["fcs/pitch-trim-cmd-norm"] -= 0.05 * clipped(error, 1) / RATE
    turn = math.remainder(math.radians(leg.bank_deg) - fdm["attitude/phi-rad"], math.tau)
    fdm["fcs/aileron-cmd-norm"] = clipped(0.5 * turn, leg.aileron)
    fdm["fcs/throttle-cmd-norm"] = min(max(0.4 + 0.05 * (SPEED - airspeed(fdm)), 0), 1)
    fdm.run()


def clipped(x, bound):
    """The number x, held between -bound and bound."""
    return min(max(x, -bound), bound)


def airspeed(fdm):
    """Metres per second through the air."""
    return fdm["velocities/vt-fps"] * FOOT


def instruments(fdm):
    """One row of `flown`."""
    north, east, down = (fdm[f"velocities/v-{axis}-fps"] * FOOT for axis in ("north", "east", "down"))
    return north, -down, east, fdm["accelerations/Nz"], airspeed(fdm), fdm["position/h-sl-meters"]


def trajectory(rows):
    """The file's columns (EPOCHS, 11) of the steps (steps, 6) flown.

    Positions are velocities summed by the trapezium rule, accelerations their central differences:
    both at 120 Hz, so the three agree.
    """
    v = rows[:, :3]
    x = np.cumsum((v[1:] + v[:-1]) / (2 * RATE), axis=0)
    a = (v[2:] - v[:-2]) * RATE / 2
    at = EPOCH * np.arange(EPOCHS)
    x, v, a, rest = x[at] - x[0], v[1:][at], a[at], rows[1:, 3:][at]
    time = (1 + np.arange(EPOCHS)) * EPOCH / RATE
    return np.column_stack([time, x[:, :2], v[:, :2], a[:, :2], rest, x[:, 2]])


def text(x):
    """The file: comments, column names, rows."""
    rows = "".join(",".join(f"{c:.3f}" for c in row + 0.0) + "\n" for row in np.round(x, 3))
    return (
        "# A reconstruction, not the flight of Maybeck et al. (2008), which is unpublished: the f16"
        f" of JSBSim {jsbsim.__version__} flown by fly_f16.py\n"
        "# Epoch k of 350 is at k / 2 s. Level 1-44, turns 45-100, level 101-199, jinking 200-250, level\n"
        "# 251-350. Position from the first epoch, so up is height gained and altitude is above sea level;\n"
        "# north and east are distances run over a round turning Earth, still air. Accelerations are rates\n"
        "# of change of velocity, without gravity; load factor is along the aircraft's normal axis.\n"
        f"{COLUMNS}\n{rows}"
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
