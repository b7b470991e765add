"""Units and times of columns are what they are written to be, to the last nanosecond, or refused."""

from datetime import UTC, date, datetime, timedelta

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmr_gym.recorded.times import NANOSECONDS, read_times
from gmr_gym.recorded.units import (
    ANGLE,
    LENGTH,
    QUANTITY,
    SPEED,
    TIME,
    UNITS,
    quantity_typed,
    scale_of,
    unit_in_name,
    unit_named,
)


def at(i):
    return f"f.csv, line {i + 2}, column t"


@pytest.mark.parametrize(
    "unit, si",
    [
        ("nmi", 1852), ("NM", 1852), ("ft", 0.3048), ("FL", 30.48), ("knots", 1852 / 3600), ("km/h", 1 / 3.6),
        ("deg", np.pi / 180), ("mrad", 1e-3), ("us", 1e-6), ("h", 3600),
    ],
)  # fmt: skip
def test_units_are_their_definitions(unit, si):
    assert scale_of(unit, QUANTITY[unit_named(unit)], "x") == pytest.approx(si, rel=1e-15)


@given(st.sampled_from(sorted(QUANTITY)), st.floats(1e-3, 1e6), st.sampled_from([" ", "_", " (", " ["]))
def test_a_quantity_and_a_name_with_any_unit_round_trip(unit, value, mark):
    quantity = QUANTITY[unit]
    assert quantity_typed(f"{value!r} {unit}", quantity, "x") == pytest.approx(
        value * UNITS[quantity][unit], rel=1e-15
    )
    closing = {" (": ")", " [": "]"}.get(mark, "")
    assert unit_in_name(f"column{mark}{unit}{closing}") == unit


@pytest.mark.parametrize(
    "text, quantity, message",
    [
        ("5 knot", SPEED, "unknown unit 'knot', did you mean 'knots'?"),
        ("5 metrs", LENGTH, "unknown unit 'metrs', did you mean 'metres'?"),
        ("5 s", LENGTH, "s is a unit of time, but a length is needed: m, km, ft, nmi, FL"),
        ("five m", LENGTH, "'five m' is not a number with a unit, such as 5m"),
        ("1.2.3", ANGLE, "'1.2.3' is not a number"),
    ],
)
def test_what_is_no_quantity_is_refused(text, quantity, message):
    with pytest.raises(ValueError, match=r"^here: ") as error:
        quantity_typed(text, quantity, "here")
    assert message in str(error.value)


SINCE_1970 = st.integers(946_684_800 * 10**9, 4_102_444_800 * 10**9 - 1)


@given(st.lists(SINCE_1970, min_size=1, max_size=5), st.sampled_from(["s", "ms", "us", "ns"]))
def test_times_since_1970_keep_every_nanosecond(ns, unit):
    scale = NANOSECONDS[unit]
    cells = [
        f"{value // scale}.{value % scale:0{len(str(scale)) - 1}d}" if scale > 1 else str(value)
        for value in ns
    ]
    times = read_times(cells, unit, at)
    assert times.ns.tolist() == ns and times.absolute


@given(
    st.lists(st.datetimes(datetime(2000, 1, 2), datetime(2099, 1, 1)), min_size=1, max_size=4),
    st.integers(-720, 720),
)
def test_iso_times_and_stated_formats_round_trip(moments, minutes):
    expected = [(m - datetime(1970, 1, 1)) // timedelta(microseconds=1) * 1000 for m in moments]
    for form, text in ((None, "T"), ("iso", " ")):
        assert read_times([m.isoformat(text) for m in moments], form, at).ns.tolist() == expected
    assert read_times([m.isoformat() + "Z" for m in moments], None, at).ns.tolist() == expected
    offset = f"{'+' if minutes >= 0 else '-'}{abs(minutes) // 60:02d}:{abs(minutes) % 60:02d}"
    shifted = read_times([m.isoformat() + offset for m in moments], None, at).ns
    assert (np.array(expected) - shifted == minutes * 60 * 10**9).all()
    form = "%d/%m/%Y %H:%M:%S.%f"
    assert read_times([m.strftime(form) for m in moments], form, at).ns.tolist() == expected


def test_elapsed_times_are_exact_and_have_no_date():
    times = read_times(["0", "0.1", "0.30000000000000004", "1e3"], "s", at)
    assert (
        times.ns.tolist() == [0, 100_000_000, 300_000_000, 10**12]
        and not times.absolute
        and times.start is None
    )
    assert read_times(["1", "1.5"], "min", at).ns.tolist() == [60 * 10**9, 90 * 10**9]


def test_seconds_of_the_day_go_on_past_midnight():
    cells = ["86399.5", "0.25", "86399.75", "1.0"]  # one late row
    times = read_times(cells, "s", at, date(2024, 2, 29))
    assert times.start == datetime(2024, 2, 29, 23, 59, 59, 500_000, tzinfo=UTC)
    assert ((times.ns - times.ns[0]) / 1e9).tolist() == [0, 0.75, 0.25, 1.5]
    clock = read_times(["23:59:58", "00:00:01"], "%H:%M:%S", at)
    assert np.diff(clock.ns).tolist() == [3 * 10**9] and not clock.absolute


@pytest.mark.parametrize(
    "cells, form, message",
    [
        (["0.5", ""], "s", "line 3, column t: no time"),
        (
            ["1477010443000000"],
            "s",
            "1477010443000000 s is 4.68e+07 years; it is a time since 1970 in us: give --time C",
        ),
        (["1620114893034"], "s", "it is a time since 1970 in ms"),
        (["1e300"], "s", "1.000000000000000053e+300 s is 3.17e+292 years; another unit?"),
        (
            ["86399.9", "0.1"],
            "s",
            "line 3, column t: time goes back from 86399.9 s to 0.1 s, as seconds of the day do",
        ),
        (
            ["1620114893", "1620114894", "7"],
            "s",
            "line 4, column t: 7 s follows 1620114894 s: one is since 1970",
        ),
        (["12/01/2016 13:02"], None, "'12/01/2016 13:02' is no ISO 8601 time; give its form, such as"),
        (["12.5"], None, "'12.5' is a number; say of what by --time COLUMN:s"),
        (
            ["2016-01-12 13:02", "2016-01-12T13:02Z"],
            None,
            "line 3, column t: '2016-01-12T13:02Z': some times have a zone",
        ),
        (["2016-13-12 13:02"], "%Y-%m-%d %H:%M", "'2016-13-12 13:02' is not of the form '%Y-%m-%d %H:%M'"),
        (["1"], "sec.", "unknown unit 'sec.', did you mean 'sec'?"),
        (["1"], "km", "km is a unit of length, but a time is needed"),
    ],
)
def test_times_are_never_guessed(cells, form, message):
    with pytest.raises(ValueError, match=r"^f\.csv, line") as error:
        read_times(cells, form, at)
    assert message in str(error.value)


def test_a_time_of_day_is_within_a_day():
    with pytest.raises(ValueError, match="90000 s is no time of a day; leave --day out"):
        read_times(["90000"], "s", at, date(2024, 1, 1))
    assert NANOSECONDS["s"] * UNITS[TIME]["min"] == NANOSECONDS["min"]
