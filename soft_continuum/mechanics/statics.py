# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Statics of the arm: the shape in which springs, weights and tendons balance.

The paper integrates its multibody model for 10 s with a backward Euler solver and uses the end
state only.  Here that end state is solved for: a minimum of the potential energy under the lengths
of the two tendons, whose Lagrange multipliers are the tensions (a tendon pulls or is slack).

Equilibria depend on the path, so every solve starts from the state before it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from soft_continuum.mechanics import _kernel, _newton
from soft_continuum.mechanics._active_set import NO_TENSION
from soft_continuum.mechanics._arrays import ANGLE, BOTH_LENGTHS, Drive, Indices, System, TENSION
from soft_continuum.mechanics._checks import (
    check_start,
    finite,
    pulls_of,
    sliding_signs,
    soft_flags,
    tensions_of,
    vacuum_parts,
    whole,
)
from soft_continuum.mechanics._continuation import Continuation
from soft_continuum.mechanics._problem import Problem, TURN_LIMIT, TURN_LIMIT_NOT_CONVEX
from soft_continuum.mechanics.arm import Arm
from soft_continuum.mechanics.chain import Array, Equilibrium, LEFT, RIGHT, RigidChain, SLACK
from soft_continuum.mechanics.errors import OverconstrainedError, StaticsError
from soft_continuum.mechanics.joints import compliances, JointLaws, outweigh

__all__ = ['SLACK', 'SLACK_ALLOWANCE', 'OverconstrainedError', 'Statics', 'StaticsError',
           'warm_up']

UNMOVED = (0, 0)  # how tendons slide where nothing is said of it
LOCKED_TOLERANCE = 1e-6  # m: rounding of a pull against a locked arm
SLACK_ALLOWANCE = 1e-4
"""m of pull that rope and guides absorb; the model's inextensible tendons would buckle the arm."""


PRETENSIONS = (0.0, 0.3)
"""N that tendons carry at least, tried in turn to hold a bending in space."""


@dataclass(frozen=True, eq=False)
class HeldBending:
    """
    A state in which soft segments bend as is wanted, and what the motors do for it.

    pulls: (tendons,) m at the motors, stretch included, SLACK for a tendon that does not carry.
    """

    state: Any
    pulls: Array


