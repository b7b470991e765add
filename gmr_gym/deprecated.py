"""Old names that still work for one version."""

import warnings


def warn_renamed(old: str, new: str) -> None:
    """Warns that the name `old` is deprecated; the warning points at the caller of the caller."""
    warnings.warn(
        f"{old} is now {new}; the old name works until the next version", DeprecationWarning, stacklevel=3
    )
