# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Runs of the twin in which something breaks, or nothing, as recordings of the truth."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from math import cos, sin, tan
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks import closed
from benchmarks.lab import Description, known, Lab, TRUTH
from benchmarks.loop import random_goal
from soft_continuum.estimation.measuring import DiscMeasurement
from soft_continuum.mechanics import Arm, Statics
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.directions import bending_vectors
from soft_continuum.mechanics.rotations import bending_between, matrices
from soft_continuum.planning.planner import Planner, PlanSettings
from soft_continuum.planning.plans import Move, PlanError, Shape
from soft_continuum.planning.shape_plans import plans_to
from soft_continuum.sim.twin.model_errors import ModelErrors
from soft_continuum.sim.twin.plant import Plant, TIME_STEP

PERIOD = 0.02  # s of the motors' positions
VACUUM_TIME = 0.2  # s, time constant of the valves
BEGIN, SWITCH, REST, AFTER = 1.0, 1.5, 4.0, 1.5  # s: at first; valves; after motion; stiffened
HOLD = 3.0  # s that a shape of a closed loop is held
WATCHED = 6.0  # s that a fault is watched for at least
ANGLE = 0.6  # rad, largest bending angle
LEAST_ANGLE = 0.2  # rad by which a segment is set at least
OFFSET, LOAD = (3e-3, 6e-3), (5e-3, 2e-2)  # m: of a tendon; by which a load moves a disc
PUSH, MAX_PUSH = 1.0, 1.5  # N/s, N
LEAST_TENSION, LEAST_TRAVEL = 0.5, 8e-3  # N, m: of a tendon that fails in motion
TAG, CAMERA = (5e-3, 1e-2), (5e-3, 1.2e-2)  # m; turned by up to 10 and 4 degrees, besides
DEVIATIONS = np.repeat([8e-4, 1e-2], 3)  # m, rad of a disc, the same in every picture ...
NOISE = 0.2  # ... and as parts of them, new in every picture
MIDDLE = np.array([0.0, 0.0, 0.15])  # m, about which a camera turns


class Fault(Enum):
    """What breaks; the value says it in the table."""

    NONE = 'nothing'
    SLIP = 'a tendon slips by 3 to 6 mm, at rest'
    SLIP_MOVING = 'a tendon slips by 3 to 6 mm, in motion'
    STEPS = 'a motor loses steps (3 to 6 mm)'
    NOT_STIFF = 'a stiff segment loses 85 to 90 % of its vacuum'
    NOT_SOFT = 'a segment keeps its vacuum'
    LOAD = 'a load moves a disc by 5 to 20 mm, or is 1.5 N'
    SENSOR = 'a tag is knocked by 5 to 10 mm and up to 10°'
    CAMERA = 'the camera is knocked by 5 to 12 mm and up to 4°'


@dataclass(frozen=True, eq=False)
class Run:
    """
    A recording, a row each PERIOD.

    times: (n,) s.  pulls: (n, tendons) m, as the motors say.  soft: (n, segments), as reported.
    poses: (n, discs, 7), of the discs as a perfect camera sees them.  moment: s, when the fault
    could be seen first.  detail: what it was, for a person.
    """

    fault: Fault
    seed: int
    times: Array
    pulls: Array
    soft: Array
    poses: Array
    moment: float
    detail: str


class SyntheticCamera:
    """Sees discs with errors that are the same in all pictures, and with noise."""

    def __init__(self, random: np.random.Generator, arm: Arm) -> None:
        """Put it up before an arm."""
        self._random, self._axes = random, arm.pose_axes
        self._errors: Array | None = None
        self.covariance = known(arm, DEVIATIONS * np.sqrt(1.0 + NOISE**2))

    def __call__(self, poses: Array) -> Array:
        """Return poses (discs, 7) as they are seen."""
        shape = len(poses), int(self._axes.sum())
        if self._errors is None:
            self._errors = self._random.normal(size=shape)
        noise = self._random.normal(0.0, NOISE, shape)
        away = np.zeros((len(poses), 6))
        away[:, self._axes] = (self._errors + noise) * DEVIATIONS[self._axes]
        return off(poses, away[:, :3], away[:, 3:])


