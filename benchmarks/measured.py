# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Real arms, FTDCR v4 and v6: what was recorded of them, their model, and how it is identified."""

import csv
from dataclasses import dataclass, fields, replace
from math import pi
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.distance import pdist

from soft_continuum.mechanics.arm import Arm, Array, Disc, SECOND_ORDER, Segment, Tendon
from soft_continuum.mechanics.batch import solve_path
from soft_continuum.mechanics.space.statics import SpaceStatics

DATA = Path(__file__).parents[1] / 'data'
POISSON = 0.3
BODIES = 6  # per segment
PRESLIDING = 0.7  # 1/m
TENDONS = 3  # of each segment
WITHIN, APART = 1e-4, 15.0  # m, s: the same pulls, at two times
PAID_OUT = 0.003  # m: a tendon is slack


def of_rod(youngs_modulus: float) -> float:
    """Return the bending stiffness of a rod of 1 mm, N m^2."""
    return youngs_modulus * pi / 4.0 * 0.0005**4


@dataclass(frozen=True)
class Design:
    """
    What is known of an arm, and where its recordings are.

    lengths: of the segments, m.  bending_stiffness: N m^2, by E as its makers have it.  spacers:
    guides inside each segment.  single: poses of train.csv in which one tendon or one segment
    moves; in the others, two segments do.
    """

    folder: str
    lengths: tuple[float, ...]
    bending_stiffness: float
    spacers: int
    single: int


V4 = Design('ftdcr', (0.06, 0.0625, 0.064), of_rod(50e9), 2, 717)
V6 = Design('ftdcr_v6', (0.1, 0.1, 0.022), of_rod(10e9), 5, 529)


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


def read(name: str, design: Design = V4) -> Recording:
    """Return the recording ``train`` or ``val``."""
    with open(DATA / design.folder / f'{name}.csv', newline='', encoding='ascii') as file:
        rows = list(csv.reader(file))[1:]
    values = np.array([row[:1] + row[2:] for row in rows], dtype=float)
    return Recording(values[:, 0], tuple(row[1] for row in rows), 1e-3 * values[:, 1:10],
                     1e-3 * values[:, 10:])


@dataclass(frozen=True)
class MeasuredArm:
    """
    What is identified of the arm; the defaults are where the search begins.

    offset: of the guides from the axis, m.  compliance: of a tendon and what pulls it, m/N.
    angle: of the first tendon of the lowest segment, rad; turn: by how much further it is around
    the axis in each segment above.  pull_2, pull_3: by how much the tendons of segments 2 and 3
    are pulled at zero, m.  marker: how far beside the axis the tip is measured, along y of the
    tip, m.  delay: of the motion capture behind the servos, s.  mass: of the arm, kg; it stands
    upright.  friction: N m.  design: what was known of it before.
    """

    offset: float = 0.0045
    compliance: float = 1.5e-4
    angle: float = -3.0589
    turn: float = 0.5
    pull_2: float = 1e-4
    pull_3: float = 3e-4
    marker: float = 0.0
    delay: float = 0.0
    mass: float = 0.02
    friction: float = 1e-3
    design: Design = V4

    def arm(self) -> Arm:
        """Return it as an arm."""
        lengths, stiffness = self.design.lengths, self.design.bending_stiffness
        share = self.mass / sum(lengths)
        segments = tuple(Segment(
            length, stiffness, stiffness, stiffness / (1.0 + POISSON), share * length,
            friction=self.friction, presliding=PRESLIDING) for length in lengths)
        tendons = tuple(Tendon(
            f'segment_{s + 1}_{i + 1}', self.angle + s * self.turn + 2.0 * pi * i / TENDONS,
            self.offset, s + 1)
            for s in range(len(lengths)) for i in range(TENDONS))
        arm = Arm(segments, (Disc(),) * 4, tendons, BODIES, self.design.spacers, SECOND_ORDER)
        return arm.with_compliant_tendons(self.compliance) if self.compliance else arm

    def tips(self, recording: Recording) -> Array:
        """Return where the tip is measured (n, 3), m, with the pulls set in turn from straight."""
        statics = SpaceStatics(self.arm())
        then = recording.times - self.delay
        pulls = np.column_stack([np.interp(then, recording.times, each)
                                 for each in recording.pulls.T])
        pulls += np.repeat([0.0, self.pull_2, self.pull_3], TENDONS)
        soft = [True] * len(self.design.lengths)
        path = solve_path(statics, statics.chain.straight(), pulls, soft)
        found: Array = path.tips + self.marker * path.configurations[:, -1, :, 1]
        return found

    def stddevs(self, recording: Recording) -> Array:
        """Return measured minus computed tips (n, 3), m; the frames' origins differ."""
        return recording.tips - self.tips(recording)


