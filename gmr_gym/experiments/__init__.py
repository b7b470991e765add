"""Named trackers in named worlds, run, judged and written: what the command line does.

Stands on everything but the command line. Open `tables.py` first; a paper is a file in `papers/`, and what it
claims is judged in `claims.py`.
"""
