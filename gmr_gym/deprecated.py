"""Old names that go on working for one version."""

import warnings


def warn_renamed(old: str, new: str) -> None:
    """Warns, at the caller's caller, that a name has changed and will go."""
    warnings.warn(
        f"{old} is now {new}; the old name works until the next version", DeprecationWarning, stacklevel=3
    )
