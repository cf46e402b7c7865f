# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The collision body of an arm: cylinders for its discs, segments and tendons.

- A disc is a cylinder of its height. Its radius is the largest of half the outer diameters of the
  segments at it, and the offsets of their guides.
- A segment is swept by a circle of half its outer diameter along its backbone (with spacers: at
  least the offset of their guides): a cylinder for each rigid body, extended to cover the wedge
  that opens to its neighbour when the joint between them bends.
- A tendon runs straight from guide to guide, so it leaves a strongly bent segment between them.
  It is a cylinder of TENDON_RADIUS, in the segments that it can leave.

The base disc is omitted: it does not move, so no plan changes its distance.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.chain import Chain, Equilibrium

TENDON_RADIUS = 0.0005
"""m, of every tendon: descriptions lack it, and the ropes of such arms are thinner."""
UNEVEN = 2.0
"""Bending of a span between two guides, over that by the limit of its segment."""
MIN_HALF_LENGTH = 1e-5
"""m: of a disc without height."""
MAX_MITRE = 1.0
"""Largest part of the radius by which a cylinder is longer at a joint: up to 90 degrees."""


@dataclass(frozen=True)
class Cylinders:
    """
    Cylinders of a body.

    centres: (n, 3), m.  axes: (n, 3), unit vectors.  half_lengths, radii: (n,), m.
    """

    centres: Array
    axes: Array
    half_lengths: Array
    radii: Array


class Body:
    """The cylinders of one arm in any state."""

    def __init__(self, arm: Arm) -> None:
        """Take radii and lengths from a description."""
        chain = Chain(arm)
        self._last = np.arange(1, chain.segments + 1) * chain.joints_per_segment - 1
        self._first = self._last - chain.joints_per_segment + 1
        half = np.array([segment.outer_diameter / 2 for segment in arm.segments])
        widest = np.maximum(half, arm.guide_radii)
        tubes = widest if arm.spacers else half
        discs = np.maximum(widest, np.append(widest[1:], 0.0))
        self._base = float(widest[0]), arm.discs[0].height
        straight = chain.straight()
        lengths = np.linalg.norm(np.diff(straight.backbone, axis=0), axis=1)
        self._half = np.maximum(0.5 * lengths, MIN_HALF_LENGTH)
        self._radii = np.repeat(tubes, chain.joints_per_segment)
        self._radii[self._last] = discs
        self._spans = _spans_that_come_out(arm, tubes, straight.tendon_points)

    def base(self) -> Cylinders:
        """Return the base disc, which ``parts`` leaves out."""
        radius, height = self._base
        half = max(height / 2, MIN_HALF_LENGTH)
        return Cylinders(np.array([[0.0, 0.0, height / 2]]), np.array([[0.0, 0.0, 1.0]]),
                         np.array([half]), np.array([radius]))

    def parts(self, state: Equilibrium) -> Cylinders:
        """Return the collision body of a state of the arm."""
        ends, axes = state.backbone, state.rotations[:, :, 2]
        below, above = self._mitres(axes)
        centres = 0.5 * (ends[:-1] + ends[1:]) + 0.5 * (above - below)[:, None] * axes
        half = self._half + 0.5 * (above + below)
        if not self._spans:
            return Cylinders(centres, axes, half, self._radii)
        guides = state.tendon_points
        lower = np.array([guides[tendon][guide] for tendon, guide in self._spans])
        upper = np.array([guides[tendon][guide + 1] for tendon, guide in self._spans])
        lengths = np.linalg.norm(upper - lower, axis=1)
        return Cylinders(
            np.concatenate([centres, 0.5 * (lower + upper)]),
            np.concatenate([axes, (upper - lower) / lengths[:, None]]),
            np.concatenate([half, 0.5 * lengths]),
            np.concatenate([self._radii, np.full(len(lengths), TENDON_RADIUS)]))

    def _mitres(self, axes: Array) -> tuple[Array, Array]:
        """Return the extension of each cylinder at its lower and upper end, (n,), m."""
        cosines = np.einsum('ij,ij->i', axes[:-1], axes[1:])
        cosines = np.clip(np.concatenate([axes[:1, 2], cosines]), 1e-9, 1.0)
        shared = np.minimum(np.sqrt((1.0 - cosines) / (1.0 + cosines)), MAX_MITRE)  # half angle
        alone = np.minimum(np.sqrt(1.0 - cosines**2) / cosines, MAX_MITRE)  # discs stay as long
        below, above = shared.copy(), np.append(shared[1:], 0.0)
        below[self._first] = alone[self._first]
        above[self._last - 1] = alone[self._last]
        below[self._last] = above[self._last] = 0.0
        return below * self._radii, above * self._radii


def _spans_that_come_out(arm: Arm, radii: Array, guides: Sequence[Array]
                         ) -> list[tuple[int, int]]:
    """
    Return tendon and lower guide of the spans that can leave segments of radii (m).

    guides: as Equilibrium.tendon_points, which adds guides at both ends.
    """
    offsets, each = arm.guide_radii, arm.spacers + 1  # spans of a tendon in a segment
    found = []
    for s, segment in enumerate(arm.segments):
        length = segment.length / each
        bend = min(UNEVEN * segment.bending_angle_limit / each, np.pi)
        # At the middle of an arc of this length and angle, from it to the chord inside of it.
        farthest = length / bend - (length / bend - offsets[s]) * np.cos(bend / 2)
        if farthest + TENDON_RADIUS > radii[s]:
            found += [(tendon, (len(guides[tendon]) - end * (each + 1)) // 2 + s * (each + 1) + k)
                      for tendon, end in enumerate(arm.tendon_ends) if end > s
                      for k in range(each)]
    return found
