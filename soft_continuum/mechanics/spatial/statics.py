# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Statics of a spatial arm: the shape in which springs, weights, wrenches and tendons balance.

As in the plane (Statics): a minimum of the potential energy under the lengths of the tendons,
whose Lagrange multipliers are the tensions, followed from the state before it.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from soft_continuum.mechanics import _kernel
from soft_continuum.mechanics._checks import vacuum_parts
from soft_continuum.mechanics.chain import Array, SLACK
from soft_continuum.mechanics.errors import OverconstrainedError, StaticsError
from soft_continuum.mechanics.spatial._laws import HELD, STIFFNESS
from soft_continuum.mechanics.spatial._newton import LENGTH
from soft_continuum.mechanics.spatial._rotations import rotate
from soft_continuum.mechanics.spatial.arm import SpatialArm
from soft_continuum.mechanics.spatial.chain import SpatialChain, SpatialEquilibrium, System
from soft_continuum.mechanics.spatial.friction import carried

Booleans = NDArray[np.bool_]
ITERATIONS = 40  # of Newton's method in one step
STEP = 0.003  # m of pull in one step at first
LEAST_STEP = 1.0 / 4096.0  # of the way to the target
OIL, OIL_STEPS = 5e-3, 800  # of the stiffness of a joint, at first; steps until it rests
OIL_TRIED, OIL_ITERATIONS = 10, 20  # steps after which it is tried without: near its rest a few do
NUDGE = 1e-5  # rad
AT_REST = 1e-7  # N m that may be out of balance at a start whose tensions are kept
MAX_FRICTION_ITERATIONS = 100
LOCKED_TOLERANCE = 1e-6  # m: rounding of a pull against a locked arm


class _Links:
    """
    The links of an arm, on the way; each array first as it is, then as Newton's method left it.

    rotations: (2, links, 3, 3).  tension: (2, tendons) N.  taut: (2, tendons).
    """

    def __init__(self, system: System, by_force: Booleans, compliance: Array, rotations: Array,
                 tension: Array) -> None:
        """Begin with rotations (links, 3, 3) and tension (tendons,) N."""
        self.system, self.compliance = system, compliance
        self.kind = by_force.astype(np.int64)  # TENSION or LENGTH
        self.rotations, self.tension = np.array([rotations] * 2), np.array([tension] * 2)
        self.taut = self.tension > 0.0
        self.targets = np.empty((4, len(tension)))
        self.bias = np.zeros((2, len(rotations), 3))

    def balance(self, tension: Array) -> Array:
        """Return the unbalanced moments with tensions (tendons,) in N, (links, 3), N m."""
        found: Array = _kernel.functions().spatial_balance(
            self.rotations[0], tension, self.system).reshape(-1, 3)
        return found

    def lead(self, begin: Array, end: Array, step: float, least: float, damping: float = 0.0,
             most: int = ITERATIONS) -> tuple[float, int, float, int, bool]:
        """Go from targets (tendons,) to others, as _path.lead, and return what that does."""
        self.targets[0], self.targets[1] = begin, end
        found: tuple[float, int, float, int, bool] = _kernel.functions().spatial_lead(
            self.rotations, self.tension, self.taut, self.system,
            (self.kind, self.compliance, self.targets, self.bias, damping), step, least, most)
        return found

    def hold(self, others: Booleans) -> None:
        """Take the tensions that hold the shape best, those of ``others`` as they are."""
        tension, unit = self.tension[0], np.eye(len(self.kind))
        tension[~others] = 0.0
        alone = self.balance(tension).ravel()
        tendons = np.flatnonzero(~others)
        if len(tendons):
            from scipy.optimize import nnls  # 0.3 s that who has no tendons need not wait for
            levers = [self.balance(tension + unit[t]).ravel() - alone for t in tendons]
            each = np.column_stack(levers)
            try:
                tension[tendons] = nnls(each, -alone)[0]
            except RuntimeError:  # it did not end: others do as well, for what they leave is led
                tension[tendons] = np.maximum(0.0, np.linalg.lstsq(each, -alone)[0])
        self.taut[0] = tension > 0.0

    def relax(self, target: Array) -> bool:
        """
        Let an arm come to rest that has lost its equilibrium, as if in thick oil.

        The oil is thinned as long as each step goes downhill.  False when that does not end.
        """
        self.bias[:] = 0.0
        for rotation in self.rotations[0]:  # off an unstable balance
            rotate(rotation, NUDGE, NUDGE, 0.0)
        damping = OIL * float(self.system[0][:, STIFFNESS].min(axis=1).mean())
        for step in range(OIL_STEPS):
            *_, downhill = self.lead(target, target, 1.0, 1.0, damping, 1)
            if not downhill:
                damping *= 4.0
                continue
            damping *= 0.5
            self.rotations[0] = self.rotations[1]
            np.maximum(self.tension[1], 0.0, out=self.tension[0])
            self.taut[0] = (self.tension[0] > 0.0) | (
                (self.kind == LENGTH) & (self.targets[3] > target))
            if step % OIL_TRIED == 0 and self.lead(
                    target, target, 1.0, 1.0, most=OIL_ITERATIONS)[0] == 1.0:
                return True
        return False


