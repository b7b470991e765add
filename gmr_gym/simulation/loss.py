"""Loss rules: when a scan counts as off target."""

import numpy as np

from gmr_gym.models.gating import Gates, outside_all_gates


def truth_outside_gates(H: np.ndarray, gates: Gates, x: np.ndarray, z: np.ndarray) -> bool:
    """Whether the true position lies outside every gate.

    Parameters
    ----------
    H : ndarray (p, d)
        Measurement matrix.
    gates : Gates
        The gates of the scan.
    x : ndarray (d,)
        True state. H x is its noise-free measurement.
    z : ndarray (p,)
        Target-originated measurement; not used.

    Returns
    -------
    bool

    References
    ----------
    D'Ortenzio, Manes and Orguner, section 4: "not contained in any of the hypotheses gates".
    """
    return outside_all_gates(gates, H @ x)


def detection_outside_gates(gates: Gates, x: np.ndarray, z: np.ndarray) -> bool:
    """Whether the target-originated measurement lies outside every gate.

    Parameters
    ----------
    gates : Gates
        The gates of the scan.
    x : ndarray (d,)
        True state; not used.
    z : ndarray (p,)
        Target-originated measurement, nan where the target was missed. A missed target counts as outside.

    Returns
    -------
    bool

    References
    ----------
    Maybeck, Kozak and Smith, section V: "without the target-originated measurement falling within an
    association gate for any of the mixture hypotheses".
    """
    return outside_all_gates(gates, z)
