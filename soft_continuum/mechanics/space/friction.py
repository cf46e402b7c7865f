# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Friction of the tendons of a spatial arm at their guides, by the Capstan formula.

As for planar arms, a tendon loses exp(-mu beta) at every guide where it turns by beta, from the
top of the base disc on, below which it runs along the axis.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.space.chain import SpaceChain

Indices = NDArray[np.intp]
AT_ONE_PLACE = 1e-9  # m: between guides this close a tendon has no direction
STRAIGHT = 1e-9  # rad: a turn this small has no slope, as in the straight arm


class Friction:
    """Friction of the tendons of one chain at guides that turn them."""

    def __init__(self, chain: SpaceChain) -> None:
        """Find which runs of each tendon are spans, and their lengths in the straight arm, m."""
        self._chain = chain
        self._straight: list[tuple[list[bool], Array]] = []
        for tendon, guides, runs in zip(chain.arm.tendons, chain.guides, _runs(
                chain, np.tile(np.eye(3), (chain.bodies, 1, 1))), strict=True):
            is_span = [False, *(ends for _, _, ends in guides[1:]), False]
            lengths = np.linalg.norm(runs, axis=1)
            lengths[np.logical_not(is_span)] = [
                disc.height for disc in chain.arm.discs[:tendon.end + 1]]
            self._straight.append((is_span, lengths))

    def carried(self, rotations: Array, sliding: Sequence[int]) -> tuple[Array, Array]:
        """
        Return the tension of each span over that at the base (spans,), and compliances (tendons,).

        rotations: (bodies, 3, 3).  sliding: of each tendon, 1 towards the base, -1 towards the
        tip, 0 without friction.  A compliance is m/N by the tension at the base.
        """
        ratios: list[float] = []
        compliances = np.zeros(len(sliding))
        for t, (tendon, runs, (is_span, lengths)) in enumerate(zip(
                self._chain.arm.tendons, _runs(self._chain, rotations), self._straight,
                strict=True)):
            kept, angles, *_ = _turns(runs)
            left = np.exp(-tendon.friction * sliding[t] * _passed(angles, kept, len(runs)))
            ratios += left[is_span].tolist()
            compliances[t] = (tendon.free_length + left @ lengths) / tendon.axial_stiffness
        return np.array(ratios), compliances

    def rates(self, rotations: Array, sliding: Sequence[int]) -> tuple[Array, Array]:
        """
        Return the derivatives of these by turns of the bodies in base_link, per rad.

        (spans, bodies, 3), and (tendons, bodies, 3) in m/N; arguments as for ``carried``.
        """
        chain, each = self._chain, []
        compliances = np.zeros((len(sliding), chain.bodies, 3))
        for t, (tendon, runs, (is_span, lengths)) in enumerate(zip(
                chain.arm.tendons, _runs(chain, rotations), self._straight, strict=True)):
            kept, angles, before, after = _turns(runs)
            levers = _levers(chain, t, rotations)[kept]
            slopes = _passed(np.cross(levers[:-1], before[:, None])
                             + np.cross(levers[1:], after[:, None]), kept, len(runs))
            lost = -tendon.friction * sliding[t]
            slopes *= (lost * np.exp(lost * _passed(angles, kept, len(runs))))[:, None, None]
            each.append(slopes[is_span])
            compliances[t] = np.tensordot(lengths, slopes, 1) / tendon.axial_stiffness
        return np.concatenate(each), compliances


def _runs(chain: SpaceChain, rotations: Array) -> list[Array]:
    """Return the straight runs (k, 3) of tendons: the base's axis, between guides, the end's."""
    ends = [rotations[chain.last_body[t.end - 1], :, 2] for t in chain.arm.tendons]
    return [np.concatenate([[(0.0, 0.0, 1.0)], np.diff(points, axis=0), [end]])
            for points, end in zip(chain.tendon_points(rotations), ends, strict=True)]


def _levers(chain: SpaceChain, tendon: int, rotations: Array) -> Array:
    """Return the part of each run that turns with each body, (runs, bodies, 3)."""
    along = chain.body_lengths[:, None] * rotations[:, :, 2]
    guides = chain.guides[tendon]
    places = np.zeros((len(guides), chain.bodies, 3))
    for place, (body, offset, _) in zip(places, guides, strict=True):
        if body >= 0:
            place[:body], place[body] = along[:body], rotations[body] @ offset
    levers = np.zeros((len(guides) + 1, chain.bodies, 3))
    levers[1:-1] = np.diff(places, axis=0)
    end = chain.last_body[chain.arm.tendons[tendon].end - 1]
    levers[-1, end] = rotations[end, :, 2]
    return levers


def _turns(runs: Array) -> tuple[Indices, Array, Array, Array]:
    """
    Return how a tendon turns from run to run (k, 3), where these have a direction.

    The indices of such runs (n,), the angles between them (n - 1,), rad, and the derivatives of
    each by the run before it and by the one after it, (n - 1, 3), rad/m.
    """
    sizes = np.linalg.norm(runs, axis=1)
    kept = np.flatnonzero(sizes > AT_ONE_PLACE)
    sizes, ways = sizes[kept, None], runs[kept] / sizes[kept, None]
    cosine = (ways[:-1] * ways[1:]).sum(axis=1, keepdims=True)
    sine = np.linalg.norm(np.cross(ways[:-1], ways[1:]), axis=1, keepdims=True)
    size = np.where(sine < STRAIGHT, np.inf, sine)
    return (kept, np.arctan2(sine, cosine)[:, 0],
            (cosine * ways[:-1] - ways[1:]) / (size * sizes[:-1]),
            (cosine * ways[1:] - ways[:-1]) / (size * sizes[1:]))


def _passed(turns: Array, kept: Indices, runs: int) -> Array:
    """Return the sums of what turns (n - 1, ...) add before each of so many runs, (runs, ...)."""
    found = np.zeros((runs, *turns.shape[1:]))
    found[kept[1:]] = turns
    return np.cumsum(found, axis=0)
