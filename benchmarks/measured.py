# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A real arm, FTDCR v4: what was recorded of it, the model of it, and how that is identified."""

import csv
from dataclasses import asdict, dataclass, replace
from math import pi
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from soft_continuum.mechanics.arm import SECOND_ORDER, STANDARD_GRAVITY
from soft_continuum.mechanics.chain import Array
from soft_continuum.mechanics.spatial import (
    SpatialArm,
    SpatialDisc,
    SpatialSegment,
    SpatialStatics,
    SpatialTendon,
)

DATA = Path(__file__).parents[1] / 'data' / 'ftdcr'
SINGLE = 717
"""Poses of train.csv in which one tendon or one segment moves; in the others, two segments do."""
LENGTHS = (0.06, 0.0625, 0.064)  # m
BENDING_STIFFNESS = 50e9 * pi / 4.0 * 0.0005**4  # N m^2: a rod of 1 mm, E as its makers have it
POISSON = 0.3
BODIES, SPACERS = 6, 2  # per segment
PRESLIDING = 0.7  # 1/m
TENDONS = 3  # of each segment


@dataclass(frozen=True)
class Recording:
    """
    Poses of the arm, one after the other.

    times (n,) s.  patterns: n names of what was being done.  pulls (n, 9) m, those of the lowest
    segment first.  tips (n, 3) m, in the frame of the motion capture.
    """

    times: Array
    patterns: tuple[str, ...]
    pulls: Array
    tips: Array

    def part(self, begin: int, end: int | None = None) -> 'Recording':
        """Return poses from ``begin`` to before ``end``."""
        chosen = slice(begin, end)
        return Recording(self.times[chosen], self.patterns[chosen], self.pulls[chosen],
                         self.tips[chosen])


def read(name: str) -> Recording:
    """Return the recording ``train`` or ``val``."""
    with open(DATA / f'{name}.csv', newline='', encoding='ascii') as file:
        rows = list(csv.reader(file))[1:]
    values = np.array([row[:1] + row[2:] for row in rows], dtype=float)
    return Recording(values[:, 0], tuple(row[1] for row in rows), 1e-3 * values[:, 1:10],
                     1e-3 * values[:, 10:])


@dataclass(frozen=True)
class MeasuredArm:
    """
    What is identified of the arm; the defaults are where the search begins.

    offset: of the guides from the axis, m.  compliance: of a tendon and what pulls it, m/N.
    angle_1, angle_2, angle_3: of the first tendon of each segment, rad.  pull_2, pull_3: by how
    much those of segments 2 and 3 are pulled at zero, m.  tilt: of the base about x, rad.  mass:
    of the arm, kg; it stands upright.  friction: N m.
    """

    offset: float = 0.0045
    compliance: float = 1.5e-4
    angle_1: float = -3.0589
    angle_2: float = -2.5615
    angle_3: float = -2.0506
    pull_2: float = 1e-4
    pull_3: float = 3e-4
    tilt: float = -0.05
    mass: float = 0.02
    friction: float = 1e-3

    def arm(self) -> SpatialArm:
        """Return it as an arm."""
        share = self.mass / sum(LENGTHS)
        segments = tuple(SpatialSegment(
            length, BENDING_STIFFNESS, BENDING_STIFFNESS, BENDING_STIFFNESS / (1.0 + POISSON),
            share * length, friction=self.friction, presliding=PRESLIDING) for length in LENGTHS)
        angles = (self.angle_1, self.angle_2, self.angle_3)
        tendons = tuple(SpatialTendon(
            f'segment_{s + 1}_{i + 1}', angle + 2.0 * pi * i / TENDONS, self.offset, s + 1,
            compliance=self.compliance) for s, angle in enumerate(angles) for i in range(TENDONS))
        return SpatialArm(segments, (SpatialDisc(),) * 4, tendons, BODIES, SPACERS, SECOND_ORDER,
                          gravity=(0.0, 0.0, -STANDARD_GRAVITY))

    def tips(self, pulls: Array) -> Array:
        """Return the tips (n, 3), m, that follow from straight by pulls (n, 9) in turn, m."""
        statics = SpatialStatics(self.arm())
        state, tips = statics.chain.straight(), np.empty((len(pulls), 3))
        more = np.repeat([0.0, self.pull_2, self.pull_3], TENDONS)
        for tip, each in zip(tips, pulls, strict=True):
            state = statics.solve(state, each + more, [True] * len(LENGTHS))
            tip[:] = state.tip
        turned: Array = Rotation.from_rotvec([self.tilt, 0.0, 0.0]).apply(tips)
        return turned

    def deviations(self, recording: Recording) -> Array:
        """Return measured minus computed tips (n, 3), m; the frames' origins differ."""
        return recording.tips - self.tips(recording.pulls)


SCALES = MeasuredArm(1e-4, 2e-5, 0.03, 0.03, 0.03, 1e-4, 1e-4, 0.03, 5e-3, 5e-4)
"""Steps that change tips by about a millimetre."""


def aligned(deviations: Array) -> Array:
    """Return them (n, 3) less their mean: the recordings do not say where the base is."""
    found: Array = deviations - deviations.mean(axis=0)
    return found


def rms(deviations: Array) -> float:
    """Return the root mean square of their lengths, m; (n, 3) m."""
    return float(np.sqrt((deviations**2).sum(axis=1).mean()))


def identify(recording: Recording, begin: MeasuredArm, steps: int = 5) -> MeasuredArm:
    """
    Return the arm that explains a recording best, means aligned, in steps of least squares.

    Without friction in ``begin`` there is none in the result.
    """
    names = [name for name, value in asdict(begin).items() if name != 'friction' or value > 0.0]
    scales = np.array([getattr(SCALES, name) for name in names])
    first = np.array([getattr(begin, name) for name in names])

    def found(steps_of: Array) -> MeasuredArm:
        values = first + steps_of * scales
        return replace(begin, **dict(zip(names, values.tolist(), strict=True)))

    def residuals(steps_of: Array) -> Array:
        return 1e3 * aligned(found(steps_of).deviations(recording)).ravel()

    def slopes(steps_of: Array) -> Array:
        at, unit = residuals(steps_of), np.eye(len(names))
        return np.column_stack([
            (residuals(steps_of + 0.3 * one) - at) / 0.3 for one in unit])

    best = least_squares(residuals, np.zeros(len(names)), slopes, ftol=2e-3, max_nfev=steps + 1)
    return found(best.x)


IDENTIFIED = MeasuredArm(
    0.00444262, 1.87927e-4, -3.02333, -2.55543, -2.06127, 1.09496e-4, 3.99596e-4, -0.0500813,
    0.0201150, 0.00154893)
"""On the whole of train.csv."""
SINGLES = MeasuredArm(
    0.00445353, 1.73363e-4, -3.04045, -2.52590, -2.07302, 1.19644e-4, 3.79496e-4, -0.0516681,
    0.0212135, 0.00133758)
"""On its first part, SINGLE."""