@dataclass(frozen=True)
class CreepingArm:
    """
    An arm without weight whose tendons creep; the other fields are as in MeasuredArm.

    compliance: strain of a tendon by its tension, 1/N; its length is that in the arm.  pulled: by
    how much each tendon is pulled at zero, m.  creep: by which share of its elastic stretch a
    tendon creeps, with the time constant creep_time, s.  weight: of the arm, N, in base_link.
    """

    offset: float = 0.0045
    compliance: float = 8e-3
    angle: float = -3.04
    turn: float = 0.58
    pulled: tuple[float, ...] = (0.5e-3, 0.5e-3, 0.5e-3, 1e-3, 1e-3, 3.5e-3, 1e-3, 1e-3, 1e-3)
    creep: float = 0.4
    creep_time: float = 10.0
    marker: float = 0.0
    friction: float = 1e-4
    design: Design = V6

    def arm(self) -> Arm:
        """Return it as an arm."""
        known = MeasuredArm(self.offset, 0.0, self.angle, self.turn, mass=0.0,
                            friction=self.friction, design=self.design).arm()
        return replace(known, tendons=tuple(
            replace(tendon, axial_stiffness=1.0 / self.compliance) for tendon in known.tendons))

    def tips(self, recording: Recording) -> Array:
        """Return where the tip is measured (n, 3), m, with the pulls set in turn from straight."""
        statics = SpaceStatics(self.arm())
        state, soft = statics.chain.straight(), [True] * len(self.design.lengths)
        crept, found = np.zeros(len(self.pulled)), []
        passed = np.diff(recording.times, prepend=recording.times[0])
        for pulls, shares in zip(recording.pulls + self.pulled,
                                 -np.expm1(-passed / self.creep_time), strict=True):
            creeps_to = self.creep * statics.compliance * state.tensions
            crept += shares * (creeps_to - crept)
            state = statics.solve(state, pulls - crept, soft)
            found.append(state.tip + self.marker * state.configuration[-1, :, 1])
        return np.array(found)

    def stddevs(self, recording: Recording) -> Array:
        """Return measured minus computed tips (n, 3), m; the frames' origins differ."""
        return recording.tips - self.tips(recording)


SCALES = MeasuredArm(1e-4, 2e-5, 0.03, 0.03, 1e-4, 1e-4, 2e-3, 0.1, 5e-3, 5e-4)
SCALES_V6 = CreepingArm(1e-4, 3e-4, 0.03, 0.03, (1e-4,) * 9, 0.05, 2.0, 1e-3, 1e-4)
"""Steps that change tips by about a millimetre."""
NEVER_NEGATIVE = ('offset', 'compliance', 'creep', 'creep_time', 'mass', 'friction')
AnyArm = TypeVar('AnyArm', MeasuredArm, CreepingArm)


def repeats(recording: Recording, within: float = WITHIN, apart: float = APART
            ) -> tuple[Array, Array]:
    """
    Return the numbers (k,), (k,) of all pairs of poses with nearly the same pulls, at two times.

    within: m by which no pull differs, where what is paid out by more than PAID_OUT counts as
    equal.  apart: s.
    """
    first, second = np.triu_indices(len(recording.times), 1)
    chosen = (pdist(np.maximum(recording.pulls, -PAID_OUT), 'chebyshev') < within) & (
        pdist(recording.times[:, None]) > apart)
    return first[chosen], second[chosen]


