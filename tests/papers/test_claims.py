"""The one loop that judges claims: whose evidence it takes, over which runs, and how wide it takes chance."""

import numpy as np
import pytest

from gmr_gym.evaluation.summary import wilson
from gmr_gym.experiments.claims import (
    Asked,
    Claim,
    claim_records,
    greatest,
    in_first,
    in_last,
    least,
    number,
)
from gmr_gym.experiments.evidence import Evidence

RUNS = 30
KEPT = np.arange(RUNS) < 24


def about(value, kept=KEPT):
    return Evidence(error=np.broadcast_to(np.asarray(value, float), RUNS), kept=kept)


def gain(weight, one, other):
    return float(weight @ (other.error - one.error) / weight.sum())


TABLES = {
    "a": {"x": about(1.0), "y": about(np.arange(RUNS))},
    "b": {"x": about(5.0), "y": about(7.0, ~KEPT | (np.arange(RUNS) < 12))},
}


def values(*asked):
    return [(r["table"], r["runs"], r["value"]) for r in claim_records(asked, TABLES)]


def test_a_claim_is_of_a_tracker_of_the_first_table_against_one_of_the_last():
    claim = Claim("less", "m", 0.0, gain, "x", "y")
    assert values(Asked((claim,), ("a",))) == [("a", "all 30", pytest.approx(14.5 - 1))]
    assert values(Asked((claim,), ("a", "b"))) == [("a against b", "all 30", pytest.approx(7 - 1))]
    assert values(Asked((claim,), ("b", "a"), table="b")) == [("b", "all 30", pytest.approx(14.5 - 5))]


def test_over_the_runs_kept_are_those_that_every_tracker_of_the_tables_kept():
    claim = Claim("less", "m", 0.0, gain, "x", "y")
    asked = Asked((claim,), ("a",), "kept {}", kept=True), Asked((claim,), ("a", "b"), "kept {}", kept=True)
    assert values(*asked) == [
        ("a", "kept 24", pytest.approx(11.5 - 1)),
        ("a against b", "kept 12", pytest.approx(7 - 1)),
    ]


def test_nothing_is_said_of_tables_or_trackers_that_are_not_at_hand():
    there, absent = (Claim("less", "m", 0.0, gain, "x", who) for who in ("y", "z"))
    assert values(Asked((there, absent), ("a",))) == values(Asked((there,), ("a",)))
    assert values(Asked((absent,), ("a",)), Asked((there,), ("a", "c"))) == []


@pytest.mark.parametrize("widened", [True, False])
def test_a_number_that_no_resample_changes_is_as_uncertain_as_no_event_where_it_is_a_share(widened):
    (record,) = claim_records(
        [Asked((Claim("less", "m", 0.0, gain, "x", "x", widened),), ("a", "b"))], TABLES
    )
    assert record["high"] - record["value"] == pytest.approx(wilson(0, RUNS).high if widened else 0)


def test_run_by_run_a_claim_is_of_the_mean_of_the_runs_that_have_a_number():
    claim = Claim("less", "m", 0.0, lambda one, other: (other.error - one.error)[:25], "x", "y")
    none = claim._replace(value=lambda one, other: one.error[:0])
    records = claim_records([Asked((claim, none), ("a",), "x", run_by_run=True)], TABLES)
    assert [(r["runs"], r["value"], r["verdict"]) for r in records] == [
        ("x", pytest.approx(12 - 1), "holds"), ("x", None, "unknown")
    ]  # fmt: skip


def test_without_trackers_a_claim_is_of_whole_tables_and_with_a_preparation_of_what_that_makes():
    whole = Claim("less", "m", 0.0, lambda weight, a, b: b["x"].error[0] - a["x"].error[0])
    seen = Claim("less", "m", 0.0, lambda least, most: most - least)
    asked = Asked((seen,), ("a", "b"), prepare=lambda weight, a, b: (float(len(a)), weight.sum()))
    assert values(Asked((whole,), ("a", "b")), asked) == [
        ("a against b", "all 30", 4.0), ("a against b", "all 30", 28.0)
    ]  # fmt: skip


@number
def error_of(who, weight, table):
    return float(weight @ table[who].error / weight.sum())


def test_numbers_of_the_same_evidence_and_constants_make_numbers():
    one, other = error_of("x"), error_of("y")  # 5 and 7 in table b
    for made, wanted in (
        (one - other, -2), (other - one, 2), (one + other, 12), (9 - one, 4), (9 + one, 14), (one + 9, 14),
        (0.5 * one, 2.5), (-one, -5), (abs(one - other), 2), (3 - abs(one - 2 * other), -6),
        (least(other, one), 5), (greatest(one, other, one), 7),
    ):  # fmt: skip
        assert made(np.ones(RUNS), TABLES["b"]) == pytest.approx(wanted)
    assert one.args == ("x",) and error_of.__name__ == "error_of"


def test_a_number_is_held_in_one_table_against_another():
    change = in_last(error_of("x")) - 2 * in_first(error_of("x"))
    assert change(np.ones(RUNS), TABLES["a"], TABLES["b"]) == pytest.approx(5 - 2 * 1)
    bare = number(lambda who, table: table[who].error[0])("y")
    assert in_first(bare)(TABLES["b"], TABLES["a"]) == 7 and in_last(bare)(TABLES["b"], TABLES["a"]) == 0
