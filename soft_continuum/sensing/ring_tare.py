# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
What pictures of the straight arm tell of the tags around it, and of the camera.

The tags of a straight arm are where they were meant to be, but for how they are stuck: like the
fixed ones, only nearer to the camera.  So all of them together tell the view and the focal length,
and then each one how it is stuck.  What is left along the view is not taken for a ring that sits
askew: turned with its disc it would be wrong in another direction.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from soft_continuum.sensing.lens import Lens
from soft_continuum.sensing.pose_fit import TagGroup
from soft_continuum.sensing.ring_layout import Corners, RingLayout, Tag
from soft_continuum.sensing.tag_camera import FOCAL_DEVIATION
from soft_continuum.sensing.tilt import SensorError

UNCALIBRATED = 0.01  # relative, standard: of a focal length that the straight arm corrects
MAX_MISFIT = 6.0  # of corners over what is expected of them, both squared: more is a bent arm


@dataclass(frozen=True)
class PlacedTags:
    """
    Tags as they are stuck, by number, and the camera that sees them.

    fixed: in base_link.  rings: of each disc, in its frame.  focal: focal length over the
    calibrated one, with the standard deviation focal_stddev.  ring_stddev: m, standard, of
    how rings sit beyond what their tags say.
    """

    fixed: Mapping[int, Tag]
    rings: tuple[Mapping[int, Tag], ...]
    focal: float
    focal_stddev: float
    ring_stddev: float

    @classmethod
    def of(cls, layout: RingLayout) -> Self:
        """Return the tags of a layout before anything was seen of them."""
        return cls(layout.fixed_tags, tuple(map(layout.ring, range(len(layout.heights)))), 1.0,
                   FOCAL_DEVIATION, layout.ring_stddev)

    @classmethod
    def seen_straight(cls, layout: RingLayout, lens: Lens, corners: Corners) -> Self:
        """
        Return them after they were seen on the straight arm.

        Raises SensorError for an arm that is not straight.
        """
        ring = np.diag(layout.ring_stddev * np.repeat([1.0, 1.0 / layout.radius], 3))
        before, heights = cls.of(layout), layout.straight_heights
        # How a ring sits counts as how its tags are stuck: then those that are seen tell it.
        rings = [{n: replace(tag, spread=np.sqrt(tag.spread**2 + ring**2))
                  for n, tag in tags.items()} for tags in before.rings]
        every = dict(before.fixed) | {
            n: _raised(tag, height) for tags, height in zip(rings, heights, strict=True)
            for n, tag in tags.items()}
        seen = [n for n in every if n in corners]
        group = TagGroup([every[n] for n in seen], [corners[n] for n in seen], lens,
                         focal_stddev=UNCALIBRATED)
        if len(seen) < len(heights) or not (fits := group.fits()):
            raise SensorError('no tags are seen of which the straight arm could tell anything')
        placed = dict(zip(seen, group.placed(fits[0]), strict=True))
        off, number = max((float(np.linalg.norm(placed[n].centre - every[n].centre)), n)
                          for n in seen)
        if fits[0].misfit > MAX_MISFIT * fits[0].freedom:
            raise SensorError(
                f'tag {number} is seen {off * 1e3:.1f} mm from where it is on the straight arm, '
                'others too; is the arm straight, does tags.fixed_poses fit?')
        return cls(
            {n: placed.get(n, tag) for n, tag in before.fixed.items()},
            tuple({n: _raised(placed[n], -height) if n in placed else tag
                   for n, tag in tags.items()}
                  for tags, height in zip(rings, heights, strict=True)),
            fits[0].focal, float(np.sqrt(fits[0].covariance[6, 6])), 0.0)


def _raised(tag: Tag, height: float) -> Tag:
    return replace(tag, centre=tag.centre + np.array([0.0, 0.0, height]))
