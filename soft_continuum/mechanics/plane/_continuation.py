# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
From one equilibrium to the next: a full step, continuation in small ones, or a jump.

A full Newton step is accepted when it ends close by.  Otherwise the path of equilibria is followed
in small steps.  Where the path ends (a segment folds over), an overdamped motion by backward Euler
finds the next stable equilibrium.
"""

from collections.abc import Sequence
from math import isfinite
from typing import NamedTuple, Self

import numpy as np

from soft_continuum.mechanics import _kernel
from soft_continuum.mechanics._linear_algebra import NO_TENSION
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.chain import Equilibrium, LEFT, RIGHT, SLACK
from soft_continuum.mechanics.plane import _newton
from soft_continuum.mechanics.plane._assembly import (
    ANGLE,
    LENGTH,
    State,
    System,
    TendonDrive,
    TENSION,
)
from soft_continuum.mechanics.plane._newton import LENGTH_TOLERANCE, TAUT_TOLERANCE
from soft_continuum.mechanics.plane.chain import PlaneChain
from soft_continuum.mechanics.plane.joints import compliances, JointLaws, tension_ratios
from soft_continuum.mechanics.statics import OverconstrainedError, StaticsError

# How far a segment may turn in one solve, rad; beyond, the path is followed in smaller steps.
TURN_LIMIT = 2.0
TURN_LIMIT_NOT_CONVEX = 0.1  # where loads can outweigh springs, so that paths may end
TURN_LIMIT_BOTH_TAUT = 0.05  # where both tendons are taut, so that the arm may buckle
# Amplitudes of the waves, rad, that make a straight arm between two taut tendons buckle.
BUCKLING_PERTURBATIONS = (1e-3, -2e-3, 4e-3, -8e-3, 0.016, -0.032)
MIN_STEP = 1e-4  # of the path; below it the path has ended
MAX_TOTAL_ITERATIONS = 20000  # of Newton's method in one solve
MAX_FRICTION_ITERATIONS = 100
MAX_DAMPING = 1e9  # N m/rad
DEGENERATE = 0.05  # of the slopes of the tendons' lengths, relative: taken as zero
MAX_MOTION, SLOW_MOTION, AT_REST = 0.3, 0.02, 0.1  # rad per step of the overdamped motion


class Point(NamedTuple):
    """
    A state on the path, and how the solve for it ended.

    theta: (bodies,) rad, absolute angles.  tension: (2,) N.  lengths: (2,) m, as in State.  slack:
    (2,) m, of the tendons at the start, inf where unknown.
    turned: rad, the largest sum over the joints of one segment of how far they turned: what folds
    up inside a segment may end as it began.
    """

    theta: Array
    tension: Array
    lengths: Array
    status: int = _newton.FAILED
    residual: float = np.inf
    iterations: int = 0
    turned: float = 0.0
    slack: Array | None = None


class Problem(NamedTuple):
    """
    Degrees of freedom, loads and driven tendons in one solve.

    groups: number of rigid groups.  turn_limit: rad, of a segment in one solve.  tolerance: (3,),
    as in _newton.newton.  locked_angles: (joints,) rad, kept by locked joints.  stiff, vacuum: as
    in Equilibrium.
    """

    system: System
    drive: TendonDrive
    groups: int
    turn_limit: float
    tolerance: Array
    locked_angles: Array
    stiff: tuple[bool, ...]
    vacuum: tuple[float, ...] = ()

    def with_friction(self, chain: PlaneChain, angles: Array, sliding: Sequence[int]) -> Self:
        """Return the problem with the tendons' friction and stretch at joint angles (joints,)."""
        return self._replace(
            system=self.system._replace(ratios=tension_ratios(chain, angles, sliding)),
            drive=self.drive._replace(compliance=compliances(chain, angles, sliding)))

    def reached_by(self, end: Point) -> bool:
        """Return whether a solve found the equilibrium that continues the one it began at."""
        return self.reached(end.status, end.turned, end.tension)

    def reached(self, status: int, turned: float, tension: Array) -> bool:
        """Return the same, of how a solve ended, how far segments turned, and tension (2,)."""
        if status != _newton.CONVERGED or turned > self.turn_limit:
            return False
        return (turned <= TURN_LIMIT_BOTH_TAUT or tension[RIGHT] <= NO_TENSION
                or tension[LEFT] <= NO_TENSION)