@dataclass(eq=False)
class _Push:
    """A force (N) in a direction on a body, that grows until a disc has moved by some m."""

    body: int
    direction: Array
    distance: float
    before: Array
    force: float = 0.0


class Rig:
    """The plant with its boards."""

    def __init__(self, arm: Any, differences: ModelErrors, fault: Fault, seed: int,
                 harmless: bool) -> None:
        self.harmless = harmless
        self.plant: Any = Plant(arm, differences)
        self.random = np.random.default_rng([seed, list(Fault).index(fault)])
        self.fault = fault
        self.pulls, self.lost, self.to_lose = np.zeros((3, len(arm.tendon_names)))
        # As the motors say, m; m that they are behind, and will be.
        self.soft = [False] * len(arm.segments)
        self.leaking = np.zeros(len(arm.segments))  # 1: of which only a little arrives
        self.keeping = np.zeros(len(arm.segments), dtype=bool)
        self.vacuum = np.ones(len(arm.segments))
        self.poses: Callable[[Array], Array] = lambda poses: poses
        self.rows: list[tuple[float, Array, Array, Array]] = []
        self.pushed: _Push | None = None
        self.carrying = 0  # the tendon that will, after the motion
        self.last_chance = True
        self.moment, self.detail = np.inf, ''

    def run(self, duration: float, move: Move | None = None, at: float = np.inf) -> None:
        """Let time pass; ``at`` a part of it the fault happens."""
        periods, steps = round(duration / PERIOD), round(PERIOD / TIME_STEP)
        for k in range(periods):
            if k >= at * periods and (self._can_break() or k == periods - 1 and self.last_chance):
                self._break(move)
                at = np.inf
            self._push()
            for i in range(steps):
                pulls = self.pulls
                if move is not None:
                    now = (k + (i + 1) / steps) * PERIOD
                    pulls = np.array([np.interp(now, move.times, one) for one in move.pulls.T])
                self._step(pulls)
            self.rows.append((self.plant.time, self.pulls.copy(), np.array(self.soft),
                              self.poses(self.plant.poses[::2])))

    def _push(self) -> None:
        one = self.pushed
        if one is None or one.force >= MAX_PUSH or np.linalg.norm(
                self._places() - one.before, axis=1).max() > one.distance:
            return
        one.force += PUSH * PERIOD
        self.plant._data.xfrc_applied[one.body, :3] = one.force * one.direction

    def _step(self, pulls: Array) -> None:
        change = pulls - self.pulls
        stalled = np.sign(change) * np.minimum(np.abs(change), self.to_lose)
        self.to_lose -= np.abs(stalled)
        self.lost += stalled
        self.pulls = np.array(pulls)
        wanted = np.where(np.array(self.soft) & ~self.keeping, 0.0, 1.0)
        wanted = np.where(self.leaking > 0.0, np.minimum(wanted, self.leaking), wanted)
        self.vacuum += (wanted - self.vacuum) * TIME_STEP / VACUUM_TIME
        self.plant.step(self.pulls - self.lost, self.vacuum)

    def set_soft(self, segment: int, soft: bool) -> None:
        """Switch a segment."""
        self.soft[segment] = soft

    def broke(self, detail: str) -> None:
        """Note that, and when, the fault happened."""
        self.moment, self.detail = self.plant.time, detail

    def _can_break(self) -> bool:
        """Whether it can happen now: a tendon without tension does not slip."""
        return self.fault is not Fault.SLIP_MOVING or bool(
            self.plant.tensions[self.carrying] > LEAST_TENSION)

    def _break(self, move: Move | None) -> None:
        if self.harmless:
            self.broke('')
            return
        random, plant = self.random, self.plant
        fault = self.fault
        tendon = self.carrying if fault in (Fault.SLIP_MOVING, Fault.STEPS) else int(
            np.argmax(plant.tensions))
        if fault in (Fault.SLIP, Fault.SLIP_MOVING):
            size = random.uniform(*OFFSET)
            plant._slipped[tendon] += size
            self.broke(f'tendon {tendon}, {size * 1e3:.1f} mm, {plant.tensions[tendon]:.1f} N')
        elif fault is Fault.STEPS:
            self.to_lose[tendon] = random.uniform(*OFFSET)
            far = 0.0 if move is None else float(np.ptp(move.pulls[:, tendon]))
            self.broke(f'tendon {tendon}, {self.to_lose[tendon] * 1e3:.1f} mm, '
                       f'{far * 1e3:.1f} mm of motion')
        elif fault is Fault.NOT_STIFF:
            bent = self._bent()
            bent[np.array(self.soft)] = 0.0
            segment = int(np.argmax(bent))
            self.leaking[segment] = random.uniform(0.1, 0.15)
            self.broke(f'segment {segment + 1}, bent by {np.degrees(bent[segment]):.0f} degrees')
        elif fault is Fault.LOAD:
            disc = int(random.integers(self.soft.index(True), len(self.soft))) + 1
            way = self._way(tendon)
            self.pushed = _Push(plant._model.body(f'b{disc * plant._per_segment - 1}').id,
                                way, random.uniform(*LOAD), self._places())
            self.broke(f'disc {disc}, towards {way.round(2).tolist()}')
        elif fault is Fault.SENSOR:
            self._knock_tag(int(random.integers(1, len(self.soft) + 1)))
        elif fault is Fault.CAMERA:
            self._knock_camera()

    def _places(self) -> Array:
        """Return where the discs are without their angles, (2 * discs, 3), m."""
        return np.asarray(self.plant.poses[:, :3])

    def _bent(self) -> Array:
        """Return by how much each segment bends, (segments,), rad."""
        return np.asarray(np.linalg.norm(
            bending_between(matrices(self.plant.poses[::2, 3:])), axis=1))

    def _way(self, tendon: int) -> Array:
        """Return a direction (3,) in which to push, while a tendon is taut."""
        # Against a taut tendon nothing moves: it pushes more or less towards that.
        arm, random = self.plant.arm, self.random
        angle = arm.tendons[tendon].angle
        if arm.planar:
            lift = 1.0 / tan(random.uniform(np.pi / 6.0, 5.0 * np.pi / 6.0))
        else:
            angle += random.uniform(-1.0, 1.0)
            lift = random.uniform(-0.5, 0.5)
        return np.asarray(np.array([cos(angle), sin(angle), lift]) / np.hypot(1.0, lift))

    def _knock(self, sizes: tuple[float, float], turned: float) -> tuple[Array, Array]:
        """Return a random shift (3,), m, and rotation (3,), rad; turned: degrees, at most."""
        random = self.random
        if self.plant.arm.planar:
            way, size = random.uniform(-np.pi, np.pi), random.uniform(*sizes)
            turn = np.radians(random.uniform(-turned, turned))
            return size * np.array([sin(way), 0.0, cos(way)]), np.array([0.0, turn, 0.0])
        shift = random.uniform(*sizes) * _direction(random)
        return shift, np.radians(random.uniform(0.0, turned)) * _direction(random)

    def _knock_tag(self, disc: int) -> None:
        shift, turn = self._knock(TAG, 10.0)
        which = np.arange(len(self.soft) + 1)[:, None] == disc
        self.poses = lambda poses: off(poses, which * shift, which * turn)
        self.broke(f'disc {disc}, {_sizes(shift, turn)}')

    def _knock_camera(self) -> None:
        shift, turn = self._knock(CAMERA, 4.0)
        self.poses = lambda poses: moved(poses, shift, turn)
        self.broke(_sizes(shift, turn))


