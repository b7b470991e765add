"""Reductions that are wrong, each in a way of its own, for the fuzzer to find."""

import os
import signal

import numpy as np

from gmr_gym.mixture import Mixture
from gmr_gym.reduction.runnalls import runnalls


def loses_weight(p, components):
    q, origin = runnalls(p, components)
    return q._replace(w=q.w * (1 - 1e-6)), origin


def gives_nan(p, components):
    q, origin = runnalls(p, components)
    return Mixture(q.w, np.where(len(p.w) == 3, np.nan, q.m), q.P), origin


def forgets_the_spread(p, components):
    q, origin = runnalls(p, components)
    return q._replace(P=p.P[[np.flatnonzero(origin == g)[0] for g in range(len(q.w))]]), origin


def hangs(p, components):
    while len(p.w) == 3:
        pass
    return runnalls(p, components)


def dies(p, components):
    if len(p.w) == 3:
        os.kill(os.getpid(), signal.SIGSEGV)
    return runnalls(p, components)
