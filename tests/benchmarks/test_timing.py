"""The ratio of two alternatives and its interval."""

import numpy as np
import pytest


@pytest.fixture(scope="module")
def timing():
    import timing

    return timing


def test_the_interval_encloses_the_median_nineteen_times_of_twenty(timing):
    rng = np.random.default_rng(0)
    for n in (6, 9, 30):
        drawn = (timing.interval(rng.exponential(size=n)) for _ in range(2000))
        share = np.mean([low <= np.log(2) <= high for low, high in drawn])
        assert 0.94 <= share <= 0.985, n  # order statistics come in steps


def test_too_few_have_no_interval(timing):
    assert timing.interval(np.arange(5)) == (None, None)
    assert timing.interval(np.arange(6)) == (0.0, 5.0)


def test_a_row_is_repeated_until_its_interval_is_narrow(timing, monkeypatch):
    monkeypatch.setattr(timing, "TURN", 0.0)
    rng = np.random.default_rng(0)
    theirs = lambda: 3.0 * float(np.exp(rng.normal(0, 0.1)))  # noqa: E731
    row = timing.compared(timing.Plan(60.0, True), "", lambda: 1.0, "", theirs)
    assert timing.FEWEST < row.pairs < 1000
    assert max(row.high / row.ratio, row.ratio / row.low) <= 1 + timing.WITHIN
    assert row.ratio == pytest.approx(3.0, rel=0.1)


def test_a_row_ends_with_its_seconds(timing):
    row = timing.compared(timing.Plan(0.0, True), "", lambda: 1.0, "", lambda: 2.0)
    assert (row.pairs, row.ratio, row.low) == (1, 2.0, None)


def test_what_is_prepared_is_made_anew_and_not_charged_for(timing):
    clock, made = iter(range(100)), []
    watch = timing.timed(
        lambda given: given.append(1), [([],)], clock=lambda: next(clock),
        prepare=lambda one: (made.append(list(one)) or made[-1],),
    )  # fmt: skip
    assert [watch(), watch()] == [1, 1]
    assert made == [[1], [1]]
