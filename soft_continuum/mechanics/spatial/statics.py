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
from soft_continuum.mechanics.chain import Array, SLACK
from soft_continuum.mechanics.errors import OverconstrainedError, StaticsError
from soft_continuum.mechanics.spatial._assembly import HELD, STIFFNESS
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
from soft_continuum.mechanics.spatial.orientations import orthonormal

Booleans = NDArray[np.bool_]
ITERATIONS = 40  # of Newton's method in one step
STEP = 0.003  # m of pull in one step at first
LEAST_STEP = 1.0 / 4096.0  # of the way to the target
OIL, OIL_STEPS = 5e-3, 400  # of the stiffness of a joint, at first; steps until it rests
NUDGE = 1e-5  # rad
AT_REST = 1e-7  # N m that may be out of balance at a start whose tensions are kept
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
            self.tension[tendons] = nnls(np.column_stack(levers), -alone)[0]
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
            found, status, *_ = links.newton(target, nothing)
            if status == CONVERGED:
                return found
        return None

    def paths(self) -> Array:
        """Return what of the path of each tendon can change, (tendons,), m."""
        entries, vectors, spans, constants = self.system[4:]
        across = constants.copy()
        np.add.at(across, np.repeat(np.arange(len(spans)), spans[:, 2] - spans[:, 1]),
                  np.einsum('eij,ej->ei', self.rotations[entries], vectors))
        return sums(spans[:, 0], np.linalg.norm(across, axis=1), len(self.kind))


class SpatialStatics:
    """
    Equilibria of one spatial arm.

    Softening returns the springs of a segment to their natural shape; stiffening locks it, or adds
    the springs of its jam about the shape that it has.
    """

    def __init__(self, arm: SpatialArm) -> None:
        """Discretise ``arm``."""
        self.chain = SpatialChain(arm)
        self._compliance = np.array([tendon.compliance for tendon in arm.tendons])
        self._all_soft: tuple[Integers, System, Array] | None = None

    @property
    def compliance(self) -> Array:
        """By how much each tendon stretches, (tendons,), m/N."""
        return self._compliance

    def solve(self, start: SpatialEquilibrium, pulls: ArrayLike, soft: Sequence[bool], *,
              tensions: ArrayLike | None = None, vacuum: Sequence[float] | None = None,
              sliding: Sequence[int] = ()) -> SpatialEquilibrium:
        """
        Return the equilibrium that follows from ``start``.

        pulls: (tendons,) m; a slack tendon carries nothing, one of SLACK never.  soft: one flag
        per segment.  tensions: (tendons,) N of tendons that are pulled by a force instead, nan
        for those that are not (default: none).  vacuum, sliding: as in Statics.solve, and not
        used: in space a jam is always full, and tendons do not rub.  Raises ValueError for other
        shapes or numbers, OverconstrainedError when tendons are too short for a locked arm,
        StaticsError when no equilibrium is found.
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
        return self._follow(self._stiffened(start, mask), wanted, mask, given)

    def _stiffened(self, start: SpatialEquilibrium, soft: tuple[bool, ...]) -> SpatialEquilibrium:
        """Return the start with the shape held that segments have which are stiff from now on."""
        newly = [not stiff and not now_soft for stiff, now_soft in zip(
            start.stiff, soft, strict=True)]
        if not any(newly):
            return start
        joints = np.repeat(newly, self.chain.joints_per_segment)
        held = np.where(joints[:, None], self.chain.joints(start.rotations), start.held)
        return replace(start, held=held)

    def _follow(self, start: SpatialEquilibrium, pulls: Array, soft: tuple[bool, ...],
                given: Array) -> SpatialEquilibrium:
        """Lead lengths, tensions and what is out of balance at the start to the target."""
        chain = self.chain
        link, system, unchanged = self._system(start, soft)
        first = np.flatnonzero(np.diff(link, prepend=-1))
        if not len(first):
            return self._locked(start, pulls, soft, given)
        by_force = ~np.isnan(given)
        links = _Links(system, np.where(by_force, TENSION, LENGTH), self._compliance,
                       np.ascontiguousarray(start.rotations[first]), start.tensions.copy(),
                       start.tensions > 0.0)
        bias = links.balance(links.tension)
        if np.abs(bias).max() > AT_REST:
            links.hold(by_force | (start.slack > 0.0))
            bias = links.balance(links.tension)
        at_last = np.where(by_force, given, chain.straight_paths - pulls - unchanged)
        self._refuse_short(np.where(np.isin(np.arange(len(pulls)), system[6][:, 0]) | by_force,
                                    0.0, -at_last), start)
        at_first = np.where(by_force, start.tensions,
                            chain.straight_paths - start.pulls - unchanged + start.slack
                            - self._compliance * links.tension)
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
            if step < LEAST_STEP:
                found = links.relax(at_last)
                if found is None:
                    raise StaticsError(
                        'the arm loses its equilibrium, and no other was found; is a tendon too '
                        'short for every shape?', start)
                links, jumped = found, True
                break
        turned = np.concatenate([
            links.rotations @ start.rotations[first].transpose(0, 2, 1), np.eye(3)[None]])
        every = orthonormal(turned[link] @ start.rotations)  # else rounding triples in each solve
        paths = chain.paths(every)
        allowed = np.where(by_force, paths,
                           chain.straight_paths - pulls + self._compliance * links.tension)
        return SpatialEquilibrium(
            every, links.tension, chain.straight_paths - paths,
            np.where(links.tension > 0.0, 0.0, np.maximum(0.0, allowed - paths)), residual, total,
            tuple(not one for one in soft), chain.slid(start.held, every, soft), jumped,
            chain=chain)

    def _system(self, start: SpatialEquilibrium, soft: tuple[bool, ...]
                ) -> tuple[Integers, System, Array]:
        """Return chain.system; where all is soft, it is laid out once."""
        if not all(soft):
            return self.chain.system(start, soft)
        if self._all_soft is None:
            self._all_soft = self.chain.system(start, soft)
        link, (joints, *others), unchanged = self._all_soft
        joints = joints.copy()
        joints[:, HELD] = start.held
        return link, (joints, *others), unchanged

    def _locked(self, start: SpatialEquilibrium, pulls: Array, soft: tuple[bool, ...],
                given: Array) -> SpatialEquilibrium:
        """Return a wholly rigid arm: its tendons stretch, become slack, or cannot be pulled."""
        by_force = ~np.isnan(given)
        short = np.where(by_force, 0.0, pulls - start.pulls)
        self._refuse_short(short, start)
        gives = self._compliance > 0.0
        stretched = np.maximum(0.0, short) / np.where(gives, self._compliance, 1.0)
        held = np.where(short < 0.0, 0.0, start.tensions)
        tensions = np.where(gives, stretched, held)
        return replace(start, slack=np.maximum(0.0, -short), iterations=0,
                       tensions=np.where(by_force, np.nan_to_num(given), tensions),
                       stiff=tuple(not one for one in soft))

    def _refuse_short(self, short: Array, start: SpatialEquilibrium) -> None:
        """Refuse tendons (tendons,) that are too short (m) where nothing can bend or stretch."""
        beyond = np.where(self._compliance > 0.0, 0.0, short)
        if beyond.max(initial=0.0) > LOCKED_TOLERANCE:
            worst = int(np.argmax(beyond))
            raise OverconstrainedError(
                f'every segment that {self.chain.arm.tendons[worst].name} passes is stiff and '
                f'rigid, so it cannot be pulled in by another {beyond[worst]:g} m; soften a '
                'segment', start)