class Statics:
    """
    Equilibria of one arm.

    ``soft`` masks have one flag per segment.  Softening returns the springs of a segment to their
    natural shape.  Stiffening locks it (paper, III-A) or, with a Jam of finite stiffness, adds
    the jam's springs about the shape at which it was stiffened; either way it moves nothing.
    precision: rad by which a segment that has its bending may miss it, and by which one may that
    comes no nearer.  late_imports: modules that are loaded when a solve first needs them.
    """

    precision = (1e-9, 1e-9)
    late_imports: tuple[str, ...] = ()

    def __init__(self, arm: Arm) -> None:
        """Discretise ``arm`` and prepare the arrays of the solver."""
        self.chain = RigidChain(arm)
        self.laws = JointLaws(self.chain)
        self._bodies = np.column_stack([self.chain.body_lengths, self.chain.load_coefficients])
        self.continuation = Continuation(self.chain, self.laws)
        self.compliance = compliances(self.chain, np.zeros(self.chain.joints), (0, 0))
        self._no_friction = np.ones((2, self.chain.segments))
        self._groups = cache(self._find_groups)
        self._stiff = cache(self._find_stiff)

    def solve(self, start: Equilibrium, pulls: ArrayLike, soft: Sequence[bool], *,
              vacuum: Sequence[float] | None = None, sliding: Sequence[int] = UNMOVED
              ) -> Equilibrium:
        """
        Return the equilibrium for given pulls, followed from ``start``.

        pulls: (right, left) in m, how much shorter each tendon is than in the straight arm;
        negative is paid out, SLACK never carries.  soft: one flag per segment.  vacuum: of each
        stiff segment, 0 to 1 of full vacuum (default: full); without any it is soft, and a rigid
        one knows no other parts.  sliding: of each tendon through its guides, for friction: 1
        towards the base, -1 towards the tip, 0 frictionless.

        Raises OverconstrainedError when no shape has tendons that short, StaticsError when no
        equilibrium was found, ValueError for input of the wrong size or nan.
        """
        target = pulls_of(pulls, 2)
        problem = self.problem(start, soft, self.chain.straight_length - target, vacuum)
        if problem.groups == 0:
            return self._locked(start, problem.drive.target, problem.stiff)
        return self._find(start, problem, sliding)

    def solve_tensions(self, start: Equilibrium, tensions: ArrayLike, soft: Sequence[bool], *,
                       vacuum: Sequence[float] | None = None, sliding: Sequence[int] = UNMOVED
                       ) -> Equilibrium:
        """
        Return the equilibrium for given tensions (right, left), N >= 0, followed from ``start``.

        The other arguments and errors are those of ``solve``.
        """
        target = tensions_of(tensions, 2)
        problem = self.problem(start, soft, target, vacuum, np.full(2, TENSION))
        if problem.groups == 0:
            return self._unmoved(start, target, np.zeros(2), problem.stiff)
        return self._find(start, problem, sliding)

    def bend(self, start: Equilibrium, segment: int, angle: float,
             soft: Sequence[bool] | None = None, *, vacuum: Sequence[float] | None = None,
             sliding: Sequence[int] = UNMOVED) -> Equilibrium:
        """
        Return the equilibrium in which ``segment`` (0-based) has bending angle ``angle`` (rad).

        One tendon carries it, whichever the loads ask for (if either can, that of the side to
        which the segment turns), and the other follows without tension;
        the pulls of both paths are in the result.  Only ``segment`` is soft unless ``soft`` says
        otherwise.  vacuum: as in ``solve``, but by default that of ``start``.  sliding: as in
        ``solve``.  Raises StaticsError when no tendon holds the arm there in a stable way.
        """
        check_start(start, Equilibrium)
        mask = soft_flags([i == segment for i in range(self.chain.segments)]
                          if soft is None else soft, self.chain.segments)
        if not (whole(segment) and 0 <= segment < self.chain.segments and mask[segment]):
            raise ValueError(f'segment index {segment} is not one of the soft segments; '
                             f'soft: {list(mask)}')
        if vacuum is None:
            vacuum = start.vacuum or None
        if not finite(angle):
            raise ValueError(
                f'the bending angle must be a finite number in rad; given: {angle!r}')
        # What the tendons carried before may be far too much for the segment that is soft now.
        start = Equilibrium(
            start.joint_angles, np.zeros(2), start.pulls, start.slack, start.residual, 0,
            start.stiff, start.held_angles, False, start.vacuum, chain=self.chain)
        reasons: dict[int, str] = {}
        # What a jam holds depends on where it was stiffened, so on both solves.
        at_once = self.laws.rigid_only and not (any(sliding) and self.chain.tendon.friction)
        rows = slice(segment * self.chain.joints_per_segment,
                     (segment + 1) * self.chain.joints_per_segment)
        turn = angle - float(start.joint_angles[rows].sum()) or angle
        for tendon in (RIGHT, LEFT) if turn >= 0.0 else (LEFT, RIGHT):
            modes, target = np.zeros(2, dtype=np.int64), np.full(2, np.inf)
            modes[tendon], target[tendon] = ANGLE, angle
            problem = self.problem(start, mask, target, vacuum, modes, segment)
            try:
                if at_once and (held := self.continuation.in_one_step(start, problem, hold=True)
                                ) is not None and held.tensions[tendon] >= -NO_TENSION:
                    return held
                found = self._find(start, problem, sliding)
                if found.tensions[tendon] >= -NO_TENSION:
                    return self._hold(found, mask, vacuum, sliding)
                reasons[tendon] = 'it would have to push'
            except StaticsError as error:
                reasons[tendon] = str(error)
        why = '; '.join(f'{name}: {reasons[t]}'
                        for t, name in enumerate(self.chain.arm.tendon_names))
        raise StaticsError(f'no tendon holds segment {segment + 1} at {np.degrees(angle):.1f} '
                           f'degrees ({why})', start)

    def hold(self, start: Equilibrium, bending: Array, soft: Sequence[bool], *,
             sliding: Sequence[int] = UNMOVED, pretensions: Sequence[float] = PRETENSIONS
             ) -> HeldBending:
        """
        Return the state in which the soft segment has its bending, and the pulls that hold it.

        bending: (segments, 2) rad about x and y, of which that of the first soft segment about y
        counts; all others are stiff.  sliding: as in ``solve``.  pretensions: of no use where one
        tendon carries.  Raises what ``bend`` raises.
        """
        segment = list(soft).index(True)
        found = self.bend(start, segment, float(bending[segment, 1]), sliding=sliding)
        carries = np.arange(len(found.tensions)) == np.argmax(found.tensions)
        return HeldBending(found, np.where(carries & (found.tensions > 0.0),
                                           self.commanded_pulls(found, sliding), SLACK))

    def sliding_towards(self, change: Array) -> tuple[int, ...]:
        """Return how tendons slide, as of a solve, while bending (segments, 2) changes, rad."""
        turn = int(np.sign(change[:, 1].sum()))
        return turn, -turn

    def commanded_pulls(self, state: Equilibrium, sliding: Sequence[int] = UNMOVED) -> Array:
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
        problem = self.problem(found, soft, self.chain.straight_length - pulls, vacuum)
        if any(sliding):
            problem = problem.with_friction(self.chain, found.joint_angles, sliding)
        point = self.continuation.newton(self.continuation.point_of(found), problem)
        if point.status != _newton.CONVERGED:
            raise StaticsError(
                'the tendons can bend the arm to this shape but not hold it there: the '
                'equilibrium is not stable', found)
        return self.continuation.result(point, problem)

    def problem(self, start: Equilibrium, soft: Sequence[bool], target: Array,
                vacuum: Sequence[float] | None = None, modes: Indices = BOTH_LENGTHS,
                segment: int = 0) -> Problem:
        """
        Return one solve in compiled form.

        target, modes, segment: of the tendons, as in Drive; by default both are driven by their
        lengths, m.  The other arguments are those of ``solve``.
        Raises ValueError for input that is not of this arm.
        """
        check_start(start, Equilibrium)
        segments = self.chain.segments
        try:
            stiff = self._stiff(tuple(soft))
        except (TypeError, ValueError):  # which is said of what was given
            stiff = self._find_stiff(soft)
        parts = vacuum_parts(vacuum, segments)
        if start.joint_angles.shape != (self.chain.joints,) or len(start.stiff) != segments:
            raise ValueError(
                f'the start has {start.joint_angles.size} joints in {len(start.stiff)} segments, '
                f'this arm has {self.chain.joints} in {segments}')
        if parts:  # without any vacuum there is no jam
            stiff = tuple(s and part > 0.0 for s, part in zip(stiff, parts, strict=True))
        system, groups, turn_limit, tolerance = self._groups(stiff)
        if parts or not self.laws.rigid_only:
            system = system._replace(joints=self.laws.joints(start, stiff, parts))
        return Problem(
            system, Drive(modes, target, self.compliance,
                          np.array((segment, segment)) if segment else BOTH_LENGTHS), groups,
            turn_limit, tolerance, start.joint_angles, stiff, parts)

    def _find_stiff(self, soft: Sequence[bool]) -> tuple[bool, ...]:
        return tuple(not one for one in soft_flags(soft, self.chain.segments))

    def _find_groups(self, stiff: tuple[bool, ...]) -> tuple[System, int, float, Array]:
        """
        Number the rigid groups: every body of a free segment with what is locked onto it.

        Return the system with soft joints, the number of groups, how far (rad) a segment may turn
        in one solve, and the solver's tolerance.  Where the springs outweigh the loads no path of
        an arm with a slack tendon was seen to end.
        """
        locked = [s and segment.jam.rigid
                  for s, segment in zip(stiff, self.chain.arm.segments, strict=True)]
        free = np.repeat(np.logical_not(locked), self.chain.joints_per_segment)
        group, groups = np.cumsum(free) - 1, int(free.sum())
        system = System(self._bodies, self.laws.soft, self.laws.tables, self.chain.guides,
                        self._no_friction, group)
        tolerance = self.continuation.tolerance(stiff)
        if groups == 0:
            return system, groups, TURN_LIMIT, tolerance
        springs = self.laws.least_stiffness[free]
        worst: Array = np.bincount(
            group[group >= 0], np.hypot(*self._bodies[group >= 0, 1:].T)).astype(float)
        limit = TURN_LIMIT if outweigh(springs, worst) else TURN_LIMIT_NOT_CONVEX
        return system, groups, limit, tolerance

    def _find(self, start: Equilibrium, problem: Problem, sliding: Sequence[int]) -> Equilibrium:
        return self.continuation.solve(
            start, problem, sliding if sliding is UNMOVED else sliding_signs(sliding))

    def _locked(self, start: Equilibrium, target: Array,
                stiff: tuple[bool, ...]) -> Equilibrium:
        """Return the state of an arm without a soft segment: only the slack can change."""
        excess = self.chain.straight_length - start.pulls - target
        slack = np.maximum(-excess, 0.0)
        if self.compliance.any():  # the tendons stretch where the shape cannot give way
            return self._unmoved(start, np.maximum(excess, 0.0) / self.compliance, slack, stiff)
        if np.any(excess > LOCKED_TOLERANCE):
            too_short = ', '.join(f'{name} {length * 1e3:.3f} mm' for name, length in zip(
                self.chain.arm.tendon_names, excess, strict=True))
            raise OverconstrainedError(
                'every segment is stiff, and the pulls ask for tendons that are shorter than '
                f'their paths by {too_short}; soften a segment first', start)
        return self._unmoved(start, np.where(slack > LOCKED_TOLERANCE, 0.0, np.nan), slack, stiff)

    def _unmoved(self, start: Equilibrium, tensions: Array, slack: Array, stiff: tuple[bool, ...]
                 ) -> Equilibrium:
        return Equilibrium(start.joint_angles, tensions, start.pulls, slack, 0.0, 0, stiff,
                           start.joint_angles, chain=self.chain)


def warm_up() -> None:
    """
    Build the compiled solver, or load it, now rather than in the first solve.

    It takes up to a minute once, and some milliseconds later.
    """
    _kernel.functions()
