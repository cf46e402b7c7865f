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
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from soft_continuum.mechanics import _newton
from soft_continuum.mechanics.arm import Arm, Disc, Segment
from soft_continuum.mechanics.chain import Array, Equilibrium, LEFT, RIGHT, RigidChain

SLACK = -np.inf
"""A pull that leaves the tendon slack in every shape."""

RESIDUAL_LIMIT = 1e-10  # N m
DIRECT_LIMIT = 0.8  # rad: a segment that turned further is followed in smaller steps
SMALLEST_STEP = 1e-4  # of the way, before the path is taken to have ended
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


@dataclass(frozen=True)
class _Boundary:
    """What is free and what drives the tendons in one solve, in the compiled form."""

    group: NDArray[np.int64]
    groups: int
    mode: NDArray[np.int64]
    target: Array
    driven: NDArray[np.int64]


@dataclass(frozen=True)
class _Point:
    """A state on the way: absolute angles, tensions, and how the solve for it ended."""

    theta: Array
    tension: Array
    lengths: Array
    status: int = _newton.FAILED
    residual: float = np.inf
    iterations: int = 0


class Statics:
    """
    Equilibria of one arm.

    ``soft`` masks have one flag per segment; a stiff segment keeps the shape it has in the state
    the solve starts from (paper, III-A: stiff segments are rigid).
    """

    def __init__(self, arm: Arm) -> None:
        """Discretise ``arm`` and prepare the arrays of the solver."""
        self.chain = RigidChain(arm)
        chain = self.chain
        self._bodies = np.column_stack([chain.body_lengths, chain.load_coefficients])
        self._joints = np.zeros((chain.joints, 7))
        self._joints[:, 0] = chain.joint_stiffness
        self._joints[:, [1, 3]] = -1.0
        self._joints[:, 5] = np.inf
        self._joints[:, 6] = np.repeat(
            [s.length / chain.joints_per_segment for s in arm.segments], chain.joints_per_segment)
        self._tables = np.zeros((1, 2, 2))
        self._ratios = np.ones((2, chain.segments))
        self._compliance = np.zeros(2)
        self._groups = cache(self._find_groups)

    def solve(self, start: Equilibrium, pulls: ArrayLike,
              soft: Sequence[bool]) -> Equilibrium:
        """
        Return the equilibrium for given pulls, followed from ``start``.

        pulls: (right, left) in m, how much shorter each tendon is than in the straight arm;
        negative is let out, SLACK never carries.  soft: one flag per segment.

        Raises OverconstrainedError when no shape has tendons that short, StaticsError when no
        equilibrium was found, ValueError for input of the wrong size or nan.
        """
        target = np.array(pulls, dtype=float)
        if target.shape != (2,) or np.isnan(target).any() or (target == np.inf).any():
            raise ValueError(f'pulls must be two numbers in m (right, left); given: {pulls!r}')
        boundary = self._boundary(soft, self.chain.straight_length - target)
        if boundary.groups == 0:
            return self._locked(start, boundary.target)
        return self._find(start, boundary)

    def bend(self, start: Equilibrium, segment: int, angle: float,
             soft: Sequence[bool] | None = None) -> Equilibrium:
        """
        Return the equilibrium in which ``segment`` (0-based) has bending angle ``angle`` (rad).

        One tendon carries it, whichever the loads ask for, and the other follows without tension;
        the pulls of both paths are in the result.  Only ``segment`` is soft unless ``soft`` says
        otherwise.  Raises StaticsError when no tendon holds the arm there in a stable way.
        """
        mask = [i == segment for i in range(self.chain.segments)] if soft is None else list(soft)
        if not 0 <= segment < self.chain.segments or not mask[segment]:
            raise ValueError(f'segment index {segment} is not one of the soft segments {mask}')
        if not np.isfinite(angle):
            raise ValueError(f'the bending angle must be a finite number in rad; given: {angle}')
        for tendon in (RIGHT, LEFT):
            boundary = self._boundary(mask, np.full(2, np.inf))
            boundary.mode[tendon] = _newton.ANGLE
            boundary.driven[tendon] = segment
            boundary.target[tendon] = angle
            found = self._find(start, boundary)
            if found.tensions[tendon] >= 0.0:
                return self._hold(found, mask)
        raise StaticsError(
            f'no tendon holds segment {segment + 1} at {np.degrees(angle):.1f} degrees: '
            'both would have to push', start)

    def _hold(self, found: Equilibrium, soft: Sequence[bool]) -> Equilibrium:
        """Check that a state found by its bending angle is stable with its tendons' lengths."""
        pulls = np.where(found.tensions > 0.0, found.pulls, SLACK)
        target = self.chain.straight_length - pulls
        boundary = self._boundary(soft, target)
        point = self._newton(self._start(found), boundary, target, np.zeros(boundary.groups))
        if point.status != _newton.CONVERGED:
            raise StaticsError(
                'the tendons can bend the arm to this shape but not hold it there: the '
                'equilibrium is not stable', found)
        return self._result(point, boundary)

    def _boundary(self, soft: Sequence[bool], target: Array) -> _Boundary:
        if len(soft) != self.chain.segments:
            raise ValueError(f'{len(soft)} soft flags given, the arm has '
                             f'{self.chain.segments} segments')
        group, groups = self._groups(tuple(bool(s) for s in soft))
        return _Boundary(group, groups, np.zeros(2, dtype=np.int64), target,
                         np.zeros(2, dtype=np.int64))

    def _find_groups(self, soft: tuple[bool, ...]) -> tuple[NDArray[np.int64], int]:
        """Number the rigid groups: every body of a soft segment with what is locked onto it."""
        free = np.repeat(soft, self.chain.joints_per_segment)
        return np.cumsum(free) - 1, int(free.sum())

    def _start(self, start: Equilibrium) -> _Point:
        return _Point(np.cumsum(start.joint_angles), np.nan_to_num(start.tensions),
                      self.chain.straight_length - start.pulls)

    def _newton(self, start: _Point, boundary: _Boundary, target: Array, bias: Array,
                damping: float = 0.0) -> _Point:
        theta, tension, lengths = start.theta.copy(), start.tension.copy(), np.empty(2)
        status, iterations, residual, _ = _newton.newton(
            theta, tension, self._bodies, self._joints, self._tables, self.chain.guides,
            self._ratios, boundary.group, boundary.mode, target, self._compliance,
            boundary.driven, bias, damping, RESIDUAL_LIMIT, lengths)
        return _Point(theta, tension, lengths, status, residual, iterations)

    def _near(self, start: _Point, end: _Point) -> bool:
        """Whether a solve converged to a minimum that is plausibly the next one on the path."""
        if end.status != _newton.CONVERGED:
            return False
        turned = (end.theta - start.theta)[self.chain.last_joint]
        return float(np.abs(np.diff(turned, prepend=0.0)).max()) <= DIRECT_LIMIT

    def _find(self, start: Equilibrium, boundary: _Boundary) -> Equilibrium:
        point = self._start(start)
        end = self._newton(point, boundary, boundary.target, np.zeros(boundary.groups))
        if self._near(point, end):
            return self._result(end, boundary)
        return self._follow(point, boundary)

    def _follow(self, point: _Point, boundary: _Boundary) -> Equilibrium:
        """
        Follow the equilibrium from the start in small steps.

        The moments that the start leaves unbalanced are held by dead moments that fade on the
        way, while the tendons go from the lengths they have to the lengths asked for.
        """
        tension = np.where(np.isinf(boundary.target), 0.0, point.tension)
        unbalanced = -_newton.moment_balance(
            point.theta, tension, self._bodies, self._joints, self._tables, self.chain.guides,
            self._ratios, boundary.group, boundary.groups)
        gap = self._gap(point, boundary, tension)
        point = _Point(point.theta, tension, point.lengths)
        done, step, jumped, iterations = 0.0, 0.5, False, 0
        while done < 1.0:
            reached = min(1.0, done + step)
            target = boundary.target + (1.0 - reached) * gap
            bias = (1.0 - reached) * unbalanced
            end = self._newton(point, boundary, target, bias)
            iterations += end.iterations
            if self._near(point, end):
                point, done, step = end, reached, 2.0 * step
            elif step > SMALLEST_STEP:
                step *= 0.5
            else:
                point = self._relax(point, boundary, target, bias)
                iterations += point.iterations
                done, jumped = reached, True
        return self._result(point, boundary, iterations=iterations, jumped=jumped)

    def _gap(self, point: _Point, boundary: _Boundary, tension: Array) -> Array:
        """Return how far each driven tendon (or angle) is from its target at the start."""
        gap = np.zeros(2)
        for t in (RIGHT, LEFT):
            if boundary.mode[t] == _newton.ANGLE:
                last = self.chain.last_joint
                angles = np.diff(point.theta[last], prepend=0.0)
                gap[t] = angles[boundary.driven[t]] - boundary.target[t]
            elif np.isfinite(boundary.target[t]):
                over = point.lengths[t] - boundary.target[t]
                gap[t] = over if tension[t] > 0.0 else max(over, 0.0)
        return gap

    def _relax(self, point: _Point, boundary: _Boundary, target: Array, bias: Array) -> _Point:
        """Move, overdamped, from where the path ended to the next stable equilibrium."""
        damping = float(self.chain.joint_stiffness.max())
        # A push that has no symmetry, in case the state rests exactly on the ridge.
        push = 1e-5 * (1.5 + np.cos(np.arange(boundary.groups)))
        theta = point.theta + np.where(boundary.group >= 0, push[boundary.group], 0.0)
        point = _Point(theta, point.tension, point.lengths)
        iterations = 0
        for _ in range(2000):
            end = self._newton(point, boundary, target, bias, damping)
            iterations += end.iterations
            moved = float(np.abs(end.theta - point.theta).max())
            if end.status != _newton.CONVERGED or moved > 0.3:
                damping *= 4.0
                if damping > 1e9:
                    break
                continue
            point = end
            damping /= 2.0
            if moved < 0.02:
                final = self._newton(point, boundary, target, bias)
                iterations += final.iterations
                if (final.status == _newton.CONVERGED
                        and np.abs(final.theta - point.theta).max() < 0.1):
                    return _Point(final.theta, final.tension, final.lengths, final.status,
                                  final.residual, iterations)
        raise self._failure(point, boundary, target)

    def _failure(self, point: _Point, boundary: _Boundary, target: Array) -> StaticsError:
        state = self._result(point, boundary)
        over = point.lengths - target
        if np.any(over > -1e-4) and np.any(boundary.mode == _newton.LENGTH):
            pulls = self.chain.straight_length - target
            return OverconstrainedError(
                f'no shape of the soft segments has tendons as short as pulls of right '
                f'{pulls[RIGHT] * 1e3:.2f} mm and left {pulls[LEFT] * 1e3:.2f} mm ask for; '
                'let one of them out', state)
        return StaticsError('no stable equilibrium found near the present shape', state)

    def _locked(self, start: Equilibrium, target: Array) -> Equilibrium:
        """Return the state of an arm without a soft segment: only the slack can change."""
        lengths = self.chain.straight_length - start.pulls
        over = lengths - target
        if np.any(over > LOCKED_TOLERANCE):
            raise OverconstrainedError(
                f'every segment is stiff and tendons right, left would have to be '
                f'{over[RIGHT] * 1e3:.3f}, {over[LEFT] * 1e3:.3f} mm shorter than they are; '
                'soften a segment first', start)
        slack = np.maximum(-over, 0.0)
        tensions = np.where(slack > LOCKED_TOLERANCE, 0.0, np.nan)
        return Equilibrium(start.joint_angles, tensions, start.pulls, slack, 0.0, 0)

    def _result(self, point: _Point, boundary: _Boundary, iterations: int | None = None,
                jumped: bool = False) -> Equilibrium:
        slack = np.zeros(2)
        for t in (RIGHT, LEFT):
            if boundary.mode[t] == _newton.LENGTH and point.tension[t] <= 0.0:
                slack[t] = max(0.0, boundary.target[t] - point.lengths[t])
        return Equilibrium(
            np.diff(point.theta, prepend=0.0), point.tension,
            self.chain.straight_length - point.lengths, slack, point.residual,
            point.iterations if iterations is None else iterations, jumped)


def warm_up() -> None:
    """
    Compile the solver, or load it compiled, now rather than in the first solve.

    It takes some seconds once, and a fraction of a second later.
    """
    segment = Segment(length=0.1, bending_stiffness=0.01, guide_offsets=(0.02, 0.02))
    statics = Statics(Arm((segment,), (Disc(0.01), Disc(0.01)), bodies_per_segment=1))
    straight = statics.chain.straight()
    boundary = statics._boundary([True], np.full(2, np.inf))
    statics._follow(statics._start(straight), boundary)
