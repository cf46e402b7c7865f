# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
All states that one soft segment can be brought to, as one curve.

While one segment is soft and the others are held, the pulls of both tendons, their tensions and
the tip follow from the bending angle of that segment.
"""

from dataclasses import dataclass
from math import ceil, degrees, radians

import numpy as np

from soft_continuum.mechanics.chain import Array, Equilibrium, LEFT, RIGHT
from soft_continuum.mechanics.either import State
from soft_continuum.mechanics.errors import StaticsError
from soft_continuum.mechanics.statics import Statics

STEP = radians(2.0)  # rad between two points of a curve, at most
FINE_STEP = radians(0.02)  # rad to which an angle is found by its pull


@dataclass(frozen=True)
class CurveLimits:
    """
    What a state of the curve may need.

    pull_limits: m.  tension_limit: N.  antagonist_slack: m left in the tendon that does not carry
    the arm.  offsets: (tendons,) m by which each tendon is pulled in beyond what its motor says.
    """

    pull_limits: tuple[float, float] = (-0.06, 0.06)
    tension_limit: float = 60.0
    antagonist_slack: float = 0.0005
    offsets: tuple[float, ...] = (0.0, 0.0)

    def problem(self, found: State, pulls: Array) -> str:
        """Return which of them a state exceeds, with its pulls (tendons,), m; or ''."""
        low, high = self.pull_limits
        if found.jumped:
            return 'beyond it the arm jumps to another shape'
        if found.tensions.max() > self.tension_limit:
            return f'the tension_limit of {self.tension_limit:g} N'
        if pulls.min() - self.antagonist_slack < low or pulls.max() > high:
            return f'the pull_limits of {low:g} to {high:g} m'
        return ''


@dataclass(frozen=True, eq=False)
class BendingCurve:
    """
    The states of one soft segment (0-based) in the order of its bending angle.

    angles: (k,) rad, rising.  pulls: (k, tendons) m, with slack.  tips: (k, 2), x and z in m.
    carriers: (k,), the tendon with the largest tension.  ends: why the curve ends at its
    smallest and its largest angle.
    """

    segment: int
    angles: Array
    pulls: Array
    tips: Array
    carriers: Array
    ends: tuple[str, str]

    @property
    def slope(self) -> float:
        """Largest change of a pull per change of the angle, m/rad."""
        steps = np.diff(self.angles)[:, None]
        return float(np.abs(np.diff(self.pulls, axis=0) / steps).max())

    def clipped(self, angle: float) -> float:
        """Return the angle of the curve that is nearest to ``angle``, rad."""
        return float(np.clip(angle, self.angles[0], self.angles[-1]))

    def pulls_at(self, angle: float) -> Array:
        """Return the pulls (tendons,) m at a bending angle (rad) of the curve."""
        return np.array([np.interp(angle, self.angles, pulls) for pulls in self.pulls.T])

    def angle_for_pulls(self, pulls: Array, near: float) -> float:
        """Return the angle (rad) at which the tendon that carries the arm has its pull (m)."""
        tendon = int(self.carriers[np.abs(self.angles - near).argmin()])
        count = ceil((self.angles[-1] - self.angles[0]) / FINE_STEP) + 1
        fine = np.linspace(self.angles[0], self.angles[-1], count)
        off = np.abs(np.interp(fine, self.angles, self.pulls[:, tendon]) - pulls[tendon])
        return float(fine[off.argmin()])

    def end(self, angle: float) -> str:
        """Return why the curve ends on the side of an angle."""
        return self.ends[int(angle > self.angles.mean())]

    def angle_for_tip(self, x: float, z: float, _: float = 0.0) -> float:
        """Return the angle (rad) at which the tip is nearest to a point (m), whatever its y."""
        start, step = self.tips[:-1], np.diff(self.tips, axis=0)
        away = np.array([x, z]) - start
        length = np.maximum((step**2).sum(axis=1), 1e-30)
        part = np.clip((away * step).sum(axis=1) / length, 0.0, 1.0)
        nearest = int(((away - part[:, None] * step)**2).sum(axis=1).argmin())
        return float(self.angles[nearest] + part[nearest] * np.diff(self.angles)[nearest])


def bending_curve(statics: Statics, state: Equilibrium, segment: int,
                  limits: CurveLimits) -> BendingCurve:
    """
    Return what ``segment`` (0-based) can be bent to from ``state``, all others held.

    The curve ends at the bending angle limit of the segment, or where a limit of tension or pull
    is reached, or the arm has no stable state.  Raises StaticsError when it has no length.
    """
    limit = statics.chain.arm.segments[segment].bending_angle_limit
    present = float(np.clip(state.bending_angles[segment], -limit, limit))
    ends, rows = ['', ''], []
    for end, turn in enumerate((-1, 1)):
        reach = limit - turn * present
        steps = max(1, ceil(reach / STEP)) if reach > 0.0 else 0
        found, branch = state, []
        ends[end] = f'the bending angle limit of {degrees(limit):.1f} degrees'
        # Both begin at the present angle, which is kept once.
        for part in np.linspace(0.0, reach, steps + 1)[end:]:
            try:
                found = statics.bend(found, segment, present + turn * float(part),
                                     vacuum=state.vacuum or None, sliding=(turn, -turn))
            except StaticsError as error:
                ends[end] = str(error)
                break
            pulls = statics.commanded_pulls(found, (turn, -turn)) - limits.offsets
            if problem := limits.problem(found, pulls):
                ends[end] = problem
                break
            branch.append((present + turn * float(part), found, pulls))
        rows += branch[::-1] if turn < 0 else branch
    if len(rows) < 2:
        raise StaticsError(f'segment {segment + 1} cannot be bent from here: '
                           f'{ends[0]}; {ends[1]}', state)
    tensions = np.array([found.tensions for _, found, _ in rows])
    return BendingCurve(
        segment, np.array([angle for angle, _, _ in rows]),
        np.array([pulls for _, _, pulls in rows]) - _slack(tensions, limits.antagonist_slack),
        np.array([found.tip[:2] for _, found, _ in rows]), tensions.argmax(axis=1),
        (ends[0], ends[1]))


def _slack(tensions: Array, slack: float) -> Array:
    """
    Return the slack (k, 2) m of both tendons.

    Where the arm goes over from one tendon to the other, so does the slack, over two points: the
    tendons hold next to nothing there, and both taut at once could be more than the arm allows.
    """
    carrier = np.sign(tensions[:, RIGHT] - tensions[:, LEFT])
    carried = np.convolve(np.pad(carrier, 1, mode='edge'), np.full(3, 1.0 / 3.0), 'valid')
    right = (1.0 + carried) / 2.0  # 1 where the right tendon carries the arm
    return slack * np.column_stack([1.0 - right, right])