class Continuation:
    """Finds the equilibria of one arm, each from the state before it."""

    def __init__(self, chain: PlaneChain, laws: JointLaws) -> None:
        """Take the chain and its joints."""
        self.chain, self.laws = chain, laws
        self._tendon = (chain.straight_paths[0] + sum(d.height for d in chain.arm.discs)
                        + chain.tendon.free_length)

    def tolerance(self, stiff: Sequence[bool]) -> Array:
        """Return 1e-11 N m and 1e-13 m, or what rounding allows for very stiff or long arms."""
        stiffest = self.laws.greatest_stiffness(stiff)
        return np.array([max(1e-11, 1e-14 * stiffest), max(1e-10, 1e-13 * stiffest),
                         max(1e-13, 1e-15 * self._tendon)])

    def solve(self, start: Equilibrium, problem: Problem, sliding: Sequence[int] = (0, 0)
              ) -> Equilibrium:
        """
        Return the equilibrium of ``problem`` that continues a state.

        sliding: as in Statics.solve.  Raises StaticsError or OverconstrainedError.
        """
        rubs = self.chain.tendon.friction > 0.0 and any(sliding)
        if not rubs and (found := self.in_one_step(start, problem)) is not None:
            return found
        end, problem, jumped = self._step(self.point_of(start), problem)
        if rubs:
            end, problem, also = self._with_friction(end, problem, sliding)
            jumped = jumped or also
        return self.result(end, problem, jumped=jumped)

    def in_one_step(self, start: Equilibrium, problem: Problem, hold: bool = False
                    ) -> Equilibrium | None:
        """
        Return the equilibrium that a full step finds, or None if it is not that wanted.

        hold: as of _newton.equilibrium; the tendons then begin without tension.
        """
        chain = self.chain
        angles, tensions, pulls, slack = found = (
            np.empty(chain.bodies), np.empty(2), np.empty(2), np.empty(2))
        status, iterations, residual, turned = _kernel.functions().equilibrium(
            (start.configuration, np.zeros(2) if hold else start.tensions),
            tuple(problem.system), tuple(problem.drive),
            (problem.groups, chain.straight_paths[0]), hold, problem.tolerance, found)
        if not problem.reached(status, turned, tensions):
            return None
        return Equilibrium(
            angles, tensions, pulls, slack, residual, iterations, problem.stiff,
            self.laws.held(angles, problem.system.joints, problem.stiff), False, problem.vacuum,
            chain=chain)

    def point_of(self, start: Equilibrium) -> Point:
        """Return a state as a point; raises ValueError for joint angles that are not finite."""
        theta = start.configuration.cumsum()
        if not isfinite(theta[-1]):  # as the last is when any is not
            raise ValueError('the joint angles of the start must be finite numbers')
        return Point(theta, np.nan_to_num(start.tensions),
                     self.chain.straight_paths - start.pulls, slack=start.slack)

    def newton(self, start: Point, problem: Problem, target: Array | None = None,
               bias: Array | None = None, damping: float = 0.0) -> Point:
        """
        Return where Newton's method ends from ``start``.

        target: (2,) in place of that of the problem.  bias, damping: as in _newton.newton.
        """
        state = State(start.theta.copy(), start.tension.copy(), np.empty(2))
        drive = problem.drive if target is None else problem.drive._replace(target=target)
        status, iterations, residual, turned = _kernel.functions().newton(
            tuple(state), tuple(problem.system), tuple(drive),
            np.zeros(problem.groups) if bias is None else bias, damping, problem.tolerance)
        return Point(*state, status, residual, iterations, turned)

    def result(self, point: Point, problem: Problem, jumped: bool = False) -> Equilibrium:
        """Return a solved point as an Equilibrium."""
        slack = _slack(point, problem.drive)
        angles = joint_angles(point.theta)
        if problem.groups < self.chain.bodies:  # locked joints keep theirs to the last bit
            group = problem.system.group
            free = group > np.append(-1, group[:-1])
            angles = np.where(free, angles, problem.locked_angles)
        return Equilibrium(
            angles, point.tension, self.chain.straight_paths - point.lengths, slack,
            point.residual, point.iterations, problem.stiff,
            self.laws.held(angles, problem.system.joints, problem.stiff), jumped, problem.vacuum,
            chain=self.chain)

    def _step(self, point: Point, problem: Problem) -> tuple[Point, Problem, bool]:
        """Reach the equilibrium in one step or in small ones; return also whether it jumped."""
        end = self.newton(point, problem)
        if problem.reached_by(end):
            return end, problem, False
        return self._reach(point, problem)

    def _reach(self, point: Point, problem: Problem) -> tuple[Point, Problem, bool]:
        """
        Follow the direct path to the target, or a detour where the direct path ends in a jump.

        On the direct path the dead moments fade while the tendons move, and both may be too short
        where one is paid out and the other pulled in.  On the detours moments fade first; then
        both move, or one is paid out first.
        """
        drive, gap = problem.drive, self._gap(point, problem)
        found, failed = None, None
        begin, paid_out = drive.target + gap, drive.target + np.maximum(gap, 0.0)
        lengths, over = bool(np.all(drive.mode == LENGTH)), gap.min() < 0.0 < gap.max()
        for way, may_help in (([drive.target], True),
                              ([begin, drive.target], lengths),
                              ([begin, paid_out, drive.target], lengths and over)):
            if not may_help or (failed and not over):
                continue
            end, there, jumped = point, problem, False
            try:
                for target in way:
                    there = there._replace(drive=drive._replace(target=target))
                    direct = self.newton(end, there)
                    if there.reached_by(direct):
                        end = direct._replace(slack=_slack(direct, there.drive))
                        continue
                    end, there, also = self.follow(end, there)
                    jumped = jumped or also
            except StaticsError as error:
                failed = failed or error
                continue
            if not jumped:
                return end, there, False
            found = found or (end, there, True)
        if found is None:
            assert failed is not None
            raise failed
        return found

    def _with_friction(self, point: Point, problem: Problem, sliding: Sequence[int]
                       ) -> tuple[Point, Problem, bool]:
        """Iterate the loss of tension at the guides, which depends on the shape it leads to."""
        jumped = False
        for _ in range(MAX_FRICTION_ITERATIONS):
            before = problem.system.ratios
            problem = problem.with_friction(
                self.chain, joint_angles(point.theta), sliding)
            change = np.abs(problem.system.ratios - before).max()
            point, problem, also = self._step(point, problem)
            jumped = jumped or also
            if change < 1e-13:
                return point, problem, jumped
        raise StaticsError('the friction at the guides did not converge',
                           self.result(point, problem))

    def follow(self, point: Point, problem: Problem) -> tuple[Point, Problem, bool]:
        """
        Follow the equilibrium from ``point`` in small steps.

        Unbalanced moments at the start are balanced by dead moments that fade on the way, while
        the tendons go from their present lengths to their targets.  The held shape of a yielding
        jam creeps.  Also returns the problem after creep and whether the arm jumped.
        """
        drive = problem.drive
        tension = np.where(np.isinf(drive.target), 0.0, point.tension)
        unbalanced = -_kernel.functions().moment_balance(
            point.theta, tension, tuple(problem.system), problem.groups)
        gap = self._gap(point, problem)
        point = Point(point.theta, tension, point.lengths)
        done, step, jumped, iterations = 0.0, 0.5, False, 0
        while done < 1.0:
            reached = min(1.0, done + step)
            target = drive.target + (1.0 - reached) * gap
            end = self.newton(point, problem, target, (1.0 - reached) * unbalanced)
            iterations += end.iterations
            if problem.reached_by(end):
                point, done, step = end, reached, 2.0 * step
            elif step > MIN_STEP:
                step *= 0.5
            else:  # the path has ended: drop the dead moments, and see where the arm moves to
                unbalanced = np.zeros(problem.groups)
                point = self._jump(point, problem, target)
                iterations += point.iterations
                done, jumped = reached, True
            if iterations > MAX_TOTAL_ITERATIONS:
                raise StaticsError(f'not converged after {iterations} iterations',
                                   self.result(point, problem))
            problem = problem._replace(system=problem.system._replace(
                joints=self.laws.plastic_update(joint_angles(point.theta), problem.system.joints)))
        return point._replace(iterations=iterations, slack=_slack(point, drive)), problem, jumped

    def _gap(self, point: Point, problem: Problem) -> Array:
        """Return the distance of each driven tendon (or angle) from its target at the start."""
        drive, gap = problem.drive, np.zeros(2)
        for t in (RIGHT, LEFT):
            tension = point.tension[t]
            if drive.mode[t] == ANGLE:
                last = self.chain.last_body
                angles = joint_angles(point.theta[last])
                gap[t] = angles[drive.segment[t]] - drive.target[t]
            elif drive.mode[t] == TENSION:
                gap[t] = tension - drive.target[t]
            elif np.isfinite(drive.target[t]):
                gap[t] = point.lengths[t] - drive.compliance[t] * tension - drive.target[t]
                if point.slack is not None and np.isfinite(point.slack[t]):
                    gap[t] += point.slack[t]
                if tension <= 0.0:
                    gap[t] = max(gap[t], 0.0)
        return gap

    def _jump(self, begin: Point, problem: Problem, target: Array) -> Point:
        """
        Return the stable equilibrium that the arm moves to from where its path ended.

        A straight arm between two taut tendons without tension has no descent direction: then
        the search begins at a small wave, to either side in turn.
        """
        mode, side = problem.drive.mode, _side(begin, target)
        starts = [] if np.any(mode == ANGLE) else [begin]
        if np.all(mode == LENGTH) and np.all(begin.lengths > target - TAUT_TOLERANCE):
            wave = np.cos(2.0 * np.pi * np.arange(problem.groups) / self.chain.joints_per_segment)
            waves = [_turned(begin, problem, side * size * wave)
                     for size in BUCKLING_PERTURBATIONS]
            starts = waves + starts if begin.tension.max() <= NO_TENSION else starts + waves
        for start in starts:
            found = self._relax(start, problem, target, side)
            if found is not None:
                return found
        raise self._failure(begin, problem, target)

    def _relax(self, begin: Point, problem: Problem, target: Array, side: float
               ) -> Point | None:
        """Return the stable equilibrium where an overdamped motion from ``begin`` ends, if any."""
        no_bias = np.zeros(problem.groups)
        point, iterations = begin, 0
        damping = float(self.chain.joint_stiffness.max())
        # Where the arm rests on a ridge: a perturbation without symmetry, to either side in turn.
        perturbation = side * 1e-5 * (1.5 + np.cos(np.arange(problem.groups)))
        while iterations < MAX_TOTAL_ITERATIONS:
            end = self.newton(point, problem, target, no_bias, damping)
            iterations += end.iterations
            moved = float(np.abs(end.theta - point.theta).max())
            if end.status != _newton.CONVERGED or moved > MAX_MOTION:
                damping *= 4.0
                if damping > MAX_DAMPING:
                    break
                continue
            point = end
            if np.abs(joint_angles(point.theta)).max() > np.pi:
                break  # wound up: bodies would pass through each other
            damping /= 2.0
            if moved < SLOW_MOTION:
                final = self.newton(point, problem, target, no_bias)
                iterations += final.iterations
                away = float(np.abs(final.theta - point.theta).max())
                if final.status == _newton.CONVERGED and away < AT_REST:
                    return final._replace(iterations=iterations)
                if final.status == _newton.UNSTABLE and away < 1e-4:
                    point = _turned(final, problem, perturbation)
                    perturbation *= -2.0
                    damping = float(self.chain.joint_stiffness.max())
        return None

    def _failure(self, point: Point, problem: Problem, target: Array) -> StaticsError:
        state, drive = self.result(point, problem), problem.drive
        if np.any(drive.mode == ANGLE):
            return StaticsError('no equilibrium was found at that angle', state)
        if np.any(drive.mode == TENSION):
            return StaticsError('no stable equilibrium found near the present shape', state)
        straight = self.chain.straight_paths[0]
        path = (f'{self._pulls_text(straight - drive.target)}; the path to them ends at '
                f'{self._pulls_text(straight - target)}; ')
        if self._too_short(point, problem, target):
            return OverconstrainedError(
                'no shape of the soft segments near the present one has tendons as short as these '
                f'pulls require: {path}pay out a tendon', state)
        return StaticsError(
            f'no stable equilibrium was found on the way to these pulls: {path}one may exist; '
            'pull in smaller steps, or one tendon after the other', state)

    def _too_short(self, point: Point, problem: Problem, target: Array) -> bool:
        """
        Return whether the tendons cannot be as short as commanded.

        This is so where the spans along locked segments alone are longer, or where no turn of
        the rigid groups shortens all tendons that are too long.
        """
        drive, group, free = problem.drive, problem.system.group, problem.system.group >= 0
        guides = self.chain.guide_points(joint_angles(point.theta))
        spans = np.linalg.norm(np.diff(guides, axis=1), axis=2)[:, 1::2]
        disc = group[self.chain.last_body]
        locked = disc == np.insert(disc[:-1], 0, -1)
        if np.any((drive.compliance == 0) & (drive.target <= spans[:, locked].sum(axis=1))):
            return True
        slopes = np.zeros((2, problem.groups))
        for k in range(problem.groups):
            there, back = (self.chain.paths(joint_angles(
                point.theta + np.where(free & (group == k), turn, 0.0)))
                for turn in (1e-6, -1e-6))
            slopes[:, k] = (there - back) / 2e-6
        long = slopes[(point.lengths > target - TAUT_TOLERANCE) & (drive.compliance == 0)]
        sizes = np.linalg.norm(long, axis=1)
        if np.any(sizes < DEGENERATE * self.chain.guides.max()):
            return True
        return len(long) == 2 and bool(
            np.linalg.norm((long / sizes[:, None]).sum(axis=0)) < DEGENERATE)

    def _pulls_text(self, pulls: Array) -> str:
        return ', '.join(
            f'{name} slack' if pull == SLACK else f'{name} {pull * 1e3:.2f} mm'
            for name, pull in zip(self.chain.arm.tendon_names, pulls, strict=True))


