"""The plain forms that speeds are measured against do the same work."""

import numpy as np
import pytest

from gmr_gym.reduction.ise import integral_squared_error


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
