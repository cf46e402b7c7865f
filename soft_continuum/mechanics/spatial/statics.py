# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Statics of a spatial arm: the shape in which springs, weights, wrenches and tendons balance.

As in the plane (Statics): a minimum of the potential energy under the lengths of the tendons,
whose Lagrange multipliers are the tensions, followed from the state before it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from soft_continuum.mechanics import _kernel
from soft_continuum.mechanics._checks import vacuum_parts
from soft_continuum.mechanics.chain import Array, SLACK
from soft_continuum.mechanics.errors import OverconstrainedError, StaticsError
from soft_continuum.mechanics.spatial._laws import HELD, STIFFNESS
from soft_continuum.mechanics.spatial._newton import CONVERGED, LENGTH, TENSION
from soft_continuum.mechanics.spatial._rotations import rotate
from soft_continuum.mechanics.spatial.arm import SpatialArm
from soft_continuum.mechanics.spatial.chain import (
    Integers,
    SpatialChain,
    SpatialEquilibrium,
    sums,
    System,
)
from soft_continuum.mechanics.spatial.friction import carried
from soft_continuum.mechanics.spatial.orientations import orthonormal

Booleans = NDArray[np.bool_]
ITERATIONS = 40  # of Newton's method in one step
STEP = 0.003  # m of pull in one step at first
LEAST_STEP = 1.0 / 4096.0  # of the way to the target
MAX_ITERATIONS = 4000  # on the way to the target
OIL, OIL_STEPS = 5e-3, 120  # of the stiffness of a joint, at first; steps until it rests
OIL_ITERATIONS = 20  # without oil, to see whether it is near its rest: then a few will do
NUDGE = 1e-5  # rad
AT_REST = 1e-7  # N m that may be out of balance at a start whose tensions are kept
MAX_FRICTION_ITERATIONS = 100
LOCKED_TOLERANCE = 1e-6  # m: rounding of a pull against a locked arm


