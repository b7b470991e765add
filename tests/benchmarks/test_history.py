"""What the benchmark says has become slower, and that noise is not said."""

import numpy as np
import pytest

INTERVAL = 0.04  # of the ratio, on either side


def record(
    ratio, within=INTERVAL, what="scan, PDA", against="plain NumPy", processor="a chip, 2 cores", day=1
):
    low, high = (None, None) if within is None else (ratio * (1 - within), ratio * (1 + within))
    row = {"what": what, "against": against, "ratio": ratio, "low": low, "high": high, "pairs": 9}
    return {"date": f"2026-11-{day:02}", "machine": {"processor": processor}, "rows": [row]}


def named(now, *earlier):
    from history import regressions

    return regressions(now, earlier)


def test_a_ratio_a_fifth_lower_is_named_with_both_figures_and_the_day():
    (line,) = named(record(4.0), record(5.0, day=7))
    assert line == "scan, PDA, against plain NumPy: 4 (3.84 to 4.16), 5 (4.8 to 5.2) on 2026-11-07"


@pytest.mark.parametrize("now", [record(6.0), record(5.0), record(4.6), record(4.55)])
def test_what_is_faster_or_within_a_tenth_is_not_named(now):
    assert named(now, record(5.0)) == []


@pytest.mark.parametrize(("within", "was_within"), [(0.3, INTERVAL), (INTERVAL, 0.3), (0.09, 0.09)])
def test_a_lower_ratio_whose_interval_comes_near_the_earlier_one_is_not_named(within, was_within):
    assert named(record(4.0, within), record(5.0, was_within)) == []
    assert named(record(4.0), record(5.0))


@pytest.mark.parametrize(
    "other",
    [{"what": "scan, MHT"}, {"against": "Stone Soup"}, {"processor": "a chip, 4 cores"}, {"within": None}],
)
def test_only_what_is_comparable_is_compared(other):
    assert named(record(1.0), record(5.0, **other)) == []
    assert named(record(1.0, **other), record(5.0)) == []


def test_the_last_comparable_record_counts_and_not_those_before_or_of_another_machine():
    other = record(9.0, processor="another", day=3)
    assert named(record(4.0), record(9.0, day=1), record(4.1, day=2), other) == []
    assert "on 2026-11-01" in named(record(4.0), record(9.0, day=1), other)[0]


def test_repeats_of_the_same_speed_are_hardly_ever_named_and_a_slower_one_is():
    from timing import interval

    rng = np.random.default_rng(1)

    def run(ratio):
        ratios = ratio * np.exp(rng.normal(0, 0.1, 20))
        low, high = interval(ratios)
        now = record(float(np.median(ratios)))
        now["rows"][0] |= {"low": low, "high": high}
        return now

    assert sum(len(named(run(5.0), run(5.0))) for _ in range(200)) <= 2
    assert sum(len(named(run(3.0), run(5.0))) for _ in range(200)) >= 195


def test_a_file_of_records_is_added_to_and_read_back(tmp_path):
    from history import append, read

    file = tmp_path / "history.jsonl"
    assert read(file) == []
    for day in (1, 2):
        append(file, record(5.0, day=day))
    assert [one["date"] for one in read(file)] == ["2026-11-01", "2026-11-02"]
    assert len(file.read_text().splitlines()) == 2


def test_a_run_is_recorded_with_its_version_machine_load_and_rows():
    from history import record as recorded
    from timing import Row

    row = Row("scan, PDA", "plain NumPy", 1e-5, 5e-5, 5.0, 4.9, 5.1, 9)
    one = recorded([row], "0.2.0", {"processor": "a chip"}, (0.1, 1.2))
    assert (one["version"], one["load"]) == ("0.2.0", {"before": 0.1, "after": 1.2})
    assert one["rows"][0]["high"] == 5.1 and "commit" in one and one["date"].startswith("20")
