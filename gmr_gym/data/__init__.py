"""Recorded flights, a reconstructed one, tables of instances and trained policies, as plain files.

`loader.py` reads the flights; `flights/LICENCE.md` states their source, licence and processing.
"""

from gmr_gym.data.loader import f16_flight, flight, flight_names

__all__ = ["f16_flight", "flight", "flight_names"]
