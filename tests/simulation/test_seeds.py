"""Keys of many seeds at once are those that NumPy's SeedSequence gives one by one."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from gmr_gym.simulation.seeds import keys_of
from gmr_gym.simulation.single_target import key_of

EDGES = [0, 1, 2**16, 2**31, 2**32 - 1, 2**32, 2**33 + 7, 2**62, 2**63 - 1]


@settings(deadline=None)  # the first one compiles
@given(st.lists(st.one_of(st.integers(0, 2**63 - 1), st.integers(0, 2**33)), min_size=1, max_size=20))
def test_a_key_is_the_state_that_numpys_seed_sequence_generates(seeds):
    seeds = EDGES + seeds
    keys = keys_of(np.array(seeds))
    assert keys.dtype == np.uint32
    np.testing.assert_array_equal(keys, [key_of(seed) for seed in seeds])
