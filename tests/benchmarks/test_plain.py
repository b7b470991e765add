"""The plain forms that speeds are measured against do the same work."""

import numpy as np
import pytest

from gmr_gym.reduction.consistent_merging import consistent
from gmr_gym.reduction.distances import integral_squared_difference
from gmr_gym.reduction.ise import integral_squared_error
from gmr_gym.reduction.refinement import refine
from gmr_gym.reduction.runnalls import runnalls
from gmr_gym.reduction.transportation import transportation


@pytest.mark.parametrize(
    ("n", "d", "components", "concentration"), [(8, 2, 2, 1.0), (20, 4, 4, 0.2), (15, 3, 5, 100.0)]
)
def test_the_compiled_form_of_williams_reduction_takes_its_steps(n, d, components, concentration):
    import plain
    from problems import drawn, partition

    p = drawn(n, d, 1, concentration)[0]
    steps = partition(plain.williams_compiled(p, components))
    assert steps == partition(integral_squared_error(p, components)[1])
    assert steps == partition(plain.williams_in_numpy(p, components))


def test_a_plain_reduction_that_deletes_keeps_the_weight_and_the_mixture():
    import modes
    from problems import drawn

    p = drawn(20, 4, 1, 0.2)[0]
    ours, origin = integral_squared_error(p, 4)
    theirs, their_origin = modes.williams_plainly(p, 4)
    assert (origin < 0).any()
    np.testing.assert_array_equal(origin, their_origin)
    for one, other in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-14)


def test_plain_merging_by_the_reverse_divergence_and_plain_transportation_form_the_same_groups():
    import plain_reductions
    from problems import drawn, partition

    further = 0
    for p in drawn(30, 4, 3):
        merged = partition(consistent(p, 6, "reverse-kl")[1])
        assert merged == partition(plain_reductions.reverse_kl_compiled(p, 6))
        assert merged == partition(plain_reductions.reverse_kl_in_numpy(p, 6))
        moved = partition(transportation(p, 6)[1])
        assert moved == partition(plain_reductions.transportation_in_numpy(p, 6))
        further += moved != partition(runnalls(p, 6)[1])
    assert further


def test_a_plain_refinement_ends_at_the_error_of_ours():
    import plain_reductions
    from problems import drawn

    p = drawn(6, 1, 1)[0]
    results = refine(p, 3)[0], plain_reductions.refine_in_scipy(p, 3)
    ours, theirs = (integral_squared_difference(p, q) for q in results)
    assert theirs == pytest.approx(ours, rel=0.01)
    assert ours < 0.9 * integral_squared_difference(p, runnalls(p, 3)[0])
