"""A film of `gmr_gym/ReductionTuning-v0`: alpha swings over its range, and the hypotheses kept with it.

`python docs/tuning_film.py FILE.gif`
"""

import argparse

import gymnasium as gym
import numpy as np

import gmr_gym  # noqa: F401  registers the environments
from gmr_gym.replay.film import write

SCANS, SWING = 25, 26  # scans of the film, and of one swing


def pictures():
    """The picture of every scan."""
    env = gym.make("gmr_gym/ReductionTuning-v0", instances="valid", render_mode="rgb_array")
    env.reset(seed=1, options={"instance_id": "valid-03"})
    for t in range(SCANS):
        env.step(np.array([-np.cos(2 * np.pi * t / SWING), 0.0], np.float32))
        yield env.render()
    env.close()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", help="what is written, .gif or .mp4")
    write(parser.parse_args().out, pictures(), SCANS)