def _direction(random: np.random.Generator) -> Array:
    """Return a random direction, (3,)."""
    found: Array = random.normal(size=3)
    return found / np.linalg.norm(found)


def _sizes(shift: Array, turn: Array) -> str:
    return (f'{np.linalg.norm(shift) * 1e3:.1f} mm, '
            f'{np.degrees(np.linalg.norm(turn)):.1f} degrees')


def off(poses: Array, shift: Array, turn: Array) -> Array:
    """Return poses (n, 7) that are shifted (m) and turned (rad), each (3,) or (n, 3)."""
    turned = Rotation.from_rotvec(turn) * Rotation.from_quat(poses[:, 3:])
    return np.column_stack([poses[:, :3] + shift, turned.as_quat()])


def moved(poses: Array, shift: Array, turn: Array, middle: Array = MIDDLE) -> Array:
    """Return poses (n, 7) as a camera sees them that moved: by (3,) m, (3,) rad about a point."""
    places = Rotation.from_rotvec(turn).apply(poses[:, :3] - middle) + middle
    return off(np.column_stack([places, poses[:, 3:]]), shift, turn)


def simulate(arm: Any, differences: ModelErrors, fault: Fault, seed: int, shapes: int = 1,
             harmless: bool = False) -> Run:
    """
    Return a sequence of random shapes in which a fault happens in a random move.

    With a fault it ends WATCHED after it, at the earliest after that move.  harmless: nothing
    breaks, and all else is the same.
    """
    rig = Rig(arm, replace(differences, seed=seed), fault, seed, harmless)
    in_motion = fault in (Fault.SLIP_MOVING, Fault.STEPS)
    more = 2 if in_motion or fault is Fault.SLIP else 0  # until a tendon does what it has to
    moves, carrying = _plan(arm, rig.random, shapes + more)
    # A jam that holds nothing shows when the next segment moves.
    chosen, last = -1, len(moves) - (fault is Fault.NOT_STIFF)
    if in_motion:  # of a tendon that moves and carries then, and that did so before
        eligible = [
            n for n in range(1, last) if carrying[n] is not None and carrying[n] in carrying[:n]
            and np.ptp(moves[n].pulls[:, carrying[n]]) > LEAST_TRAVEL]
        chosen = eligible[0]
    elif fault is Fault.SLIP:
        chosen = next(n for n in range(1, last) if carrying[n] is not None)
    elif fault is not Fault.NONE:
        chosen = int(rig.random.integers(1, last))
    rig.run(BEGIN)
    for n, move in enumerate(moves):
        at = [np.inf] * 4  # part of: softening, motion, rest, stiffened
        if fault is Fault.SLIP_MOVING and rig.moment == np.inf and n in eligible:
            chosen, rig.last_chance = n, n == eligible[-1]
        if n == chosen:
            rig.carrying = carrying[n] or 0
            phase = {Fault.SLIP: 2, Fault.SLIP_MOVING: 1, Fault.STEPS: 1}.get(
                fault, int(rig.random.integers(0, 4)))
            if fault is Fault.LOAD:  # while a segment is soft
                phase = 2
            # At rest once it has been seen to rest, in motion in the middle.
            at[phase] = rig.random.uniform(0.3, 0.6)
            if fault is Fault.NOT_SOFT:
                at = [np.inf] * 4
                rig.keeping[move.segment] = not harmless
        rig.set_soft(move.segment, True)
        rig.run(SWITCH, at=at[0])
        if n == chosen and fault is Fault.NOT_SOFT:
            rig.broke(f'segment {move.segment + 1}, to be set to '
                      f'{np.degrees(move.goal[move.segment, 1]):.0f} degrees')
        rig.run(move.duration, move, at=at[1])
        # Half of the runs without a fault pause nowhere, as a list of shapes is run.
        pauses = fault is not Fault.NONE or seed % 2 == 0
        rig.run(REST if pauses else 0.0, at=at[2])
        rig.set_soft(move.segment, False)
        rig.run(SWITCH + (AFTER if pauses else 0.0), at=at[3])
        if n > chosen - 1 + (fault is Fault.NOT_STIFF) and rig.plant.time > rig.moment + WATCHED:
            break
    if rig.plant.time < rig.moment + WATCHED and fault is not Fault.NONE:
        rig.run(rig.moment + WATCHED - rig.plant.time)
    times, pulls, soft, poses = (np.array(one) for one in zip(*rig.rows, strict=True))
    return Run(fault, seed, times, pulls, soft, poses, rig.moment, rig.detail)


