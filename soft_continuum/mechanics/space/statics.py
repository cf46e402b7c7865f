# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Statics of a spatial arm: links and any tendons."""

from collections.abc import Hashable, Sequence
from dataclasses import replace
from functools import cached_property, lru_cache, partial
from typing import NamedTuple

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
from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.chain import Batch, check_start, Equilibrium
from soft_continuum.mechanics.laws import outweigh, refuse_parts
from soft_continuum.mechanics.space._assembly import Integers
from soft_continuum.mechanics.space._laws import HELD, LAW, YIELD
from soft_continuum.mechanics.space.chain import SpaceChain, sums
from soft_continuum.mechanics.space.friction import Friction
from soft_continuum.mechanics.statics import (
    Booleans,
    driven,
    HeldBending,
    LOCKED_TOLERANCE,
    OverconstrainedError,
    PRETENSIONS,
    Problems,
    Statics,
    StaticsError,
)

MAX_FRICTION_ITERATIONS = 100
DEGENERATE = 0.05  # of the slopes of the tendons' lengths, relative: taken as zero
TURN = 1e-6  # rad, for slopes
LEAST_PART = 2e-3  # m of tendon that is paid out at once, where that is tried by halves


class ConstraintState(NamedTuple):
    """
    What stiff segments and their vacuum make of a chain.

    link: (bodies,), of each body, -1 for what is fixed to the base.  free: (bodies,), bodies that
    a link begins with.  joints: (links, 4, 3), as of _laws, but for the shapes that they hold.
    still: (tendons,), those along locked segments only; any_still: whether there are such.
    yields: whether a joint may.  direct: whether a full step may find what small ones do, since
    the energy is convex.
    """

    link: Integers
    free: Booleans
    joints: Array
    still: Booleans
    any_still: bool
    yields: bool
    direct: bool


def slack_of(pulls: Array, target: Array, compliance: Array, tensions: Array,
             by_force: Booleans) -> Array:
    """Return the slack of each tendon, its length beyond its path, m; all are (…, tendons)."""
    slack: Array = np.maximum(0.0, pulls - target + compliance * tensions)
    slack[by_force | (tensions > 0.0)] = 0.0
    return slack


class _Links:
    """
    The links of an arm, on the way; each array first as it is, then as Newton's method left it.

    rotations: (2, links, 3, 3).  tension: (2, tendons) N.  taut: (2, tendons).  targets: (4,
    tendons).  bias: (2, links, 3) N m.  bodies: (bodies, 3, 3), rotations of all bodies.
    """

    def __init__(self, chain: SpaceChain, start: Equilibrium, locks: ConstraintState,
                 by_force: Booleans, tendons: tuple[Array, Array]) -> None:
        """
        Begin at a state.

        by_force: (tendons,), those whose tension is given.  tendons: compliance of each, m/N, and
        ratios of tension of all spans.
        """
        count, links = len(by_force), len(locks.joints)
        self.chain, self.start, self.locks = chain, start, locks
        self.kind = by_force.astype(np.int64)  # TENSION or LENGTH
        self.compliance, self.ratios = tendons
        self.rotations, self.bias = np.empty((2, links, 3, 3)), np.empty((2, links, 3))
        self.tension, self.targets = np.empty((2, count)), np.empty((4, count))
        self.tension[:] = [t if t == t else 0.0 for t in start.tensions.tolist()]  # nan: none
        self.taut = self.tension > 0.0
        self.bodies = np.empty((chain.bodies, 3, 3))
        self.joints = locks.joints.copy()
        self.joints[:, HELD] = start.held[locks.free]

    def follow(self, target: Array, held: bool) -> tuple[float, int, float, bool]:
        """Go to pulls or tensions (tendons,), as _path.follow, and return what that does."""
        self.targets[1] = target
        locks, start = self.locks, self.start
        found: tuple[float, int, float, bool] = _kernel.functions().spatial_follow(
            (start.configuration, start.pulls, start.slack), self.chain.layout,
            (locks.link, self.joints, self.chain.laws.tables, self.ratios),
            (self.rotations, self.tension, self.taut, self.bodies),
            (self.kind, self.compliance, self.targets, self.bias, 0.0), locks.direct, held)
        return found

    def hold(self, others: Booleans) -> None:
        """Take the tensions that hold the shape best, those of ``others`` as they are."""
        system, _ = self.chain.system(
            self.start.configuration, self.locks.link, self.joints, self.ratios)

        def balance(tension: Array) -> Array:
            found: Array = _kernel.functions().spatial_balance(self.rotations[0], tension, system)
            return found

        tension, unit = self.tension[0], np.eye(len(self.kind))
        tension[~others] = 0.0
        alone = balance(tension)
        tendons = np.flatnonzero(~others)
        if len(tendons):
            from scipy.optimize import nnls  # 0.3 s that who has no tendons need not wait for
            levers = [balance(tension + unit[t]) - alone for t in tendons]
            each = np.column_stack(levers)
            try:
                tension[tendons] = nnls(each, -alone)[0]
            except RuntimeError:  # it did not end: others do as well, for what they leave is led
                tension[tendons] = np.maximum(0.0, np.linalg.lstsq(each, -alone)[0])
        self.taut[0] = tension > 0.0


