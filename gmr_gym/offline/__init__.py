"""Episodes for learning offline: played by trackers or policies, and kept as data sets of Minari.

Stands on `envs`; needs the extra `minari`. Open `dataset.py` first, then `players.py`.
"""

from gmr_gym.offline.dataset import load, write
from gmr_gym.offline.players import Player, players_of

__all__ = ["Player", "load", "players_of", "write"]
