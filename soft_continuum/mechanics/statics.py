# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Statics of the arm: the shape in which springs, weights and tendons balance.

The paper integrates its multibody model for 10 s with a backward Euler solver and uses the end
state only.  Here that end state is solved for: a minimum of the potential energy under the lengths
of the two tendons, whose multipliers are the tensions (a tendon pulls or is slack).

Equilibria depend on the path, so every solve starts from the state before and is continued in
small steps when a full step does not arrive close by.  Where the path ends (a segment folds over)
an overdamped backward-Euler motion finds the next stable equilibrium.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from math import isfinite

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import eigvalsh_tridiagonal

from soft_continuum.mechanics import _assembly, _newton
from soft_continuum.mechanics._boundary import (
    Boundary,
    CAREFUL_LIMIT,
    DIRECT_LIMIT,
    NO_TENSION,
    Point,
)
from soft_continuum.mechanics._checks import sliding_signs, soft_flags, vacuum_parts, whole
from soft_continuum.mechanics.arm import Arm, Disc, Segment
from soft_continuum.mechanics.chain import Array, Equilibrium, LEFT, RIGHT, RigidChain
from soft_continuum.mechanics.joints import compliances, JointLaws, tension_ratios

SLACK = -np.inf
"""A pull that leaves the tendon slack in every shape."""

WAVES = (1e-3, -2e-3, 4e-3, -8e-3, 0.016, -0.032)  # rad, from which a straight arm buckles
SMALLEST_STEP = 1e-4  # of the way, before the path is taken to have ended
MOST_ITERATIONS = 20000  # of Newton's method in one solve, before it is given up
LOCKED_TOLERANCE = 1e-6  # m: rounding of a pull against a locked arm


class StaticsError(RuntimeError):
    """
    No equilibrium was found.

    ``state`` is the last equilibrium on the way; nothing beyond it was accepted.
    """

    def __init__(self, message: str, state: Equilibrium) -> None:
        """Keep the state at which the search ended."""
        super().__init__(message)
        self.state = state


class OverconstrainedError(StaticsError):
    """The tendons are pulled shorter than any shape of the soft segments allows."""


