# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Statics of a planar arm: hinges and a pair of tendons."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache, partial

import numpy as np
from numpy.typing import ArrayLike

from soft_continuum.mechanics import _kernel
from soft_continuum.mechanics._checks import (
    bending_of,
    pulls_of,
    sliding_signs,
    soft_flags,
    tensions_of,
    vacuum_parts,
)
from soft_continuum.mechanics._linear_algebra import NO_TENSION
from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.chain import Batch, check_start, Equilibrium, LEFT, RIGHT, SLACK
from soft_continuum.mechanics.laws import outweigh
from soft_continuum.mechanics.plane import _newton
from soft_continuum.mechanics.plane._assembly import (
    ANGLE,
    BOTH_LENGTHS,
    Indices,
    LENGTH,
    System,
    TendonDrive,
    TENSION,
)
from soft_continuum.mechanics.plane._continuation import (
    Continuation,
    Point,
    Problem,
    TURN_LIMIT,
    TURN_LIMIT_BOTH_TAUT,
    TURN_LIMIT_NOT_CONVEX,
)
from soft_continuum.mechanics.plane.chain import PlaneChain
from soft_continuum.mechanics.plane.joints import compliances, JointLaws
from soft_continuum.mechanics.statics import (
    HeldBending,
    PRETENSIONS,
    Problems,
    Statics,
    StaticsError,
)