def displacement(arm: Arm, differences: ModelErrors, run: Run) -> float:
    """Return by how much at most a fault displaced a disc, m: against the run without it."""
    without = simulate(arm, differences, run.fault, run.seed, harmless=True)
    return float(np.linalg.norm((run.poses - without.poses)[:, :, :3], axis=2).max())


def _plan(arm: Arm, random: np.random.Generator, shapes: int
          ) -> tuple[list[Move], list[int | None]]:
    """
    Return the moves of random shapes that can be planned, each of which moves every segment.

    And the tendon that carries after each, as the described arm has it, or None.
    """
    planner, statics = Planner(arm, PlanSettings()), Statics(arm)
    state, pulls = statics.chain.straight(), np.zeros(len(arm.tendons))
    count, found = len(arm.segments), list[Move]()
    carrying: list[int | None] = []
    while len(found) < shapes * count:
        angles = random.uniform(-ANGLE if arm.planar else LEAST_ANGLE, ANGLE, count)
        directions = () if arm.planar else tuple(random.uniform(-np.pi, np.pi, count).tolist())
        away = bending_vectors(arm, angles.tolist(), directions) - state.bending
        if min(np.linalg.norm(away, axis=1).min(), np.abs(angles).min()) < LEAST_ANGLE:
            continue
        try:
            plan, = plans_to(planner, [Shape('random', tuple(angles.tolist()), 0.0, directions)],
                             state, pulls)
        except PlanError:
            continue
        for move in plan.moves:
            state = statics.solve(
                state, move.pulls[-1], [s == move.segment for s in range(count)])
            carrying.append(int(np.argmax(state.tensions))
                            if max(state.tensions) > LEAST_TENSION else None)
        found += plan.moves
        state, pulls = plan.state, plan.moves[-1].pulls[-1]
    return found, carrying