class Statics:
    """
    Equilibria of one arm.

    ``soft`` masks have one flag per segment.  Softening returns the springs of a segment to their
    natural shape.  Stiffening locks it (paper, III-A) or, with a Jam of finite stiffness, adds
    the jam's springs about the shape at which it was stiffened; either way it moves nothing.
    """

    def __init__(self, arm: Arm) -> None:
        """Discretise ``arm`` and prepare the arrays of the solver."""
        self.chain = RigidChain(arm)
        self.laws = JointLaws(self.chain)
        self._bodies = np.column_stack([self.chain.body_lengths, self.chain.load_coefficients])
        rope = (self.chain.straight_length + sum(d.height for d in arm.discs)
                + arm.tendon.free_length)
        self.compliance = compliances(self.chain, np.zeros(self.chain.joints), (0, 0))
        # 1e-11 N m and 1e-13 m, or what rounding allows for very stiff or very long arms.
        stiffest = float(self.chain.joint_stiffness.max())
        self.tolerance = np.array([max(1e-11, 1e-14 * stiffest), max(1e-10, 1e-13 * stiffest),
                                   max(1e-13, 1e-15 * rope)])
        self._no_friction = np.ones((2, self.chain.segments))
        self._groups = cache(self._find_groups)

    def solve(self, start: Equilibrium, pulls: ArrayLike, soft: Sequence[bool], *,
              vacuum: Sequence[float] | None = None, sliding: Sequence[int] = (0, 0)
              ) -> Equilibrium:
        """
        Return the equilibrium for given pulls, followed from ``start``.

        pulls: (right, left) in m, how much shorter each tendon is than in the straight arm;
        negative is let out, SLACK never carries.  soft: one flag per segment.  vacuum: of each
        stiff segment, 0 to 1 of full vacuum (default: full); without any it is soft, and a rigid
        one knows no other parts.  sliding: of each tendon through its guides, for friction: 1
        towards the base, -1 towards the tip, 0 frictionless.

        Raises OverconstrainedError when no shape has tendons that short, StaticsError when no
        equilibrium was found, ValueError for input of the wrong size or nan.
        """
        target = np.array(pulls, dtype=float)
        if target.shape != (2,) or not all(pull < np.inf for pull in target.tolist()):
            raise ValueError(f'pulls must be two numbers in m (right, left); given: {pulls!r}')
        boundary = self._boundary(start, soft, self.chain.straight_length - target, vacuum)
        if boundary.groups == 0:
            return self._locked(start, boundary.target, boundary.stiff)
        return self._find(start, boundary, sliding)

    def solve_tensions(self, start: Equilibrium, tensions: ArrayLike, soft: Sequence[bool], *,
                       vacuum: Sequence[float] | None = None, sliding: Sequence[int] = (0, 0)
                       ) -> Equilibrium:
        """
        Return the equilibrium for given tensions (right, left), N >= 0, followed from ``start``.

        The other arguments and errors are those of ``solve``.
        """
        target = np.array(tensions, dtype=float)
        if target.shape != (2,) or not np.all(np.isfinite(target)) or np.any(target < 0.0):
            raise ValueError('tensions must be two numbers in N, not negative (right, left); '
                             f'given: {tensions!r}')
        boundary = self._boundary(start, soft, target, vacuum)
        boundary.mode[:] = _newton.TENSION
        if boundary.groups == 0:
            return Equilibrium(start.joint_angles, target, start.pulls, np.zeros(2), 0.0, 0,
                               boundary.stiff, start.joint_angles)
        return self._find(start, boundary, sliding)

    def bend(self, start: Equilibrium, segment: int, angle: float,
             soft: Sequence[bool] | None = None, *, vacuum: Sequence[float] | None = None,
             sliding: Sequence[int] = (0, 0)) -> Equilibrium:
        """
        Return the equilibrium in which ``segment`` (0-based) has bending angle ``angle`` (rad).

        One tendon carries it, whichever the loads ask for, and the other follows without tension;
        the pulls of both paths are in the result.  Only ``segment`` is soft unless ``soft`` says
        otherwise.  vacuum: as in ``solve``, but by default that of ``start``.  sliding: as in
        ``solve``.  Raises StaticsError when no tendon holds the arm there in a stable way.
        """
        mask = soft_flags([i == segment for i in range(self.chain.segments)]
                          if soft is None else soft, self.chain.segments)
        if not (whole(segment) and 0 <= segment < self.chain.segments and mask[segment]):
            raise ValueError(f'segment index {segment} is not one of the soft segments; '
                             f'soft: {list(mask)}')
        if vacuum is None:
            vacuum = start.vacuum or None
        if not np.isfinite(angle):
            raise ValueError(f'the bending angle must be a finite number in rad; given: {angle}')
        reasons = []
        # What the tendons carried before may be far too much for the segment that is soft now.
        start = replace(start, tensions=np.zeros(2))
        for tendon in (RIGHT, LEFT):
            boundary = self._boundary(start, mask, np.full(2, np.inf), vacuum)
            boundary.mode[tendon] = _newton.ANGLE
            boundary.driven[tendon] = segment
            boundary.target[tendon] = angle
            try:
                found = self._find(start, boundary, sliding)
                if found.tensions[tendon] >= -NO_TENSION:
                    return self._hold(found, mask, vacuum, sliding)
                reasons.append('it would have to push')
            except StaticsError as error:
                reasons.append(str(error))
        raise StaticsError(
            f'no tendon holds segment {segment + 1} at {np.degrees(angle):.1f} degrees '
            f'(right: {reasons[RIGHT]}; left: {reasons[LEFT]})', start)

    def commanded_pulls(self, state: Equilibrium, sliding: Sequence[int] = (0, 0)) -> Array:
        """Return the pulls (2,) m at the steppers that give a state: its paths and stretch."""
        compliance = compliances(self.chain, state.joint_angles, sliding_signs(sliding))
        pulls: Array = state.pulls + compliance * np.nan_to_num(state.tensions)
        return pulls

    def _hold(self, found: Equilibrium, soft: Sequence[bool], vacuum: Sequence[float] | None,
              sliding: Sequence[int]) -> Equilibrium:
        """Check that a state found by its bending angle is stable with its tendons' lengths."""
        pulls = self.commanded_pulls(found, sliding)
        carries = found.tensions > NO_TENSION
        if carries.any():  # where neither carries, both just taut hold the arm
            pulls = np.where(carries, pulls, SLACK)
        boundary = self._boundary(found, soft, self.chain.straight_length - pulls, vacuum)
        if any(sliding):
            boundary = replace(
                boundary, ratios=tension_ratios(self.chain, found.joint_angles, sliding),
                compliance=compliances(self.chain, found.joint_angles, sliding))
        point = self._newton(self._start(found), boundary)
        if point.status != _newton.CONVERGED:
            raise StaticsError(
                'the tendons can bend the arm to this shape but not hold it there: the '
                'equilibrium is not stable', found)
        return self._result(point, boundary)

    def _boundary(self, start: Equilibrium, soft: Sequence[bool], target: Array,
                  vacuum: Sequence[float] | None = None) -> Boundary:
        segments, flags = self.chain.segments, soft_flags(soft, self.chain.segments)
        parts = vacuum_parts(vacuum, segments)
        if start.joint_angles.shape != (self.chain.joints,) or len(start.stiff) != segments:
            raise ValueError(
                f'the start has {start.joint_angles.size} joints in {len(start.stiff)} segments, '
                f'this arm has {self.chain.joints} in {segments}')
        stiff = tuple(not s for s in flags)
        if parts:  # without any vacuum there is no jam
            stiff = tuple(s and part > 0.0 for s, part in zip(stiff, parts, strict=True))
        group, groups, direct_limit = self._groups(stiff)
        return Boundary(
            group, groups, direct_limit, start.joint_angles,
            self.laws.joints(start, stiff, parts),
            self._no_friction, self.compliance, np.zeros(2, dtype=np.int64),
            target, np.zeros(2, dtype=np.int64), stiff, parts)

    def _find_groups(self, stiff: tuple[bool, ...]) -> tuple[NDArray[np.int64], int, float]:
        """
        Number the rigid groups: every body of a free segment with what is locked onto it.

        Also return how far a segment may turn in one step.  Where the springs outweigh the loads
        in every shape the energy is convex, and no path of an arm with a slack tendon was seen to
        end.
        """
        locked = [s and segment.jam.rigid
                  for s, segment in zip(stiff, self.chain.arm.segments, strict=True)]
        free = np.repeat(np.logical_not(locked), self.chain.joints_per_segment)
        group, groups = np.cumsum(free) - 1, int(free.sum())
        if groups == 0:
            return group, groups, DIRECT_LIMIT
        springs = self.laws.least_stiffness[free]
        worst = np.bincount(group[group >= 0], np.hypot(*self._bodies[group >= 0, 1:].T))
        diagonal = springs + np.append(springs[1:], 0.0) - worst
        least = eigvalsh_tridiagonal(diagonal, -springs[1:], select='i', select_range=(0, 0))[0]
        return group, groups, DIRECT_LIMIT if least > 0.0 else CAREFUL_LIMIT

    def _start(self, start: Equilibrium) -> Point:
        theta = start.joint_angles.cumsum()
        if not isfinite(theta[-1]):  # as the last is when any is not
            raise ValueError('the joint angles of the start must be finite numbers')
        tension = start.tensions
        if not isfinite(tension[0] + tension[1]):
            tension = np.nan_to_num(tension)
        return Point(theta, tension, self.chain.straight_length - start.pulls)

    def _newton(self, start: Point, boundary: Boundary, target: Array | None = None,
                bias: Array | None = None, damping: float = 0.0) -> Point:
        theta, tension, lengths = start.theta.copy(), start.tension.copy(), np.empty(2)
        status, iterations, residual, turned = _newton.newton(
            theta, tension, self._bodies, boundary.joints, self.laws.tables, self.chain.guides,
            boundary.ratios, boundary.group, boundary.mode,
            boundary.target if target is None else target, boundary.compliance, boundary.driven,
            np.zeros(boundary.groups) if bias is None else bias, damping, self.tolerance, lengths)
        return Point(theta, tension, lengths, status, residual, iterations, turned)

    def _find(self, start: Equilibrium, boundary: Boundary,
              sliding: Sequence[int] = (0, 0)) -> Equilibrium:
        sliding = sliding_signs(sliding)
        point = self._start(start)
        end, boundary, jumped = self._step(point, boundary)
        if self.chain.arm.tendon.friction > 0.0 and any(sliding):
            end, boundary, also = self._with_friction(end, boundary, sliding)
            jumped = jumped or also
        return self._result(end, boundary, jumped=jumped)

    def _step(self, point: Point, boundary: Boundary) -> tuple[Point, Boundary, bool]:
        """Go to the boundary's state in one step, or else in small ones; and whether it jumped."""
        end = self._newton(point, boundary)
        if boundary.near(end):
            return end, boundary, False
        return self._follow(point, boundary)

    def _with_friction(self, point: Point, boundary: Boundary, sliding: Sequence[int]
                       ) -> tuple[Point, Boundary, bool]:
        """Iterate the loss of tension at the guides, which depends on the shape it leads to."""
        jumped = False
        for _ in range(100):
            angles = np.diff(point.theta, prepend=0.0)
            ratios = tension_ratios(self.chain, angles, sliding)
            change = np.abs(ratios - boundary.ratios).max()
            boundary = replace(boundary, ratios=ratios,
                               compliance=compliances(self.chain, angles, sliding))
            point, boundary, also = self._step(point, boundary)
            jumped = jumped or also
            if change < 1e-13:
                return point, boundary, jumped
        raise StaticsError('the friction at the guides did not settle',
                           self._result(point, boundary))

    def _follow(self, point: Point, boundary: Boundary) -> tuple[Point, Boundary, bool]:
        """
        Follow the equilibrium from the start in small steps.

        The moments that the start leaves unbalanced are held by dead moments that fade on the
        way, while the tendons go from the lengths they have to the lengths asked for.  The held
        shape of a jam that yields creeps along.
        """
        tension = np.where(np.isinf(boundary.target), 0.0, point.tension)
        unbalanced = -_assembly.moment_balance(
            point.theta, tension, self._bodies, boundary.joints, self.laws.tables,
            self.chain.guides, boundary.ratios, boundary.group, boundary.groups)
        gap = self._gap(point, boundary, tension)
        point = Point(point.theta, tension, point.lengths)
        done, step, jumped, iterations = 0.0, 0.5, False, 0
        while done < 1.0:
            reached = min(1.0, done + step)
            target = boundary.target + (1.0 - reached) * gap
            end = self._newton(point, boundary, target, (1.0 - reached) * unbalanced)
            iterations += end.iterations
            if boundary.near(end):
                point, done, step = end, reached, 2.0 * step
            elif step > SMALLEST_STEP:
                step *= 0.5
            else:  # the path has ended: let go of what was held, and see where the arm moves to
                unbalanced = np.zeros(boundary.groups)
                point = self._relax(point, boundary, target)
                iterations += point.iterations
                done, jumped = reached, True
            if iterations > MOST_ITERATIONS:
                raise StaticsError(f'not settled after {iterations} iterations',
                                   self._result(point, boundary))
            boundary = self._crept(point, boundary)
        return replace(point, iterations=iterations), boundary, jumped

    def _crept(self, point: Point, boundary: Boundary) -> Boundary:
        held = self.laws.crept(np.diff(point.theta, prepend=0.0), boundary.joints)
        if held is boundary.joints:
            return boundary
        return replace(boundary, joints=held)

    def _gap(self, point: Point, boundary: Boundary, tension: Array) -> Array:
        """Return how far each driven tendon (or angle) is from its target at the start."""
        gap = np.zeros(2)
        for t in (RIGHT, LEFT):
            if boundary.mode[t] == _newton.ANGLE:
                last = self.chain.last_joint
                angles = np.diff(point.theta[last], prepend=0.0)
                gap[t] = angles[boundary.driven[t]] - boundary.target[t]
            elif boundary.mode[t] == _newton.TENSION:
                gap[t] = tension[t] - boundary.target[t]
            elif np.isfinite(boundary.target[t]):
                over = (point.lengths[t] - boundary.compliance[t] * tension[t]
                        - boundary.target[t])
                gap[t] = over if tension[t] > 0.0 else max(over, 0.0)
        return gap

    def _relax(self, begin: Point, boundary: Boundary, target: Array) -> Point:
        """
        Move, overdamped, from where the path ended to the next stable equilibrium.

        Both tendons of a straight arm ask for the same, and it has nowhere to begin: then from a
        little wave, to either side in turn.
        """
        starts = [] if np.any(boundary.mode == _newton.ANGLE) else [begin]
        if np.all((boundary.mode == _newton.LENGTH) & (begin.lengths > target + _newton.SHORT)):
            wave = np.cos(2.0 * np.pi * np.arange(boundary.groups) / self.chain.joints_per_segment)
            starts += [self._moved(begin, boundary, size * wave) for size in WAVES]
        for start in starts:
            found = self._settle(start, boundary, target)
            if found is not None:
                return found
        raise self._failure(begin, boundary, target)

    def _moved(self, point: Point, boundary: Boundary, turn: Array) -> Point:
        """Return the point with its rigid groups turned by ``turn``, rad."""
        return replace(point, theta=point.theta + np.where(
            boundary.group >= 0, turn[boundary.group], 0.0))

    def _settle(self, begin: Point, boundary: Boundary, target: Array) -> Point | None:
        """Return the stable equilibrium that an overdamped motion from ``begin`` ends in."""
        no_bias = np.zeros(boundary.groups)
        point, iterations = begin, 0
        damping = float(self.chain.joint_stiffness.max())
        # A push without symmetry, to either side in turn, where the arm rests on a ridge.
        push = 1e-5 * (1.5 + np.cos(np.arange(boundary.groups)))
        while iterations < MOST_ITERATIONS:
            end = self._newton(point, boundary, target, no_bias, damping)
            iterations += end.iterations
            moved = float(np.abs(end.theta - point.theta).max())
            if end.status != _newton.CONVERGED or moved > 0.3:
                damping *= 4.0
                if damping > 1e9:
                    break
                continue
            point = end
            if np.abs(np.diff(point.theta, prepend=0.0)).max() > np.pi:
                break  # wound up: bodies would pass through each other
            damping /= 2.0
            if moved < 0.02:
                final = self._newton(point, boundary, target, no_bias)
                iterations += final.iterations
                away = float(np.abs(final.theta - point.theta).max())
                if final.status == _newton.CONVERGED and away < 0.1:
                    return replace(final, iterations=iterations)
                if final.status == _newton.UNSTABLE and away < 1e-4:
                    point = self._moved(final, boundary, push)
                    push *= -2.0
                    damping = float(self.chain.joint_stiffness.max())
        return None

    def _failure(self, point: Point, boundary: Boundary, target: Array) -> StaticsError:
        state = self._result(point, boundary)
        if np.any(boundary.mode == _newton.ANGLE):
            return StaticsError('the way to that angle ends before it', state)
        over = point.lengths - target
        if np.any(over > -1e-4) and np.any(boundary.mode == _newton.LENGTH):
            straight = self.chain.straight_length
            right, left, *got = (
                'slack' if p == SLACK else f'{p * 1e3:.2f} mm'
                for p in (*(straight - boundary.target), *(straight - target)))
            return OverconstrainedError(
                f'no shape of the soft segments has tendons as short as pulls of right {right} '
                f'and left {left} ask for; the way to them ends at right {got[0]}, left {got[1]}; '
                'let one of them out', state)
        return StaticsError('no stable equilibrium found near the present shape', state)

    def _locked(self, start: Equilibrium, target: Array,
                stiff: tuple[bool, ...]) -> Equilibrium:
        """Return the state of an arm without a soft segment: only the slack can change."""
        lengths = self.chain.straight_length - start.pulls
        over = lengths - target
        if self.compliance.any():  # stretch takes up what the shape cannot
            return Equilibrium(start.joint_angles, np.maximum(over, 0.0) / self.compliance,
                               start.pulls, np.maximum(-over, 0.0), 0.0, 0, stiff,
                               start.joint_angles)
        if np.any(over > LOCKED_TOLERANCE):
            raise OverconstrainedError(
                f'every segment is stiff and tendons right, left would have to be '
                f'{over[RIGHT] * 1e3:.3f}, {over[LEFT] * 1e3:.3f} mm shorter than they are; '
                'soften a segment first', start)
        slack = np.maximum(-over, 0.0)
        tensions = np.where(slack > LOCKED_TOLERANCE, 0.0, np.nan)
        return Equilibrium(start.joint_angles, tensions, start.pulls, slack, 0.0, 0, stiff,
                           start.joint_angles)

    def _result(self, point: Point, boundary: Boundary, jumped: bool = False) -> Equilibrium:
        slack = np.zeros(2)
        for t in (RIGHT, LEFT):
            if boundary.mode[t] == _newton.LENGTH and point.tension[t] <= 0.0:
                slack[t] = max(0.0, boundary.target[t] - point.lengths[t])
        angles = point.theta.copy()
        angles[1:] -= point.theta[:-1]
        if boundary.groups < self.chain.joints:  # locked joints keep theirs to the last bit
            free = np.diff(boundary.group, prepend=-1) > 0
            angles = np.where(free, angles, boundary.locked_angles)
        return Equilibrium(
            angles, point.tension, self.chain.straight_length - point.lengths, slack,
            point.residual, point.iterations, boundary.stiff,
            self.laws.held(angles, boundary.joints, boundary.stiff), jumped, boundary.vacuum)


def warm_up() -> None:
    """
    Compile the solver, or load it compiled, now rather than in the first solve.

    It takes some seconds once, and a fraction of a second later.
    """
    segment = Segment(length=0.1, bending_stiffness=0.01, guide_offsets=(0.02, 0.02))
    statics = Statics(Arm((segment,), (Disc(0.01), Disc(0.01)), bodies_per_segment=1))
    straight = statics.chain.straight()
    boundary = statics._boundary(straight, [True], np.full(2, np.inf))
    statics._follow(statics._start(straight), boundary)