class SpaceStatics(Statics):
    """
    Equilibria of one spatial arm.

    precision: tendons without tension may leave errors of 1e-6 rad and more.  late_imports:
    they take 0.3 s.
    """

    chain: SpaceChain
    late_imports: tuple[str, ...] = ('scipy.optimize',)

    def __init__(self, arm: Arm) -> None:
        """Discretise ``arm``."""
        self.chain = SpaceChain(arm)
        self.compliance = arm.compliance
        self._locks = lru_cache(maxsize=64)(self._find_locks)
        self._no_friction = np.ones(len(self.chain.span_tendons))

    def solve(self, start: Equilibrium, pulls: ArrayLike, soft: Sequence[bool], *,
              tensions: ArrayLike | None = None, vacuum: Sequence[float] | None = None,
              sliding: Sequence[int] = ()) -> Equilibrium:
        """Return the equilibrium followed from ``start``; all as in Statics."""
        tendons = len(self.compliance)
        begin, locks = self.begin(start, soft, vacuum)
        by_force, target, never = driven(
            pulls_of(pulls, tendons), None if tensions is None else
            tensions_of(tensions, tendons, optional=True))
        found = self._follow(begin, locks, by_force, target, sliding_signs(sliding, tendons))
        if any(never.tolist()):
            return replace(found, slack=np.where(never, np.inf, found.slack))
        return found

    def bend(self, start: Equilibrium, segment: int, angle: float,
             soft: Sequence[bool] | None = None, *, vacuum: Sequence[float] | None = None,
             sliding: Sequence[int] = ()) -> Equilibrium:
        """Return the equilibrium in which ``segment`` has an angle; all as in Statics."""
        from soft_continuum.mechanics.inverse import pulls_for_bending  # needs this
        mask, vacuum = self._bent(start, segment, angle, soft, vacuum, sliding)
        wanted = np.full((self.chain.segments, 2), np.nan)
        wanted[segment] = np.where(self.chain.arm.bending_axes[segment], (0.0, angle), np.nan)
        begun, _ = self.begin(start, mask, vacuum)
        return pulls_for_bending(self, begun, wanted, mask).state

    def hold(self, start: Equilibrium, bending: Array, soft: Sequence[bool], *,
             sliding: Sequence[int] = (), pretensions: Sequence[float] = PRETENSIONS
             ) -> HeldBending:
        """Return the state that pulls_for_bending finds; all as in Statics."""
        from soft_continuum.mechanics.inverse import pulls_for_bending  # needs this
        given, mask = self._wanted(start, bending, soft, sliding, pretensions)
        wanted = np.where(self.chain.arm.bending_axes & np.array(mask)[:, None], given, np.nan)
        errors = []
        for pretension in pretensions:
            try:
                fit = pulls_for_bending(self, start, wanted, mask, pretension=pretension)
                return HeldBending(fit.state, fit.pulls)
            except StaticsError as error:
                errors.append(error)
        raise errors[0]

    def sliding_towards(self, change: Array, /) -> tuple[int, ...]:
        """Return sliding while bending changes: unknown, so 0."""
        bending_of(change, self.chain.segments)
        return ()

    def solve_together(self, given: Problems) -> Batch:
        """
        Return the equilibria found by one compiled call for each kind of problem, on all cores.

        Not found: problems with yielding joints, with friction of tendons, or without a soft
        segment.
        """
        models: Sequence[SpaceStatics] = given.models
        starts, masks, parts, count = given.starts, given.masks, given.vacuum, given.count
        tendons, rub = len(models[0].compliance), given.rub
        pulls, tensions = (
            np.broadcast_to(rows, (count, tendons)) for rows in (given.pulls, given.tensions))
        problems: dict[tuple[int, ...], _Problem] = {}
        alike: dict[Hashable, tuple[list[int], list[_Problem]]] = {}
        for i in range(count):
            which = i % len(models), i % len(starts), i % len(masks), i % len(parts)
            if which not in problems:
                model, start, soft, part = which
                problems[which] = _problem(
                    models[model], *models[model].begin(starts[start], masks[soft], parts[part]))
            rows, each = alike.setdefault(None if rub[i] else problems[which].kind, ([], []))
            rows.append(i)
            each.append(problems[which])
        states: dict[int, Equilibrium] = {}
        tension, ends, slack = np.full((3, count, tendons), np.nan)
        batch = Batch(
            np.full((count, models[0].chain.bodies, 3, 3), np.nan), tension, ends, slack,
            np.zeros(count, dtype=bool), np.zeros(count, dtype=bool), np.full(count, np.nan),
            [model.chain for model in models], states.__getitem__)
        for kind, (rows, each) in alike.items():
            if kind is not None:
                _follow_together(each[:1] if len(problems) == 1 else each, pulls[rows],
                                 tensions[rows], np.array(rows), batch, states)
        return batch

    def begin(self, start: Equilibrium, soft: Sequence[bool],
              vacuum: Sequence[float] | None = None) -> tuple[Equilibrium, ConstraintState]:
        """
        Return the start with the new stiff segments, and what they lock.

        Arguments as for ``solve``.  Raises ValueError for other shapes or numbers.
        """
        segments = self.chain.segments
        check_start(start)
        if start.chain is not self.chain and start.chain.arm != self.chain.arm:
            raise ValueError('the start is a state of another arm; begin with '
                             'statics.chain.straight()')
        mask, parts = soft_flags(soft, segments), vacuum_parts(vacuum, segments)
        stiff = tuple(not one for one in mask)
        if parts:  # without any vacuum there is no jam
            stiff = tuple(one and part > 0.0 for one, part in zip(stiff, parts, strict=True))
        return self._holding(start, stiff, parts), self._locks(stiff, parts)

    @cached_property
    def friction(self) -> Friction:
        """Friction at the guides; created when first needed."""
        return Friction(self.chain)

    def stretch_rates(self, state: Equilibrium, sliding: Sequence[int]) -> Array:
        """Return the compliance (tendons,) m/N of the tendons for the tension at the base."""
        check_start(state, 'state')
        ways = sliding_signs(sliding, len(self.compliance))
        return self.friction.carried(state.rotations, ways)[1] if any(ways) else self.compliance

    def _holding(self, start: Equilibrium, stiff: tuple[bool, ...],
                 vacuum: tuple[float, ...]) -> Equilibrium:
        """
        Return the start with the new stiff segments and this vacuum.

        Stiffening, and more vacuum, hold the present shape.
        """
        refuse_parts([s.jam for s in self.chain.arm.segments], stiff, vacuum)
        held, angles, per = start.held, None, self.chain.joints_per_segment
        for s, segment in enumerate(self.chain.arm.segments):
            part = vacuum[s] if vacuum else 1.0
            before = start.vacuum[s] if start.vacuum else 1.0
            if not stiff[s]:
                continue
            share = (before / part)**segment.jam.stiffness_exponent if start.stiff[s] else 0.0
            if start.stiff[s] and before >= part:
                continue
            rows = slice(s * per, (s + 1) * per)
            if angles is None:
                angles, held = start.joint_angles, held.copy()
            held[rows] = angles[rows] - self.chain.laws.rescaled(
                s, angles[rows] - held[rows], share)
        slack = start.slack
        if np.inf in slack.tolist():  # a path begins somewhere
            slack = np.where(slack == np.inf, 0.0, slack)
        return Equilibrium(start.configuration, start.tensions, start.pulls, slack, 0.0, 0, stiff,
                           held, vacuum=vacuum, chain=self.chain)

    def _find_locks(self, stiff: tuple[bool, ...], vacuum: tuple[float, ...]) -> ConstraintState:
        chain = self.chain
        free = ~chain.rigid(stiff)
        link = np.cumsum(free) - 1
        joints = chain.laws.joints(stiff, vacuum, np.zeros((chain.bodies, 3)))[free]
        still = np.ones(len(self.compliance), dtype=bool)
        still[chain.span_tendons[chain.entry_spans[link[chain.entry_bodies] >= 0]]] = False
        yields = bool(np.isfinite(joints[:, LAW, YIELD]).any())
        loads = chain.body_lengths * np.linalg.norm(chain.forces, axis=1)
        direct = not (yields or chain.moments.any()) and outweigh(
            chain.laws.least_stiffness()[free],
            sums(link[link >= 0], loads[link >= 0], len(joints)))
        return ConstraintState(link, free, joints, still, bool(still.any()), yields, direct)

    def _follow(self, start: Equilibrium, locks: ConstraintState, by_force: Booleans,
                target: Array, sliding: Sequence[int]) -> Equilibrium:
        """Return the equilibrium for pulls (m), or tensions (N) of those by force."""
        if not len(locks.joints):
            return self._locked(start, by_force, target)
        state = self._follow_load_path(
            start, locks, by_force, target, self.compliance, self._no_friction)
        if not any(t.friction and way for t, way in zip(
                self.chain.arm.tendons, sliding, strict=False)):
            return state
        before = self._no_friction
        for _ in range(MAX_FRICTION_ITERATIONS):  # friction depends on the shape it leads to
            ratios, compliance = self.friction.carried(state.rotations, sliding)
            jumped, state = state.jumped, self._follow_load_path(
                state, locks, by_force, target, compliance, ratios)
            state = replace(state, jumped=state.jumped or jumped)
            if np.abs(ratios - before).max() < 1e-13:
                return state
            before = ratios
        raise StaticsError('the friction at the guides did not converge', state)

    def _follow_load_path(self, start: Equilibrium, locks: ConstraintState, by_force: Booleans,
                          target: Array, compliance: Array, ratios: Array) -> Equilibrium:
        """Follow lengths, tensions and initial unbalanced moments to the target."""
        if locks.any_still:
            self._refuse_short(np.where(locks.still & ~by_force, target - start.pulls, 0.0), start)
        links = _Links(self.chain, start, locks, by_force, (compliance, ratios))
        done, total, residual, rests = links.follow(target, False)
        if done < 0.0:
            links.hold(by_force | (start.slack > 0.0))
            done, total, residual, rests = links.follow(target, True)
        if not rests:
            if self._too_short(links, by_force, target, done):
                raise OverconstrainedError(
                    'no shape of the soft segments near the present one has tendons as short as '
                    'these pulls require; pay out a tendon', start)
            out = start.pulls - start.slack - target
            if not by_force.any() and out.min() > 0.0 and LEAST_PART < out.max() < np.inf:
                # It falls over as all tendons are paid out, so pay out half at a time.
                half = self._follow_load_path(
                    start, locks, by_force, target + 0.5 * out, compliance, ratios)
                return replace(self._follow_load_path(
                    half, locks, by_force, target, compliance, ratios), jumped=True)
            raise StaticsError(
                f'the arm loses its equilibrium after {100.0 * done:.0f} % of the way to '
                'these pulls and loads, and no other was found nearby; pay out a tendon, '
                'or go there in smaller steps', start)
        tensions, pulls, held = (
            links.tension[0], self.chain.straight_paths - links.targets[3], start.held)
        slack = slack_of(pulls, target, compliance, tensions, by_force)
        if locks.yields:
            held = held.copy()
            held[locks.free] = links.joints[:, HELD]
        return Equilibrium(links.bodies, tensions, pulls, slack, residual, total,
                                  start.stiff, held, done < 1.0, start.vacuum, chain=self.chain)

    def _too_short(self, links: _Links, by_force: Booleans, target: Array, done: float) -> bool:
        """
        Return whether the tendons cannot be as short as commanded, as for planar arms.

        This is so where the spans along locked segments alone are longer, or where no turn of the
        links shortens all tendons that are too long: then weighted derivatives of their lengths
        cancel (Gordan 1873).
        """
        from scipy.optimize import nnls
        from scipy.spatial.transform import Rotation
        chain, link = self.chain, links.locks.link
        bodies = links.bodies if done > 0.0 else links.start.configuration
        rigid = ~by_force & (self.compliance == 0.0)
        wanted = chain.straight_paths - target
        _, unchanged = chain.system(links.start.configuration, link, links.joints, links.ratios)
        if np.any(rigid & (wanted <= unchanged)):
            return True
        long = np.flatnonzero(rigid & (chain.paths(bodies) > wanted - LOCKED_TOLERANCE))
        slopes = np.zeros((3 * len(links.locks.joints), len(long)))
        for row, turned in enumerate(slopes):
            k, axis = divmod(row, 3)
            turn = Rotation.from_rotvec(TURN * np.eye(3)[axis]).as_matrix()
            moved = [np.where((link == k)[:, None, None], each @ bodies, bodies)
                     for each in (turn, turn.T)]
            turned[:] = (chain.paths(moved[0]) - chain.paths(moved[1]))[long] / (2.0 * TURN)
        sizes = np.linalg.norm(slopes, axis=0)
        offset = max(np.max(tendon.offset) for tendon in chain.arm.tendons)
        if not len(long) or np.any(sizes < DEGENERATE * offset):
            return bool(len(long))
        # The weights add up to one, as nearly as it can be had.
        rows = np.vstack([slopes / sizes, np.full(len(long), 1e3)])
        return bool(nnls(rows, np.append(np.zeros(len(slopes)), 1e3))[1] < DEGENERATE)


