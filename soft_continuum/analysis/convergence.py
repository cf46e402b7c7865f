# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
How many rigid bodies a segment needs (paper, III-B).

As in the paper: every segment is bent in turn by a tendon that is pulled by the same length for
all n, and the relative change of its bending angle from n to n + 1 bodies is evaluated.  The error
relative to the continuum is not from the paper.  For spatial arms several tendons are pulled, and
n are multiples of the number of spans between guides.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from soft_continuum.analysis.results import progress
from soft_continuum.mechanics import Arm, ArmError, Equilibrium, SECOND_ORDER, SLACK, Statics
from soft_continuum.mechanics.arm import Array

CONTINUUM_BODIES = 100  # of the second-order chain, which is then within 1e-5 of the rod
Step = tuple[tuple[bool, ...], Array]
"""Soft segments, and the pull of each tendon, m; nan: slack."""


@dataclass(frozen=True, eq=False)
class Convergence:
    """
    Bending angles over the number of bodies.

    bodies: (m,).  angles: (m, segments) rad.  change: (m, segments), relative, from n to the next
    n; nan in the last row.  error: (m, segments), relative to the continuum.  converged: the first
    n from which on every change is below the tolerance; None if there is none.
    """

    bodies: NDArray[np.int64]
    angles: Array
    change: Array
    error: Array
    converged: int | None


def converge(arm: Arm, bending_angles: Sequence[float], tolerance: float, most: int,
             jamming: bool = True) -> Convergence:
    """
    Return the convergence analysis for 2 to ``most`` bodies per segment.

    bending_angles: (segments,) rad, not zero, for the described number of bodies; for spatial arms
    towards x.  tolerance: of the relative change.  jamming: whether segments are bent in turn, or
    all at once.  Raises StaticsError when no tendon holds the arm, ArmError when there are no two
    numbers of bodies to compare.
    """
    every = arm.spacers + 1
    bodies = np.arange(max(2, every), most + 1, every)
    if len(bodies) < 2:
        raise ArmError(f'with {every - 1} spacers the bodies of a segment are multiples of '
                       f'{every}, so up to {most} bodies there is nothing to compare; needed: '
                       f'{2 * every} and more')
    steps = _steps(arm, bending_angles, jamming)
    angles = np.array([_angles(arm.with_bodies(n), steps)
                       for n in progress(bodies.tolist(), 'bodies per segment')])
    rod = _angles(replace(arm, discretisation=SECOND_ORDER,
                          bodies_per_segment=max(1, CONTINUUM_BODIES // every) * every), steps)
    change = np.full_like(angles, np.nan)
    change[:-1] = np.abs(np.diff(angles, axis=0) / angles[:-1])
    below = np.all(change[:-1] < tolerance, axis=1)
    above = np.flatnonzero(~below)
    first = 0 if not above.size else int(above[-1]) + 1
    return Convergence(bodies, angles, change, np.abs(angles / rod - 1.0),
                       int(bodies[first]) if first < below.size else None)


def _steps(arm: Arm, bending_angles: Sequence[float], jamming: bool) -> list[Step]:
    """Return the pulls that bend the segments, in turn or all at once."""
    statics: Statics = Statics(arm)
    segments = range(len(arm.segments))
    state: Equilibrium = statics.chain.straight()
    steps: list[Step] = []
    wanted = np.column_stack([np.zeros(len(segments)), bending_angles])
    for soft in ([tuple(i == s for i in segments) for s in segments] if jamming
                 else [(True,) * len(segments)]):
        held = statics.hold(state, wanted, soft)
        steps.append((soft, np.where(held.pulls == SLACK, np.nan, held.pulls - state.pulls)))
        state = held.state
    return steps


def _angles(arm: Arm, steps: Sequence[Step]) -> Array:
    """Return the bending angles after each step of pulls."""
    statics: Statics = Statics(arm)
    state: Equilibrium = statics.chain.straight()
    for soft, lengths in steps:
        state = statics.solve(
            state, np.where(np.isnan(lengths), SLACK, state.pulls + lengths), soft)
    return state.bending_angles
