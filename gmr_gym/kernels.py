"""How kernels are compiled, where it is not as all of them are."""

import numpy as np
from numba import njit

# For kernels to be called with: for an integer written down there, numba compiles the kernel once more. A
# kernel compiled by itself goes through LLVM again, with all that it calls, in every kernel that calls it, so
# those that stand between others are inlined, where it has been measured to pay.
ZERO, ONE = np.int64(0), np.int64(1)

# Compiles what makes no array and hands none back, without counting references to those it is given: each is
# an atomic operation, and half of the time of a scan went into them. It may call none but its like, which
# would otherwise be compiled as it is.
uncounted = njit(cache=True, error_model="numpy", nogil=True, _nrt=False)  # type: ignore[call-overload]
