# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Friction of the tendons of a spatial arm at their guides, by the Capstan formula.

As in the plane: a tendon loses exp(-mu beta) at every guide where it turns by beta, from the top
of the base disc on, below which it runs along the axis.
"""

from collections.abc import Sequence

import numpy as np

from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.space.chain import SpaceChain

AT_ONE_PLACE = 1e-9  # m: between guides this close a tendon has no direction


def carried(chain: SpaceChain, rotations: Array, sliding: Sequence[int]
            ) -> tuple[Array, Array]:
    """
    Return the tension of every span over that at the base (spans,), and compliances (tendons,).

    rotations: (bodies, 3, 3).  sliding: of each tendon, 1 towards the base, -1 towards the tip, 0
    without friction.  A compliance is m/N by the tension at the base.
    """
    ratios: list[float] = []
    compliances = np.zeros(len(sliding))
    straight = np.tile(np.eye(3), (chain.bodies, 1, 1))
    upwards = np.concatenate([np.eye(3)[None], rotations])[:, :, 2]
    for t, (tendon, now, before) in enumerate(zip(
            chain.arm.tendons, chain.tendon_points(rotations), chain.tendon_points(straight),
            strict=True)):
        along_end = upwards[chain.last_body[tendon.end - 1] + 1]  # through the disc where it ends
        runs = np.concatenate([upwards[:1], np.diff(now, axis=0), [along_end]])
        is_span = np.array([False, *(ends for _, _, ends in chain.guides[t][1:]), False])
        lengths = np.zeros(len(runs))
        lengths[is_span] = np.linalg.norm(np.diff(before, axis=0), axis=1)[is_span[1:-1]]
        lengths[~is_span] = [disc.height for disc in chain.arm.discs[:tendon.end + 1]]
        left = np.exp(-tendon.friction * sliding[t] * _turned(runs))
        ratios += left[is_span].tolist()
        compliances[t] = (tendon.free_length + left @ lengths) / tendon.axial_stiffness
    return np.array(ratios), compliances


def _turned(runs: Array) -> Array:
    """Return by how much a tendon has turned before each of its straight runs (k, 3), rad."""
    turned, heading = np.zeros(len(runs)), runs[0]
    for k, run in enumerate(runs[1:], start=1):
        turned[k] = turned[k - 1]
        if np.linalg.norm(run) > AT_ONE_PLACE:
            turned[k] += np.arctan2(np.linalg.norm(np.cross(heading, run)), heading @ run)
            heading = run
    return turned
