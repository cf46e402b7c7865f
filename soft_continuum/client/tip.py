# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A goal of the tip."""

from dataclasses import dataclass
from math import cos, hypot, isfinite, sin

from geometry_msgs.msg import Point, Pose, Quaternion

from soft_continuum_interfaces.msg import TipGoal


@dataclass(frozen=True)
class Tip:
    """
    Where the tip shall be, in base_link.

    position: x, z in the plane of a planar arm, or x, y, z, m.  At most one of these says where it
    points: angle, rad about +y from +z; direction, a vector x, y, z of any length; orientation,
    the whole one, as a quaternion x, y, z, w.  tolerance: m.  angle_tolerance: rad.  0: those of
    the shape_sequencer.  Raises ValueError.
    """

    position: tuple[float, ...]
    angle: float | None = None
    direction: tuple[float, float, float] | None = None
    orientation: tuple[float, float, float, float] | None = None
    tolerance: float = 0.0
    angle_tolerance: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what is no place; the shape_sequencer judges the rest."""
        _check('position', self.position, (2, 3))
        given = [name for name in ('angle', 'direction', 'orientation')
                 if getattr(self, name) is not None]
        if len(given) > 1:
            raise ValueError(f'{" and ".join(given)} given; give one of them')
        if self.direction is not None:
            _check('direction', self.direction, (3,))
            if not any(self.direction):
                raise ValueError('direction is (0, 0, 0), which points nowhere')
        if self.orientation is not None:
            _check('orientation', self.orientation, (4,))

    def message(self) -> TipGoal:
        """Return the goal as the shape_sequencer takes it."""
        kind, turn, direction = TipGoal.POSITION, (0.0, 0.0, 0.0, 1.0), self.direction
        if self.angle is not None:
            direction = sin(self.angle), 0.0, cos(self.angle)
        if direction is not None:
            kind, turn = TipGoal.DIRECTION, _turn_of_z_to(direction)
        if self.orientation is not None:
            kind, turn = TipGoal.POSE, self.orientation
        x, *y, z = map(float, self.position)
        qx, qy, qz, qw = map(float, turn)
        return TipGoal(
            kind=kind, pose=Pose(position=Point(x=x, y=y[0] if y else 0.0, z=z),
                                 orientation=Quaternion(x=qx, y=qy, z=qz, w=qw)),
            position_tolerance=float(self.tolerance), angle_tolerance=float(self.angle_tolerance))


def _check(name: str, values: object, counts: tuple[int, ...]) -> None:
    try:
        numbers = tuple(map(float, values))  # type: ignore[call-overload]
    except (TypeError, ValueError):
        numbers = ()
    if len(numbers) not in counts or not all(map(isfinite, numbers)):
        raise ValueError(f'{name} is {values!r}; needed: '
                         f'{" or ".join(map(str, counts))} finite numbers')


def _turn_of_z_to(direction: tuple[float, float, float]) -> tuple[float, float, float, float]:
    """Return the shortest rotation from +z to a direction as a quaternion x, y, z, w."""
    x, y, z = (value / hypot(*direction) for value in direction)
    length = hypot(x, y, 1.0 + z)
    return (-y / length, x / length, 0.0, (1.0 + z) / length) if length > 1e-9 else (
        0.0, 1.0, 0.0, 0.0)
