"""Two answers of environments compared."""

import numpy as np


def assert_same(a, b):
    """Arrays, None, or dicts and arrays of them, with the same keys, types and bits."""
    if isinstance(a, dict):
        assert a.keys() == b.keys()
        for key in a:
            assert_same(a[key], b[key])
    elif a is None or b is None:
        assert a is b
    elif np.asarray(a).dtype.hasobject:
        for one, other in zip(a, b, strict=True):
            assert_same(one, other)
    else:
        assert np.asarray(a).dtype == np.asarray(b).dtype
        np.testing.assert_array_equal(a, b)
