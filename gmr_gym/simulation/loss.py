"""Rules by which a scan counts as off target."""

import numpy as np

from gmr_gym.models.gating import Gates, outside_all_gates


def truth_outside_gates(H: np.ndarray, gates: Gates, x: np.ndarray, z: np.ndarray) -> bool:
    """Whether the noise-free detection H x of the true state x (d,) lies in no gate
    (D'Ortenzio, section 4: "not contained in any of the hypotheses gates")."""
    return outside_all_gates(gates, H @ x)


def detection_outside_gates(gates: Gates, x: np.ndarray, z: np.ndarray) -> bool:
    """Whether the target's own detection z (p,) lies in no gate; so too where there was none, z then being
    nan (Maybeck, section V: "without the target-originated measurement falling within an association
    gate for any of the mixture hypotheses")."""
    return outside_all_gates(gates, z)
