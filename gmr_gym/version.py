"""The version, which also marks stored runs: results of another version are not mixed in."""

__version__ = "0.2.0"
