# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
How many rigid bodies a segment needs (paper, III-B).

As in the paper: every segment is bent in turn by a tendon that is pulled by the same length for
all n, and the relative change of its bending angle from n to n + 1 bodies is looked at.  The error
against the continuum is ours.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from soft_continuum.analysis.results import progress
from soft_continuum.mechanics import LEFT, RIGHT, SLACK, Statics
from soft_continuum.mechanics.arm import Arm, SECOND_ORDER
from soft_continuum.mechanics.chain import Array

CONTINUUM_BODIES = 100  # of the second-order chain, which is then within 1e-5 of the rod


@dataclass(frozen=True, eq=False)
class Convergence:
    """
    Bending angles over the number of bodies.

    bodies: (m,).  angles: (m, segments) rad.  change: (m, segments), relative, from n to n + 1;
    nan in the last row.  error: (m, segments), relative to the continuum.  converged: the first n
    from which on every change is below the tolerance; None if there is none.
    """

    bodies: NDArray[np.int64]
    angles: Array
    change: Array
    error: Array
    converged: int | None


def converge(arm: Arm, bending_angles: Sequence[float], tolerance: float, most: int
             ) -> Convergence:
    """
    Return the convergence analysis for 2 to ``most`` bodies per segment.

    bending_angles: (segments,) rad, not zero, which the arm has with the bodies it is described
    with.  tolerance: of the relative change.  Raises StaticsError when no tendon holds the arm.
    """
    model = Statics(arm)
    state, lengths = model.chain.straight(), []
    for segment, angle in enumerate(bending_angles):
        bent = model.bend(state, segment, angle)
        tendon = RIGHT if bent.tensions[RIGHT] >= bent.tensions[LEFT] else LEFT
        lengths.append((tendon, float(bent.pulls[tendon] - state.pulls[tendon])))
        state = bent
    bodies = np.arange(2, most + 1)
    angles = np.array([_angles(arm.with_bodies(n), lengths)
                       for n in progress(bodies.tolist(), 'bodies per segment')])
    rod = _angles(replace(arm, discretisation=SECOND_ORDER, bodies_per_segment=CONTINUUM_BODIES),
                  lengths)
    change = np.full_like(angles, np.nan)
    change[:-1] = np.abs(np.diff(angles, axis=0) / angles[:-1])
    below = np.all(change[:-1] < tolerance, axis=1)
    above = np.flatnonzero(~below)
    first = 0 if not above.size else int(above[-1]) + 1
    return Convergence(bodies, angles, change, np.abs(angles / rod - 1.0),
                       int(bodies[first]) if first < below.size else None)


def _angles(arm: Arm, lengths: Sequence[tuple[int, float]]) -> Array:
    """Return the bending angles after the tendons were pulled by lengths, step by step."""
    statics = Statics(arm)
    state = statics.chain.straight()
    for segment, (tendon, length) in enumerate(lengths):
        pulls = [SLACK, SLACK]
        pulls[tendon] = float(state.pulls[tendon]) + length
        state = statics.solve(state, pulls, [i == segment for i in range(statics.chain.segments)])
    return state.bending_angles
