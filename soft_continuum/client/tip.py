# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A goal of the tip in the client and on the command line."""

from dataclasses import dataclass
from math import cos, hypot, isfinite, sin

from soft_continuum.planning import TipKind


@dataclass(frozen=True)
class Tip:
    """
    A goal of the tip in base_link.

    position: x, z in the plane of a planar arm, or x, y, z, m.  At most one of these sets its
    orientation: angle, rad about +y from +z; direction, a vector x, y, z of any length;
    orientation, a full quaternion x, y, z, w.  tolerance: m.  angle_tolerance: rad.  0: those of
    the shape_sequencer.  Raises ValueError.
    """

    position: tuple[float, ...]
    angle: float | None = None
    direction: tuple[float, ...] | None = None
    orientation: tuple[float, ...] | None = None
    tolerance: float = 0.0
    angle_tolerance: float = 0.0

    def __post_init__(self) -> None:
        """Refuse an invalid position; the planner checks the rest."""
        _check('position', self.position, (2, 3))
        given = [name for name in ('angle', 'direction', 'orientation')
                 if getattr(self, name) is not None]
        if len(given) > 1:
            raise ValueError(f'{" and ".join(given)} given; give one of them')
        for name, count in (('direction', 3), ('orientation', 4)):
            values = getattr(self, name)
            if values is not None:
                _check(name, values, (count,))
                if not any(values):
                    raise ValueError(f'{name} is {values}; one of the numbers must not be 0')
        if self.angle is not None and not isfinite(self.angle):
            raise ValueError(f'angle is {self.angle}; needed: a finite number')

    @property
    def place(self) -> tuple[float, float, float]:
        """Its position x, y, z, m."""
        x, *y, z = map(float, self.position)
        return x, y[0] if y else 0.0, z

    @property
    def kind(self) -> TipKind:
        """Its constrained parts, one of TIP_KINDS."""
        if self.orientation is not None:
            return 'pose'
        return 'position' if self.angle is None and self.direction is None else 'direction'

    @property
    def quaternion(self) -> tuple[float, float, float, float]:
        """An orientation x, y, z, w that fulfils the constrained parts."""
        if self.orientation is not None:
            x, y, z, w = map(float, self.orientation)
            return x, y, z, w
        direction = self.direction or (0.0, 0.0, 1.0)
        if self.angle is not None:
            direction = sin(self.angle), 0.0, cos(self.angle)
        length = hypot(*direction)
        x, y, z = (value / length for value in direction)
        length = hypot(x, y, 1.0 + z)  # the shortest rotation from +z
        return (-y / length, x / length, 0.0, (1.0 + z) / length) if length > 1e-9 else (
            0.0, 1.0, 0.0, 0.0)


def _check(name: str, values: object, counts: tuple[int, ...]) -> None:
    try:
        numbers = tuple(map(float, values))  # type: ignore[call-overload]
    except (TypeError, ValueError):
        numbers = ()
    if len(numbers) not in counts or not all(map(isfinite, numbers)):
        raise ValueError(f'{name} is {values!r}; needed: '
                         f'{" or ".join(map(str, counts))} finite numbers')