@dataclass(eq=False)
class _Links:
    """
    The links of an arm, on the way.

    rotations: (links, 3, 3).  tension: (tendons,) N.  taut: (tendons,).  kind: (tendons,) LENGTH
    or TENSION.  compliance: (tendons,) m/N.
    """

    system: System
    kind: Integers
    compliance: Array
    rotations: Array
    tension: Array
    taut: Booleans

    def balance(self, tension: Array) -> Array:
        """Return the unbalanced moments with tensions (tendons,) in N, (links, 3), N m."""
        found: Array = _kernel.functions().spatial_balance(self.rotations, tension, self.system)
        return found

    def newton(self, target: Array, bias: Array, damping: float = 0.0, most: int = ITERATIONS
               ) -> tuple['_Links', int, int, float, bool]:
        """Return links after Newton's method, and what else it says."""
        there = replace(self, rotations=self.rotations.copy(), tension=self.tension.copy(),
                        taut=self.taut.copy())
        return there, *_kernel.functions().spatial_newton(
            there.rotations, there.tension, there.taut, self.system,
            (self.kind, target, self.compliance, bias, damping), most)

    def hold(self, others: Booleans) -> None:
        """Take the tensions that hold the shape best, those of ``others`` as they are."""
        unit = np.eye(len(self.kind))
        self.tension[~others] = 0.0
        alone = self.balance(self.tension).ravel()
        tendons = np.flatnonzero(~others)
        if len(tendons):
            from scipy.optimize import nnls  # 0.3 s that who has no tendons need not wait for
            levers = [self.balance(self.tension + unit[t]).ravel() - alone for t in tendons]
            each = np.column_stack(levers)
            try:
                self.tension[tendons] = nnls(each, -alone)[0]
            except RuntimeError:  # it did not end: others do as well, for what they leave is led
                self.tension[tendons] = np.maximum(0.0, np.linalg.lstsq(each, -alone)[0])
        self.taut = self.tension > 0.0

    def relax(self, target: Array) -> '_Links | None':
        """
        Return where an arm comes to rest that has lost its equilibrium, as if in thick oil.

        The oil is thinned as long as each step goes downhill.  None when that does not end.
        """
        links, nothing = self, np.zeros((len(self.rotations), 3))
        for rotation in links.rotations:  # off an unstable balance
            rotate(rotation, np.array([NUDGE, NUDGE, 0.0]))
        damping = OIL * float(self.system[0][:, STIFFNESS].min(axis=1).mean())
        for _ in range(OIL_STEPS):
            there, *_, downhill = links.newton(target, nothing, damping, 1)
            if not downhill:
                damping *= 4.0
                continue
            damping *= 0.5
            links = there
            np.maximum(links.tension, 0.0, out=links.tension)
            links.taut = (links.tension > 0.0) | (
                (self.kind == LENGTH) & (links.paths() > target))
            found, status, *_ = links.newton(target, nothing, most=OIL_ITERATIONS)
            if status == CONVERGED:
                return found
        return None

    def paths(self) -> Array:
        """Return what of the path of each tendon can change, (tendons,), m."""
        entries, vectors, spans, constants = self.system[4:8]
        across = constants.copy()
        np.add.at(across, np.repeat(np.arange(len(spans)), spans[:, 2] - spans[:, 1]),
                  np.einsum('eij,ej->ei', self.rotations[entries], vectors))
        return sums(spans[:, 0], np.linalg.norm(across, axis=1), len(self.kind))


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
        self._all_free: tuple[Integers, System, Array] | None = None

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
        given = np.full(tendons, np.nan) if tensions is None else np.array(tensions, dtype=float)
        if given.shape != (tendons,) or np.any(np.isinf(given)) or np.any(given < 0.0):
            raise ValueError(f'tensions must be {tendons} numbers of 0 N and more, or nan')
        given = np.where((wanted == SLACK) & np.isnan(given), 0.0, given)
        wanted = np.where(wanted == SLACK, start.pulls, wanted)
        mask = tuple(bool(one) for one in soft)
        if len(mask) != segments:
            raise ValueError(f'soft has {len(mask)} flags; needed: {segments}')
        if start.chain.arm != self.chain.arm:
            raise ValueError('the start is a state of another arm; begin with '
                             'statics.chain.straight()')
        parts = vacuum_parts(vacuum, segments)
        ways = np.array(sliding, dtype=float) if any(sliding) else np.zeros(tendons)
        if ways.shape != (tendons,) or not np.all(np.isin(ways, (-1.0, 0.0, 1.0))):
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

    def _follow(self, start: SpatialEquilibrium, pulls: Array, given: Array, sliding: Array
                ) -> SpatialEquilibrium:
        """Return the equilibrium for pulls, and where they are given, tensions."""
        rigid = self.chain.rigid([not one for one in start.stiff])
        if rigid.all():
            return self._locked(start, pulls, given)
        state = self._led(start, pulls, given, rigid)
        rubs = any(t.friction and way for t, way in zip(
            self.chain.arm.tendons, sliding, strict=True))
        if not rubs:
            return state
        before = np.ones(len(self.chain.span_tendons))
        for _ in range(MAX_FRICTION_ITERATIONS):  # friction depends on the shape it leads to
            ratios, compliance = carried(self.chain, state.rotations, sliding.tolist())
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
        link, system, unchanged = self._system(start, rigid, ratios)
        stretch = self.compliance if compliance is None else compliance
        first = np.flatnonzero(~rigid)
        by_force = ~np.isnan(given)
        links = _Links(system, np.where(by_force, TENSION, LENGTH), stretch,
                       np.ascontiguousarray(start.rotations[first]),
                       np.nan_to_num(start.tensions), start.tensions > 0.0)
        bias = links.balance(links.tension)
        if np.abs(bias).max() > AT_REST:
            links.hold(by_force | (start.slack > 0.0))
            bias = links.balance(links.tension)
        at_last = np.where(by_force, given, chain.straight_paths - pulls - unchanged)
        self._refuse_short(np.where(np.isin(np.arange(len(pulls)), system[6][:, 0]) | by_force,
                                    0.0, -at_last), start)
        at_first = np.where(by_force, np.nan_to_num(start.tensions),
                            chain.straight_paths - start.pulls - unchanged + start.slack
                            - stretch * links.tension)
        way = float(np.abs(at_last - at_first)[~by_force].max(initial=0.0))
        done, step, total, residual, jumped = 0.0, min(1.0, STEP / max(way, STEP)), 0, 0.0, False
        while done < 1.0:
            part = min(1.0, done + step)
            there, status, used, residual, _ = links.newton(
                at_first + part * (at_last - at_first), (1.0 - part) * bias)
            total += used
            if status == CONVERGED:
                links, done, step = there, part, 2.0 * step
                continue
            step *= 0.5
            if step < LEAST_STEP or total > MAX_ITERATIONS:
                found = links.relax(at_last)
                if found is None:
                    raise StaticsError(
                        f'the arm loses its equilibrium after {100.0 * done:.0f} % of the way to '
                        'these pulls and loads, and no other was found near it; pay out a tendon, '
                        'or go there in smaller steps', start)
                links, jumped = found, True
                break
        turned = np.concatenate([
            links.rotations @ start.rotations[first].transpose(0, 2, 1), np.eye(3)[None]])
        every = orthonormal(turned[link] @ start.rotations)  # else rounding triples in each solve
        paths = chain.paths(every)
        allowed = np.where(by_force, paths,
                           chain.straight_paths - pulls + stretch * links.tension)
        held = start.held.copy()
        held[first] = system[0][:, HELD]
        return SpatialEquilibrium(
            every, links.tension, chain.straight_paths - paths,
            np.where(links.tension > 0.0, 0.0, np.maximum(0.0, allowed - paths)), residual, total,
            start.stiff, held, jumped, start.vacuum, chain=chain)

    def _system(self, start: SpatialEquilibrium, rigid: Booleans, ratios: Array | None
                ) -> tuple[Integers, System, Array]:
        """Return chain.system; where all is free, it is laid out once."""
        soft = [not one for one in start.stiff]
        joints = self.chain.laws.joints(soft, start.vacuum, start.held)
        if rigid.any() or ratios is not None:
            return self.chain.system(start.rotations, rigid, joints, ratios)
        if self._all_free is None:
            self._all_free = self.chain.system(start.rotations, rigid, joints)
        link, (_, *others), unchanged = self._all_free
        return link, (joints, *others), unchanged

    def _locked(self, start: SpatialEquilibrium, pulls: Array, given: Array
                ) -> SpatialEquilibrium:
        """Return a wholly rigid arm: its tendons stretch, become slack, or cannot be pulled."""
        by_force = ~np.isnan(given)
        short = np.where(by_force, 0.0, pulls - start.pulls)
        self._refuse_short(short, start)
        stretches = self.compliance > 0.0
        stretched = np.maximum(0.0, short) / np.where(stretches, self.compliance, 1.0)
        # Nothing determines what one carries that neither stretches nor is slack.
        carried = np.where(stretches, stretched, np.where(short < -LOCKED_TOLERANCE, 0.0, np.nan))
        return replace(start, slack=np.maximum(0.0, -short), iterations=0,
                       tensions=np.where(by_force, given, carried))

    def _refuse_short(self, short: Array, start: SpatialEquilibrium) -> None:
        """Refuse tendons (tendons,) that are too short (m) where nothing can bend or stretch."""
        beyond = np.where(self.compliance > 0.0, 0.0, short)
        if beyond.max(initial=0.0) > LOCKED_TOLERANCE:
            worst = int(np.argmax(beyond))
            raise OverconstrainedError(
                f'every segment that {self.chain.arm.tendons[worst].name} passes is stiff and '
                f'rigid, so it cannot be pulled in by another {beyond[worst]:g} m; soften a '
                'segment', start)