class SpatialStatics:
    """
    Equilibria of one spatial arm; compliance: of its tendons where nothing rubs, (tendons,) m/N.

    Softening returns the springs of a segment to their natural shape; stiffening locks it, or adds
    the springs of its jam about the shape that it has.
    """

    def __init__(self, arm: SpatialArm) -> None:
        """Discretise ``arm``."""
        self.chain = SpatialChain(arm)
        self.compliance = np.array([tendon.compliance for tendon in arm.tendons])
        self._rigid = cache(self.chain.rigid)

    def solve(self, start: SpatialEquilibrium, pulls: ArrayLike, soft: Sequence[bool], *,
              tensions: ArrayLike | None = None, vacuum: Sequence[float] | None = None,
              sliding: Sequence[int] = ()) -> SpatialEquilibrium:
        """
        Return the equilibrium that follows from ``start``.

        pulls: (tendons,) m; a slack tendon carries nothing, one of SLACK never.  soft: one flag
        per segment.  tensions: (tendons,) N of tendons that are pulled by a force instead, nan
        for those that are not (default: none).  vacuum: of each stiff segment, as of the planar
        Statics.  sliding: of each tendon through its guides, for friction: 1 towards the base, -1
        towards the tip, 0 or nothing for none.  Raises ValueError for other shapes or numbers,
        OverconstrainedError when tendons are too short for a locked arm, StaticsError when no
        equilibrium is found.
        """
        tendons, segments = len(self.chain.arm.tendons), self.chain.segments
        wanted = np.array(pulls, dtype=float)
        if wanted.shape != (tendons,) or not np.all(np.isfinite(wanted) | (wanted == SLACK)):
            raise ValueError(f'pulls must be {tendons} finite numbers (m), one for each tendon, '
                             'or SLACK')
        given = np.full(tendons, np.nan)
        if tensions is not None:
            given = np.array(tensions, dtype=float)
            if given.shape != (tendons,) or np.any(np.isinf(given)) or np.any(given < 0.0):
                raise ValueError(f'tensions must be {tendons} numbers of 0 N and more, or nan')
        never = wanted == SLACK
        if never.any():
            given[never & np.isnan(given)] = 0.0
            wanted = np.where(never, start.pulls, wanted)
        mask = tuple(bool(one) for one in soft)
        if len(mask) != segments:
            raise ValueError(f'soft has {len(mask)} flags; needed: {segments}')
        if start.chain is not self.chain and start.chain.arm != self.chain.arm:
            raise ValueError('the start is a state of another arm; begin with '
                             'statics.chain.straight()')
        parts = vacuum_parts(vacuum, segments)
        ways = [int(way) for way in sliding] if any(sliding) else []
        if ways and (len(ways) != tendons or not set(sliding) <= {-1, 0, 1}):
            raise ValueError(f'sliding must be 1, 0 or -1 for each of the {tendons} tendons; '
                             f'given: {sliding!r}')
        stiff = tuple(not one for one in mask)
        if parts:  # without any vacuum there is no jam
            stiff = tuple(one and part > 0.0 for one, part in zip(stiff, parts, strict=True))
        return self._follow(self._holding(start, stiff, parts), wanted, given, ways)

    def commanded_pulls(self, state: SpatialEquilibrium, sliding: Sequence[int] = ()) -> Array:
        """Return the pulls (tendons,) m at the motors that give a state: paths and stretch."""
        compliance = self.compliance
        if any(sliding):
            compliance = carried(self.chain, state.rotations, sliding)[1]
        pulls: Array = state.pulls + compliance * np.nan_to_num(state.tensions)
        return pulls

    def _holding(self, start: SpatialEquilibrium, stiff: tuple[bool, ...],
                 vacuum: tuple[float, ...]) -> SpatialEquilibrium:
        """
        Return the start with segments that are stiff from now on, and with this vacuum.

        What is stiffened, and what more vacuum adds, holds the shape that is there.
        """
        held, angles, per = start.held, None, self.chain.joints_per_segment
        for s, segment in enumerate(self.chain.arm.segments):
            part = vacuum[s] if vacuum else 1.0
            before = start.vacuum[s] if start.vacuum else 1.0
            if not stiff[s]:
                continue
            if segment.jam.rigid and part < 1.0:
                raise ValueError(
                    f'vacuum of segment {s + 1} is {part:g}; its jam is rigid and knows 0 (soft) '
                    'and 1 (stiff) only; give the jam a ratio K or a law')
            share = (before / part)**segment.jam.stiffness_exponent if start.stiff[s] else 0.0
            if start.stiff[s] and before >= part:
                continue
            rows = slice(s * per, (s + 1) * per)
            if angles is None:
                angles, held = self.chain.joints(start.rotations), held.copy()
            held[rows] = angles[rows] - self.chain.laws.rescaled(
                s, angles[rows] - held[rows], share)
        return replace(start, held=held, stiff=stiff, vacuum=vacuum)

    def _follow(self, start: SpatialEquilibrium, pulls: Array, given: Array,
                sliding: Sequence[int]) -> SpatialEquilibrium:
        """Return the equilibrium for pulls, and where they are given, tensions."""
        rigid = self._rigid(start.stiff)
        if rigid.all():
            return self._locked(start, pulls, given)
        state = self._led(start, pulls, given, rigid)
        if not any(t.friction and way for t, way in zip(
                self.chain.arm.tendons, sliding, strict=False)):
            return state
        before = np.ones(len(self.chain.span_tendons))
        for _ in range(MAX_FRICTION_ITERATIONS):  # friction depends on the shape it leads to
            ratios, compliance = carried(self.chain, state.rotations, sliding)
            jumped, state = state.jumped, self._led(state, pulls, given, rigid, ratios, compliance)
            state = replace(state, jumped=state.jumped or jumped)
            if np.abs(ratios - before).max() < 1e-13:
                return state
            before = ratios
        raise StaticsError('the friction at the guides did not converge', state)

    def _led(self, start: SpatialEquilibrium, pulls: Array, given: Array,
             rigid: Booleans, ratios: Array | None = None, compliance: Array | None = None
             ) -> SpatialEquilibrium:
        """Lead lengths, tensions and what is out of balance at the start to the target."""
        chain = self.chain
        link, system, unchanged = chain.system(
            start.rotations, rigid,
            chain.laws.joints(start.stiff, start.vacuum, start.held), ratios)
        stretch = self.compliance if compliance is None else compliance
        by_force = ~np.isnan(given)
        before = np.where(np.isnan(start.tensions), 0.0, start.tensions)
        links = _Links(system, by_force, stretch, start.rotations[~rigid], before)
        bias = links.balance(links.tension[0])
        if np.abs(bias).max() > AT_REST:
            links.hold(by_force | (start.slack > 0.0))
            bias = links.balance(links.tension[0])
        links.bias[0] = bias
        length = chain.straight_paths - unchanged  # of what can change
        at_last = np.where(by_force, given, length - pulls)
        at_first = np.where(
            by_force, before, length - start.pulls + start.slack - stretch * links.tension[0])
        if rigid.any():
            still = np.bincount(system[6][:, 0], minlength=len(pulls)) == 0
            self._refuse_short(np.where(still & ~by_force, -at_last, 0.0), start)
        way = float(np.abs(at_last - at_first)[~by_force].max(initial=0.0))
        done, total, residual, _, _ = links.lead(
            at_first, at_last, min(1.0, STEP / max(way, STEP)), LEAST_STEP)
        if done < 1.0 and not links.relax(at_last):
            raise StaticsError(
                f'the arm loses its equilibrium after {100.0 * done:.0f} % of the way to '
                'these pulls and loads, and no other was found near it; pay out a tendon, '
                'or go there in smaller steps', start)
        tensions = links.tension[0]
        every = _kernel.functions().spatial_carry(links.rotations[0], start.rotations, link)
        paths, held = links.targets[3] + unchanged, start.held.copy()
        held[~rigid] = system[0][:, HELD]
        slack = chain.straight_paths - pulls + stretch * tensions - paths
        return SpatialEquilibrium(
            every, tensions, chain.straight_paths - paths,
            np.where(by_force | (tensions > 0.0), 0.0, np.maximum(0.0, slack)), residual, total,
            start.stiff, held, done < 1.0, start.vacuum, chain=chain)

    def _locked(self, start: SpatialEquilibrium, pulls: Array, given: Array
                ) -> SpatialEquilibrium:
        """Return a wholly rigid arm: its tendons stretch, become slack, or cannot be pulled."""
        by_force = ~np.isnan(given)
        short = np.where(by_force, 0.0, pulls - start.pulls)
        self._refuse_short(short, start)
        stretches = self.compliance > 0.0
        stretched = np.maximum(0.0, short) / np.where(stretches, self.compliance, 1.0)
        # Nothing determines what one carries that neither stretches nor is slack.
        found = np.where(stretches, stretched, np.where(short < -LOCKED_TOLERANCE, 0.0, np.nan))
        return replace(start, slack=np.maximum(0.0, -short), residual=0.0, iterations=0,
                       tensions=np.where(by_force, given, found), jumped=False)

    def _refuse_short(self, short: Array, start: SpatialEquilibrium) -> None:
        """Refuse tendons (tendons,) that are too short (m) where nothing can bend or stretch."""
        beyond = np.where(self.compliance > 0.0, 0.0, short)
        if beyond.max(initial=0.0) > LOCKED_TOLERANCE:
            worst = int(np.argmax(beyond))
            raise OverconstrainedError(
                f'every segment that {self.chain.arm.tendons[worst].name} passes is stiff and '
                f'rigid, so it cannot be pulled in by another {beyond[worst]:g} m; soften a '
                'segment', start)
