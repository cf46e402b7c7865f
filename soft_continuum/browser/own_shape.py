# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Sliders for a shape that is in no library: how far each segment bends and, in space, towards."""

from collections.abc import Callable
from math import degrees, floor, radians
from typing import Any, TYPE_CHECKING

import viser

from soft_continuum.browser.controls import number_of
from soft_continuum.browser.html import own_shape_html
from soft_continuum.browser.points import Points, points_of
from soft_continuum.browser.session import Description
from soft_continuum.mechanics.chain import Chain

if TYPE_CHECKING:
    from soft_continuum.client.sequence import Bending

ROUNDING = 1e-3  # degrees: limits are written with so many digits


class OwnShape:
    """The shape that is chosen on the page."""

    def __init__(self, gui: viser.GuiApi, description: Description,
                 changed: Callable[[], None]) -> None:
        """Add the sliders, all at 0; changed: called when somebody has moved one."""
        async def moved(event: Any) -> None:
            if event.client is not None:
                changed()

        self.chain = Chain(description.arm)
        self._limits = description.arm.bending_angle_limits.tolist()
        self._angles, self._directions = [], []
        for number, (limit, directed) in enumerate(zip(
                self._limits, description.directed, strict=True), start=1):
            most = max(1, floor(degrees(limit) + ROUNDING))
            self._angles.append(gui.add_slider(
                f'Angle {number}', 0 if directed else -most, most, 1, 0))
            if directed:
                self._directions.append(gui.add_slider(f'Direction {number}', -180, 180, 1, 0))
        for slider in (*self._angles, *self._directions):
            slider.on_update(moved)
        gui.add_html(own_shape_html(description))

    @property
    def shape(self) -> 'tuple[Bending, ...]':
        """What each segment bends by: its angle or, in space, angle and direction, rad."""
        angles, directions = self._values()
        return tuple(zip(angles, directions, strict=True)) if directions else angles

    @property
    def points(self) -> Points:
        """Points along the backbone of that shape, x, y, z, m."""
        return points_of(self.chain, *self._values())

    def _values(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        angles, directions = (
            tuple(radians(number_of(slider.value, -360.0, 360.0)) for slider in sliders)
            for sliders in (self._angles, self._directions))
        return (tuple(max(-limit, min(limit, angle))
                      for angle, limit in zip(angles, self._limits, strict=True)), directions)