class _Problem(NamedTuple):
    """
    An arm, its start with the new stiff segments, and what those lock.

    kind: equal for problems that one compiled call solves; None for those solved one by one.
    """

    model: SpaceStatics
    start: Equilibrium
    locks: ConstraintState
    kind: Hashable


def _problem(model: SpaceStatics, start: Equilibrium, locks: ConstraintState) -> _Problem:
    _, tendons, begins, bodies, _ = model.chain.layout[3]
    kind = None if locks.yields or not locks.free.any() else tuple(
        each.tobytes() for each in (locks.link, tendons, begins, bodies, model.chain.laws.tables))
    return _Problem(model, start, locks, kind)


def _follow_together(problems: Sequence[_Problem], pulls: Array, tensions: Array, rows: Integers,
                     batch: Batch, states: dict[int, Equilibrium]) -> None:
    """
    Solve problems of one kind; write those found into their rows of the batch, and the states.

    problems: one for all, or one for each.  pulls, tensions: (m, tendons) m and N, as of a solve.
    """
    count, tendons = pulls.shape
    models = [problem.model for problem in problems]
    starts = [problem.start for problem in problems]
    locks = [problem.locks for problem in problems]
    layouts = [model.chain.layout for model in models]
    lengths, forces, torques, straight, nudge = (
        np.array([layout[i] for layout in layouts]) for i in (0, 1, 2, 4, 5))
    routing = [layout[3] for layout in layouts]
    rotations, before, slack, carried = (
        np.array([getattr(start, name) for start in starts])
        for name in ('configuration', 'pulls', 'slack', 'tensions'))
    joints = np.array([each.joints for each in locks])
    for each, start, one in zip(joints, starts, locks, strict=False):
        each[:, HELD] = start.held[one.free]
    compliance = np.array([model.compliance for model in models])
    by_force, goal, never = driven(pulls, tensions)

    tension = np.empty((count, 2, tendons))
    tension[:] = np.nan_to_num(carried)[:, None]
    targets = np.empty((count, 4, tendons))
    targets[:, 1] = goal
    bodies = np.empty((count, *rotations.shape[1:]))
    done, residual = np.empty(count), np.empty(count)
    total, rests = np.empty(count, np.int64), np.empty(count, bool)
    _kernel.in_parts(partial(
        _kernel.functions().spatial_follow_batch, (rotations, before, slack),
        (lengths, forces, torques,
         (np.array([r[0] for r in routing]), *routing[0][1:4], np.array([r[4] for r in routing])),
         straight, nudge),
        (locks[0].link, joints, models[0].chain.laws.tables,
         np.ones(len(models[0].chain.span_tendons))),
        (tension, tension > 0.0, bodies), (by_force.astype(np.int64), compliance, targets),
        np.array([one.direct for one in locks]), (done, total, residual, rests)), count)

    short = np.where(by_force | (compliance > 0.0) | ~np.array([one.still for one in locks]), 0.0,
                     goal - before)
    rests &= (done >= 0.0) & (short.max(axis=1, initial=0.0) <= LOCKED_TOLERANCE)
    ends = straight - targets[:, 3]
    loose = slack_of(ends, goal, compliance, tension[:, 0], by_force)
    loose[never] = np.inf
    for name, array in (('configurations', bodies), ('tensions', tension[:, 0]), ('pulls', ends),
                        ('slack', loose), ('residual', residual), ('jumped', done < 1.0)):
        getattr(batch, name)[rows[rests]] = array[rests]
    batch.found[rows] = rests
    for i in np.flatnonzero(rests).tolist():
        start = starts[i % len(starts)]
        states[int(rows[i])] = Equilibrium(
            bodies[i], tension[i, 0], ends[i], loose[i], float(residual[i]), int(total[i]),
            start.stiff, start.held, bool(done[i] < 1.0), start.vacuum, chain=start.chain)