class _Recorder(Lab):
    """A rig that its controller sees by a SyntheticCamera, and that is recorded."""

    def __init__(self, description: Description, differences: ModelErrors) -> None:
        self.rows: list[tuple[float, Array, Array, Array]] = []
        self._synthetic = SyntheticCamera(
            np.random.default_rng(differences.seed), description.arm)
        super().__init__(description, differences, TRUTH)

    def advance(self, pulls: Array) -> None:
        """Let time pass, and note what came of it."""
        super().advance(pulls)
        self.rows.append(
            (self.time, self.pulls.copy(), ~np.array(self.stiff), self.truth[::2]))

    def look(self) -> dict[int, DiscMeasurement]:
        """Return the discs as they are seen now."""
        return {n: DiscMeasurement(n, pose, self._synthetic.covariance)
                for n, pose in enumerate(self._synthetic(self.truth[::2]))}


def closed_loop(description: Description, differences: ModelErrors, seed: int) -> Run:
    """Return how the closed loop sets a random shape, without a fault, and holds it a little."""
    lab = _Recorder(description, replace(differences, seed=seed))
    outcome = closed.closed_loop(lab, random_goal(description, seed), description.arm)
    for _ in range(round(HOLD / PERIOD)):
        lab.wait(PERIOD)
    times, pulls, soft, poses = (np.array(one) for one in zip(*lab.rows, strict=True))
    return Run(Fault.NONE, seed, times, pulls, soft, poses, np.inf, outcome.failed)
