"""Motion models over any interval: composition, and the closed forms of `motions`."""

import numpy as np
import pytest

from gmr_gym.models import motions
from gmr_gym.models.intervals import Mode, modes, stay_or_switch, switching_over, transition

ALL = [
    Mode("constant-velocity", 2.0), Mode("constant-acceleration", 0.5), Mode("singer", 3.0, 8.0),
    Mode("coordinated-turn", 1.5, 0.2), Mode("coordinated-turn", 1.5, -1e-4), Mode("coordinated-turn", 1.5),
]  # fmt: skip


def over(mode, dt, d=None):
    bank = modes([mode], np.ones((1, 1)))
    d = d or bank.states(2)
    return transition(bank, 0, dt, 2, d)


@pytest.mark.parametrize("mode", ALL)
@pytest.mark.parametrize(("s", "t"), [(0.3, 1.9), (5.0, 0.02), (40.0, 12.0)])
def test_two_intervals_give_what_the_whole_gives(mode, s, t):
    (F1, Q1), (F2, Q2), (F, Q) = over(mode, s), over(mode, t), over(mode, s + t)
    np.testing.assert_allclose(F2 @ F1, F, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(F2 @ Q1 @ F2.T + Q2, Q, rtol=1e-9, atol=1e-10 * abs(Q).max())
    assert np.linalg.eigvalsh(Q).min() > -1e-12 * abs(Q).max()


@pytest.mark.parametrize("mode", ALL)
def test_back_and_forth_is_nothing_and_noise_is_added_both_ways(mode):
    (F, Q), (B, R) = over(mode, 1.7), over(mode, -1.7)
    np.testing.assert_allclose(B @ F, np.eye(len(F)), atol=1e-12)
    np.testing.assert_array_equal(Q, R)
    still, none = over(mode, 0.0)
    assert (still == np.eye(len(F))).all() and not none.any()


@pytest.mark.parametrize("x", [1e-3, 0.4, 3.0, 30.0])
def test_singer_is_that_of_motions(x):
    F, Q = over(Mode("singer", 3.0, 5.0), 5.0 * x)
    expected = motions.singer(5.0 * x, 5.0, 3.0, axes=2)
    np.testing.assert_allclose(F, expected.F, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(Q, expected.Q, rtol=1e-9, atol=1e-12 * abs(expected.Q).max())


def test_a_turn_is_that_of_motions_and_without_a_rate_goes_straight():
    F, _ = over(ALL[3], 1.3)
    np.testing.assert_allclose(F, motions.coordinated_turn(1.3, 0.2, 1.0).F, rtol=1e-13, atol=1e-15)
    for got, expected in zip(over(Mode("coordinated-turn", 2.0), 1.3), over(ALL[0], 1.3), strict=True):
        np.testing.assert_allclose(got, expected, rtol=1e-12, atol=1e-14)


def test_the_noise_of_a_second_is_the_deviation_of_velocity():
    _, Q = over(ALL[0], 1.0)
    np.testing.assert_allclose(np.diag(Q), [4 / 3, 4 / 3, 4.0, 4.0])


def test_a_model_without_accelerations_forgets_them():
    F, Q = over(ALL[0], 1.0, d=6)
    assert not F[4:].any() and not F[:, 4:].any()
    assert (np.diag(Q)[4:] == 1e-6).all()


def test_switching_over_two_intervals_is_their_product_and_over_a_second_as_given():
    switching = np.array([[0.9, 0.2, 0.05], [0.06, 0.7, 0.15], [0.04, 0.1, 0.8]])
    bank = modes(ALL[:3], switching)
    np.testing.assert_allclose(switching_over(bank, 1.0), switching, atol=1e-12)
    a, b, both = (switching_over(bank, t) for t in (0.4, 2.2, 2.6))
    np.testing.assert_allclose(b @ a, both, atol=1e-12)
    np.testing.assert_allclose(both.sum(axis=0), 1.0)
    assert stay_or_switch(3, 0.8).tolist()[0] == pytest.approx([0.8, 0.1, 0.1])


@pytest.mark.parametrize(("of", "switching", "message"), [
    ([Mode("straight", 1.0)], [[1.0]], "motion must be one of constant-velocity, .* got 'straight'"),
    ([Mode("singer", 1.0)], [[1.0]], "correlation time of singer must be positive, got 0.0 s"),
    ([Mode("constant-velocity", -1.0)], [[1.0]], "deviation of constant-velocity must be positive, got -1.0"),
    (ALL[:2], [[0.9, 0.2], [0.2, 0.8]], r"must have shape \(2, 2\) and columns of probabilities"),
    (ALL[:2], [[0.3, 0.7], [0.7, 0.3]], "no process in continuous time; raise its diagonal"),
])  # fmt: skip
def test_what_is_wrong_with_modes_is_named(of, switching, message):
    with pytest.raises(ValueError, match=message):
        modes(of, switching)