def aligned(stddevs: Array) -> Array:
    """Return them (n, 3) less their mean: the recordings do not say where the base is."""
    found: Array = stddevs - stddevs.mean(axis=0)
    return found


def rms(stddevs: Array) -> float:
    """Return the root mean square of their lengths, m; (n, 3) m."""
    return float(np.sqrt((stddevs**2).sum(axis=1).mean()))


def identify(recording: Recording, begin: AnyArm, scales: AnyArm, steps: int = 5) -> AnyArm:
    """
    Return the arm that explains a recording best, means aligned, in steps of least squares.

    scales: SCALES of that arm.  Without friction in ``begin`` there is none in the result.
    """
    names = [field.name for field in fields(begin) if field.name != 'design' and (
        field.name != 'friction' or begin.friction > 0.0)]
    first, step = ([np.atleast_1d(getattr(arm, name)) for name in names]
                   for arm in (begin, scales))
    ends = np.cumsum([len(each) for each in first])

    def found(steps_of: Array) -> AnyArm:
        values = np.split(np.concatenate(first) + steps_of * np.concatenate(step), ends[:-1])
        changed: dict[str, Any] = {
            name: tuple(each.tolist()) if isinstance(getattr(begin, name), tuple) else
            float(each[0]) for name, each in zip(names, values, strict=True)}
        return replace(begin, **changed)

    def residuals(steps_of: Array) -> Array:
        return 1e3 * aligned(found(steps_of).stddevs(recording)).ravel()

    def jacobian(steps_of: Array) -> Array:
        at, unit = residuals(steps_of), np.eye(ends[-1])
        return np.column_stack([
            (residuals(steps_of + 0.3 * one) - at) / 0.3 for one in unit])

    least = np.concatenate([-each / by if name in NEVER_NEGATIVE else np.full(len(each), -np.inf)
                            for name, each, by in zip(names, first, step, strict=True)])
    best = least_squares(residuals, np.zeros(ends[-1]), jacobian, ftol=2e-3,
                         max_nfev=steps + 1, bounds=(least, np.inf))
    return found(best.x)


IDENTIFIED = MeasuredArm(
    0.00445197, 1.86998e-4, -3.02596, 0.479743, 1.18842e-4, 4.11952e-4, 0.00595415, 0.0504907,
    0.0200325, 0.001305)
"""On the whole of train.csv."""
MEMORYLESS = MeasuredArm(
    0.00442142, 1.84327e-4, -3.02477, 0.478882, 1.22711e-4, 4.13802e-4, 0.0059325, 0.0898679,
    0.0169798, 0.0)
"""On the whole of train.csv, without friction."""
SINGLES = MeasuredArm(
    0.00445506, 1.718e-4, -3.02532, 0.483441, 1.34197e-4, 3.89117e-4, 0.00581278, 0.056848,
    0.0205745, 0.00114639)
"""On its first part, V4.single."""
IDENTIFIED_V6 = CreepingArm(
    0.00360235, 0.0153548, -3.03683, 0.595884,
    (6.31225e-4, 4.66264e-4, 5.61106e-4, 1.52958e-3, 1.06825e-3, 3.32661e-3, 1.21652e-3,
     7.63751e-4, 1.19898e-3), 0.505418, 22.2638, 0.00171235, 7.85485e-5)
"""On the whole of its train.csv."""
SINGLES_V6 = CreepingArm(
    0.003514, 0.0153657, -3.04086, 0.578515,
    (8.61261e-4, 7.00448e-4, 6.35552e-4, 1.41961e-3, 1.05874e-3, 3.55157e-3, 1.20874e-3,
     9.57355e-4, 1.28824e-3), 0.30895, 7.7359, 0.00210512, 8.29846e-5)
"""On its first part, V6.single."""