class PlaneStatics(Statics):
    """Equilibria of one planar arm."""

    precision = (1e-9, 1e-9)
    chain: PlaneChain

    def __init__(self, arm: Arm) -> None:
        """Discretise ``arm`` and prepare the arrays of the solver."""
        self.chain = PlaneChain(arm)
        self.laws = JointLaws(self.chain)
        self._bodies = np.column_stack([self.chain.body_lengths, self.chain.load_coefficients])
        self.continuation = Continuation(self.chain, self.laws)
        self.compliance = compliances(self.chain, np.zeros(self.chain.bodies), (0, 0))
        self._both = np.repeat(np.arange(self.chain.segments)[:, None], 2, axis=1)
        self._no_friction = np.ones((2, self.chain.segments))
        self._groups = cache(self._find_groups)
        self._stiff = cache(self._find_stiff)

    def solve(self, start: Equilibrium, pulls: ArrayLike, soft: Sequence[bool], *,
              tensions: ArrayLike | None = None, vacuum: Sequence[float] | None = None,
              sliding: Sequence[int] = ()) -> Equilibrium:
        """Return the equilibrium followed from ``start``; all as in Statics."""
        target, modes = self.chain.straight_paths - pulls_of(pulls, 2), BOTH_LENGTHS
        if tensions is not None:
            given = tensions_of(tensions, 2, optional=True)
            modes = np.where(np.isnan(given), LENGTH, TENSION)
            target = np.where(np.isnan(given), target, given)
        problem = self.problem(start, soft, target, vacuum, modes)
        if problem.groups == 0:
            by_force = modes == TENSION
            return self._locked(Equilibrium(
                start.configuration, start.tensions, start.pulls, start.slack, 0.0, 0,
                problem.stiff, start.configuration, chain=self.chain), by_force, np.where(
                    by_force, target, self.chain.straight_paths - target))
        return self._find(start, problem, sliding)

    def bend(self, start: Equilibrium, segment: int, angle: float,
             soft: Sequence[bool] | None = None, *, vacuum: Sequence[float] | None = None,
             sliding: Sequence[int] = ()) -> Equilibrium:
        """Return the equilibrium in which ``segment`` has an angle; all as in Statics."""
        mask, vacuum = self._bent(start, segment, angle, soft, vacuum, sliding)
        reasons: dict[int, str] = {}
        # What a jam holds depends on where it was stiffened, so on both solves.
        at_once = self.laws.rigid_only and not (any(sliding) and self.chain.tendon.friction)
        rows = slice(segment * self.chain.joints_per_segment,
                     (segment + 1) * self.chain.joints_per_segment)
        turn = angle - sum(start.configuration[rows].tolist()) or angle
        for tendon in (RIGHT, LEFT) if turn >= 0.0 else (LEFT, RIGHT):
            modes, target = np.zeros(2, dtype=np.int64), np.array((np.inf, np.inf))
            modes[tendon], target[tendon] = ANGLE, angle
            problem = self.problem(start, mask, target, vacuum, modes, segment)
            try:
                if at_once and (held := self.continuation.in_one_step(start, problem, hold=True)
                                ) is not None and held.tensions[tendon] >= -NO_TENSION:
                    return held
                # What they carried before may be far too much for the segment that is soft now.
                found = self._find(replace(start, tensions=np.zeros(2)), problem, sliding)
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
             sliding: Sequence[int] = (), pretensions: Sequence[float] = PRETENSIONS
             ) -> HeldBending:
        """
        Return the state in which the soft segment has its bending, and the pulls that hold it.

        bending: (segments, 2) rad about x and y; only that of the first soft segment about y is
        used, and all others are stiff.  sliding: as in ``solve``.  pretensions: ignored, since one
        tendon carries.  Raises what ``bend`` raises.
        """
        wanted, mask = self._wanted(start, bending, soft, sliding, pretensions)
        segment = mask.index(True)
        found = self.bend(start, segment, float(wanted[segment, 1]), sliding=sliding)
        carries = np.arange(len(found.tensions)) == np.argmax(found.tensions)
        return HeldBending(found, np.where(carries & (found.tensions > 0.0),
                                           self.commanded_pulls(found, sliding), SLACK))

    def sliding_towards(self, change: Array, /) -> tuple[int, ...]:
        """Return sliding, as for solve, while bending (segments, 2) changes, rad."""
        turn = int(np.sign(bending_of(change, self.chain.segments)[:, 1].sum()))
        return turn, -turn

    def stretch_rates(self, state: Equilibrium, sliding: Sequence[int]) -> Array:
        """Return the compliance (2,) m/N of the tendons for the tension at the base."""
        check_start(state, 'state')
        return compliances(self.chain, state.configuration, sliding_signs(sliding))

    def solve_together(self, given: Problems) -> Batch:
        """
        Return the equilibria that full steps find, on all cores.

        Not found: problems that they do not reach, with friction of tendons, given tensions or no
        soft segment, and arms whose moment-curvature tables differ from those of the first.
        """
        models: Sequence[PlaneStatics] = given.models
        starts, count = given.starts, given.count
        kinds = count if max(map(len, (models, starts, given.masks, given.vacuum))) > 1 else 1
        none = np.zeros(2)  # each row has its own target
        problems = [models[i % len(models)].problem(
            starts[i % len(starts)], given.masks[i % len(given.masks)], none,
            given.vacuum[i % len(given.vacuum)]) for i in range(kinds)]
        straight = np.array([m.chain.straight_paths for m in models])
        target = np.ascontiguousarray(straight - np.broadcast_to(given.pulls, (count, 2)))
        theta = np.broadcast_to(np.cumsum([s.configuration for s in starts], axis=1),
                                (count, models[0].chain.bodies)).copy()
        tension = np.broadcast_to(np.nan_to_num([s.tensions for s in starts]), (count, 2)).copy()
        lengths, residual = np.full((count, 2), np.nan), np.full(count, np.nan)
        systems, tables = [p.system for p in problems], problems[0].system.tables
        groups = np.array([p.groups for p in problems])
        group = np.array([s.group for s in systems])
        linear = all(model.laws.linear for model in models)
        alike = linear or np.array([np.array_equal(s.tables, tables) for s in systems])
        by_length = np.isnan(given.tensions).all(axis=1)
        rows = np.flatnonzero((groups > 0) & alike & ~given.rub & by_length)
        status, turned = np.full(count, _newton.FAILED), np.zeros(count)
        arguments = (
            (theta, tension, lengths),
            (np.array([s.bodies for s in systems]), np.array([s.joints for s in systems]), tables,
             np.array([s.guides for s in systems]), systems[0].ratios, group), groups,
            (problems[0].drive.mode, target, np.array([m.compliance for m in models]),
             problems[0].drive.segment),
            np.array([p.tolerance for p in problems]), status, residual, turned)
        if linear:
            # Those side by side need the same rigid groups and the same driven tendons.
            kind = np.column_stack([np.broadcast_to(group, (count, group.shape[1])),
                                    np.isfinite(target)])[rows]
            while len(rows):
                same = (kind == kind[0]).all(axis=1)
                solve = partial(_kernel.functions().newton_lanes, *arguments, rows[same])
                _kernel.in_parts(solve, int(np.count_nonzero(same)))
                rows, kind = rows[~same], kind[~same]
        else:
            solve = partial(_kernel.functions().newton_batch, *arguments, rows)
            _kernel.in_parts(solve, len(rows))
        limit = np.where((tension > NO_TENSION).all(axis=1), TURN_LIMIT_BOTH_TAUT,
                         [p.turn_limit for p in problems])
        found = (status == _newton.CONVERGED) & (turned <= limit)

        def state(i: int) -> Equilibrium:
            problem = problems[i % kinds]
            return models[i % len(models)].continuation.result(
                Point(theta[i], tension[i], lengths[i], residual=residual[i]),
                problem._replace(drive=problem.drive._replace(target=target[i])))

        return Batch(
            np.diff(theta, axis=1, prepend=0.0), tension, straight - lengths,
            np.where(tension > 0.0, 0.0, np.maximum(target - lengths, 0.0)), found,
            np.zeros(count, dtype=bool), residual, [m.chain for m in models], state)

    def _hold(self, found: Equilibrium, soft: Sequence[bool], vacuum: Sequence[float] | None,
              sliding: Sequence[int]) -> Equilibrium:
        """Check that a state found by its bending angle is stable at its tendon lengths."""
        pulls = self.commanded_pulls(found, sliding)
        carries = found.tensions > NO_TENSION
        if carries.any():  # where neither carries, both just taut hold the arm
            pulls = np.where(carries, pulls, SLACK)
        problem = self.problem(found, soft, self.chain.straight_paths - pulls, vacuum)
        if any(sliding):
            problem = problem.with_friction(self.chain, found.configuration, sliding)
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

        target, modes, segment: of the tendons, as in TendonDrive; by default both are driven by
        their lengths, m.  The other arguments are those of ``solve``.  Raises ValueError for input
        that is not of this arm.
        """
        check_start(start)
        segments = self.chain.segments
        try:
            stiff = self._stiff(tuple(soft))
        except (TypeError, ValueError):  # which is said of what was given
            stiff = self._find_stiff(soft)
        parts = vacuum_parts(vacuum, segments)
        if start.configuration.shape != (self.chain.bodies,) or len(start.stiff) != segments:
            raise ValueError(
                f'the start has {start.configuration.size} joints in {len(start.stiff)} segments, '
                f'this arm has {self.chain.bodies} in {segments}')
        if parts:  # without any vacuum there is no jam
            stiff = tuple(s and part > 0.0 for s, part in zip(stiff, parts, strict=True))
        system, groups, turn_limit, tolerance = self._groups(stiff)
        if parts or not self.laws.rigid_only:
            system = system._replace(joints=self.laws.joints(start, stiff, parts))
        return Problem(
            system, TendonDrive(modes, target, self.compliance, self._both[segment]), groups,
            turn_limit, tolerance, start.configuration, stiff, parts)

    def _find_stiff(self, soft: Sequence[bool]) -> tuple[bool, ...]:
        return tuple(not one for one in soft_flags(soft, self.chain.segments))

    def _find_groups(self, stiff: tuple[bool, ...]) -> tuple[System, int, float, Array]:
        """
        Number the rigid groups: every body of a free segment with what is locked onto it.

        Return the system with soft joints, the number of groups, how far (rad) a segment may turn
        in one solve, and the solver's tolerance.  Where the springs outweigh the loads no path of
        an arm with a slack tendon was seen to end.
        """
        free = ~self.chain.rigid(stiff)
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
        return self.continuation.solve(start, problem, sliding_signs(sliding))
