# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Offsets of the tags, and the focal length, from images of the straight arm.

On a straight arm the tags are at their nominal positions apart from their offsets, like the fixed
ones but nearer to the camera.  So together they determine the view and the focal length, and then
each one its offset.  The remaining error along the view is not attributed to a misaligned ring: it
would point in another direction when the disc turns.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from soft_continuum.estimation.sensing.layout import Corners, Layout, RingLayout, Tag
from soft_continuum.estimation.sensing.lens import Lens
from soft_continuum.estimation.sensing.pictures import Array
from soft_continuum.estimation.sensing.pose_fit import TagGroup
from soft_continuum.estimation.sensing.rigid import IDENTITY
from soft_continuum.estimation.sensing.tilt import SensorError

FOCAL_DEVIATION = 0.005  # relative, of a good calibration
UNCALIBRATED = 0.01  # relative, standard: of a focal length that the straight arm corrects
NONE = np.zeros(6)
MAX_MISFIT = 6.0  # of corners over what is expected of them, both squared: more is a bent arm


@dataclass(frozen=True)
class PlacedTags:
    """
    Tags with their offsets, by number, and the camera that sees them.

    fixed: in base_link.  rings: of each disc, in its frame.  offsets: by disc, pose (7,) of the
    disc in that frame.  ring_spread: standard deviations of rings beyond the offsets of their
    tags, (6,), m and rad.  focal: focal length over the calibrated one, with the standard
    deviation focal_stddev.
    """

    fixed: Mapping[int, Tag]
    rings: tuple[Mapping[int, Tag], ...]
    offsets: Sequence[Array]
    ring_spread: Array
    focal: float = 1.0
    focal_stddev: float = FOCAL_DEVIATION

    @classmethod
    def of(cls, layout: Layout, offsets: Sequence[Array] = (), ring_spread: Array = NONE) -> Self:
        """Return the nominal tags of a layout."""
        rings = tuple(map(layout.ring, range(len(layout.heights))))
        return cls(layout.fixed_tags, rings, offsets or [np.array(IDENTITY)] * len(rings),
                   ring_spread)

    @classmethod
    def seen_straight(cls, layout: RingLayout, lens: Lens, corners: Corners) -> Self:
        """
        Return the tags corrected by their corners on the straight arm.

        Raises SensorError for an arm that is not straight.
        """
        ring = np.diag(layout.ring_spread)
        before, heights = cls.of(layout), layout.straight_heights
        # The offset of a ring counts as offsets of its tags, so that visible tags determine it.
        rings = [{n: replace(tag, spread=np.sqrt(tag.spread**2 + ring**2))
                  for n, tag in tags.items()} for tags in before.rings]
        every = dict(before.fixed) | {
            n: _raised(tag, height) for tags, height in zip(rings, heights, strict=True)
            for n, tag in tags.items()}
        seen = [n for n in every if n in corners]
        group = TagGroup([every[n] for n in seen], [corners[n] for n in seen], lens,
                         focal_stddev=UNCALIBRATED)
        if len(seen) < len(heights) or not (fits := group.fits()):
            raise SensorError('no tags are seen that the straight arm can calibrate')
        placed = dict(zip(seen, group.placed(fits[0]), strict=True))
        off, number = max((float(np.linalg.norm(placed[n].centre - every[n].centre)), n)
                          for n in seen)
        if fits[0].misfit > MAX_MISFIT * fits[0].freedom:
            raise SensorError(
                f'tag {number} is seen {off * 1e3:.1f} mm from its position on the straight arm, '
                'others too; is the arm straight, does tags.fixed_poses fit?')
        return cls(
            {n: placed.get(n, tag) for n, tag in before.fixed.items()},
            tuple({n: _raised(placed[n], -height) if n in placed else tag
                   for n, tag in tags.items()}
                  for tags, height in zip(rings, heights, strict=True)),
            before.offsets, NONE, fits[0].focal, float(np.sqrt(fits[0].covariance[6, 6])))


def _raised(tag: Tag, height: float) -> Tag:
    return replace(tag, centre=tag.centre + np.array([0.0, 0.0, height]))