def joint_angles(theta: Array) -> Array:
    """Return the angles of the joints below bodies at theta; np.diff takes 7 times as long."""
    angles = theta.copy()
    angles[1:] -= theta[:-1]
    return angles


def _slack(point: Point, drive: TendonDrive) -> Array:
    """Return the slack of each tendon without tension, (2,) m."""
    slack = np.zeros(2)
    for t in (RIGHT, LEFT):
        if drive.mode[t] == LENGTH and point.tension[t] <= 0.0:
            slack[t] = max(drive.target[t] - point.lengths[t], 0.0)
    return slack


def _side(point: Point, target: Array) -> float:
    """
    Return 1 or -1: the side to which an arm at an unstable balance falls.

    It is the side to which it leans, or else that of the shorter tendon, so that mirror images
    behave alike.
    """
    lean = float(point.theta.sum())
    if abs(lean) <= LENGTH_TOLERANCE:
        right, left = (point.lengths - target).tolist()
        lean = right - left  # nan where both are slack for good
    return -1.0 if lean < -LENGTH_TOLERANCE else 1.0


def _turned(point: Point, problem: Problem, turn: Array) -> Point:
    """Return the point with its rigid groups turned by ``turn`` (groups,), rad."""
    group = problem.system.group
    return point._replace(theta=point.theta + np.where(group >= 0, turn[group], 0.0))
