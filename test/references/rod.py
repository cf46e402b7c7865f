# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Kirchhoff rods in space between the discs: the limit of a spatial chain for ever more bodies.

A rod of constant length bends and twists (Antman, Nonlinear Problems of Elasticity, 2005, ch. 8;
Rucker and Webster, IEEE Trans. Robotics 27, 2011, for tendons).  Over the length s,

    p' = R e3,   R' = R [K^-1 R^T m]x,   n' = -f,   m' = -p' x n

with position p, orientation R, inner force n and moment m, stiffness K and weight f per length.
Tendons are straight between guides and pull on these as point loads.  Every rod from guide to
guide is integrated from its lower end with the force and moment there (multiple shooting), which
Newton's method finds; its derivatives are complex steps, hence exact to rounding.

Nothing of the solver is used but a first guess, and which tendons are taut.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.chain import Equilibrium
from soft_continuum.mechanics.space.chain import SpaceChain
from soft_continuum.mechanics.statics import StaticsError

INTERVALS = 32  # of each rod from guide to guide, by the classical method of Runge and Kutta
MAX_ITERATIONS = 30
TOLERANCE = 1e-10  # N, N m and m by which the equations are missed at most
JUST_TAUT = 1e-9  # m by which a slack tendon may come out too short
STEP = 1e-40
UP = np.array([0.0, 0.0, 1.0])

Complex = NDArray[Any]


@dataclass(frozen=True, eq=False)
class SpatialRod:
    """
    A state of an arm with elastic rods in which all forces and moments balance.

    points: (2 * discs, 3) m, as of Equilibrium.  axes: (discs, 3), of the discs, base
    first.  tensions, pulls: (tendons,) N and m.  residual: N, N m and m, largest.
    """

    points: Array
    axes: Array
    tensions: Array
    pulls: Array
    residual: float


def solve_rods(guess: Equilibrium, pulls: Sequence[float] | Array
               ) -> SpatialRod:
    """
    Return the equilibrium of the rods next to that of a chain whose segments all are soft.

    guess: the equilibrium of the chain.  pulls: (tendons,) m at the motors; those that are taut
    are the ones of the guess.  Raises ValueError for an arm with stiff segments, friction or
    measured laws, StaticsError, with the guess, where Newton's method finds none.
    """
    arm = guess.chain.arm
    if any(guess.stiff) or any(s.friction or s.soft_law is not None for s in arm.segments):
        raise ValueError('rods are soft and linear, and do not rub; a segment is not')
    return _Problem(guess, np.array(pulls, dtype=float)).solve()


@dataclass(frozen=True, eq=False)
class _Walk:
    """What rods do that are integrated from the base up, each array with any number of columns."""

    lower: list[Complex]  # of each rod: position of its lower end, (columns, 3)
    upper: list[Complex]
    turns: list[Complex]  # orientation at its upper end, (columns, 3, 3)
    forces: list[Complex]  # inner force and moment there
    moments: list[Complex]
    paths: list[Complex]  # of each tendon, (columns,)
    pulling: list[list[tuple[Complex, Complex, Complex]]]
    """Of each rod, for each tendon along it: force on the lower guide, both guides."""


class _Problem:
    """Rods from guide to guide, and the equations at their ends."""

    def __init__(self, guess: Equilibrium, pulls: Array) -> None:
        self.arm: Arm = guess.chain.arm
        self.guess, self.parts = guess, self.arm.spacers + 1
        self.rods = len(self.arm.segments) * self.parts
        self.taut = np.flatnonzero(guess.tensions > 0.0)
        self.gravity = np.array(self.arm.gravity)
        self.straight = np.array([self.straight_path(t) for t in range(len(pulls))])
        self.target = self.straight - pulls

    def solve(self) -> SpatialRod:
        """Return the equilibrium of the rods."""
        unknowns, residual = self.first_guess(), np.inf
        for _ in range(MAX_ITERATIONS):
            steps = unknowns + 1j * STEP * np.vstack([
                np.zeros(len(unknowns)), np.eye(len(unknowns))])
            missed = self.missed(steps)
            residual = float(np.abs(missed[0]).max())
            if not residual > TOLERANCE:
                break
            unknowns = unknowns - np.linalg.solve(missed[1:].imag.T / STEP, missed[0].real)
        if not residual <= TOLERANCE:
            raise StaticsError(f'the rods are off balance by {residual:g} N or N m after '
                               f'{MAX_ITERATIONS} iterations', self.guess)
        walk = self.walk(unknowns)
        tensions = np.zeros(len(self.arm.tendons))
        tensions[self.taut] = unknowns[6 * self.rods:]
        points, axes = [np.zeros(3), self.arm.discs[0].height * UP], [UP]
        for s, disc in enumerate(self.arm.discs[1:], start=1):
            last = s * self.parts - 1
            axes.append(np.real(walk.turns[last][0, :, 2]))
            points.append(np.real(walk.upper[last][0]))
            points.append(points[-1] + disc.height * axes[-1])
        paths = np.real([path[0] for path in walk.paths])
        short = np.where(tensions > 0.0, 0.0, paths - self.target)
        if short.max(initial=0.0) > JUST_TAUT or tensions.min(initial=0.0) < 0.0:
            raise StaticsError('other tendons are taut with rods than with the chain; one of more '
                               'bodies per segment may be nearer', self.guess)
        return SpatialRod(np.array(points), np.array(axes), tensions, self.straight - paths,
                          residual)

    def first_guess(self) -> Array:
        """Return force and moment at the lower end of each rod, and tensions, from the chain."""
        guess, arm, chain = self.guess, self.arm, self.guess.chain
        assert isinstance(chain, SpaceChain)
        bodies = chain.bodies // len(arm.segments) - 1
        found = np.zeros(6 * self.rods + len(self.taut))
        turned = np.concatenate([np.eye(3)[None], guess.rotations])
        joints = guess.joint_angles * chain.laws.stiffness
        for r in range(self.rods):
            s, k = divmod(r, self.parts)
            body = s * (bodies + 1) + round(k * bodies / self.parts)
            found[6 * r + 3:6 * r + 6] = turned[body] @ joints[body]
            found[6 * r:6 * r + 3] = self.load_above(r)
        for t, guides in enumerate(guess.tendon_points):
            for r in range(arm.tendons[t].end * self.parts):
                at = r + r // self.parts  # between two segments a tendon passes a disc
                run = guides[at + 1] - guides[at]
                found[6 * r:6 * r + 3] -= guess.tensions[t] * run / np.linalg.norm(run)
        found[6 * self.rods:] = guess.tensions[self.taut]
        return found

    def load_above(self, rod: int) -> Array:
        """Return the weights and forces from the lower end of a rod on, (3,), N."""
        s, k = divmod(rod, self.parts)
        segments, discs = self.arm.segments[s:], self.arm.discs[s + 1:]
        mass = sum(one.mass for one in segments) - segments[0].mass * k / self.parts
        mass += sum(disc.mass for disc in discs) + self.arm.payload
        load = mass * self.gravity
        for wrench in self.arm.wrenches:
            if wrench.disc > s:
                load = load + np.array(wrench.force)
        return load

    def place(self, tendon: int, segment: int, part: float) -> Array:
        """Return where a guide is from the backbone, in its cross-section, (3,), m."""
        arm = self.arm
        height = arm.discs[0].height + part * arm.segments[segment].length + sum(
            one.length + disc.height for one, disc in zip(
                arm.segments[:segment], arm.discs[1:], strict=False))
        routed = arm.tendons[tendon]
        angle, offset = routed.angle + routed.twist * height, routed.offset_at(segment, part)
        return offset * np.array([np.cos(angle), np.sin(angle), 0.0])

    def straight_path(self, tendon: int) -> float:
        """Return the length of a tendon through the rods of the straight arm, m."""
        total = 0.0
        for r in range(self.arm.tendons[tendon].end * self.parts):
            s, k = divmod(r, self.parts)
            across = (self.place(tendon, s, (k + 1) / self.parts)
                      - self.place(tendon, s, k / self.parts))
            total += float(np.hypot(self.arm.segments[s].length / self.parts,
                                    np.linalg.norm(across)))
        return total

    def walk(self, unknowns: Array | Complex) -> _Walk:
        """Integrate all rods from unknowns (columns, unknowns) or (unknowns,)."""
        columns = np.atleast_2d(unknowns)
        count = len(columns)
        place = np.tile(self.arm.discs[0].height * UP, (count, 1)).astype(complex)
        turn = np.tile(np.array([1.0, 0.0, 0.0, 0.0]), (count, 1)).astype(complex)
        found = _Walk([], [], [], [], [], [np.zeros(count, complex) for _ in self.arm.tendons], [])
        tension = np.zeros((count, len(self.arm.tendons)), complex)
        tension[:, self.taut] = columns[:, 6 * self.rods:]
        for r in range(self.rods):
            s, k = divmod(r, self.parts)
            segment = self.arm.segments[s]
            if k == 0 and s > 0:  # through the disc
                place = place + self.arm.discs[s].height * _matrix(turn)[:, :, 2]
            start = place, _matrix(turn)
            stiffness = np.array([segment.stiffness_x, segment.stiffness_y,
                                  segment.torsional_stiffness])
            weight = segment.mass / segment.length * self.gravity
            force, moment = columns[:, 6 * r:6 * r + 3], columns[:, 6 * r + 3:6 * r + 6]
            place, turn, moment = _integrated(
                place, turn, force, moment, 1.0 / stiffness, weight, segment.length / self.parts)
            end = _matrix(turn)
            found.lower.append(start[0])
            found.upper.append(place)
            found.turns.append(end)
            found.forces.append(force - weight * segment.length / self.parts)
            found.moments.append(moment)
            along = []
            for t, tendon in enumerate(self.arm.tendons):
                if tendon.end <= s:
                    along.append((np.zeros((count, 3), complex),) * 3)
                    continue
                low = start[0] + start[1] @ self.place(t, s, k / self.parts)
                high = place + end @ self.place(t, s, (k + 1) / self.parts)
                length = np.sqrt(((high - low)**2).sum(axis=1))
                found.paths[t] += length
                along.append(((tension[:, t] / length)[:, None] * (high - low), low, high))
            found.pulling.append(along)
        return found

    def missed(self, unknowns: Array | Complex) -> Complex:
        """Return by how much each equation is missed, (columns, unknowns)."""
        arm, walk = self.arm, self.walk(unknowns)
        left = []
        for r in range(self.rods):
            s = r // self.parts
            force, moment = np.zeros(3, complex), np.zeros(3, complex)  # from above, at its end
            here = walk.upper[r]
            if r + 1 < self.rods:
                force, moment = unknowns[:, 6 * r + 6:6 * r + 9], unknowns[:, 6 * r + 9:6 * r + 12]
                moment = moment + np.cross(walk.lower[r + 1] - here, force)
            if (r + 1) % self.parts == 0:
                for load, lever, turning in self.on_disc(s + 1):
                    force = force + load
                    moment = moment + turning + np.cross(
                        lever * walk.turns[r][:, :, 2], load + 0.0 * here)
            for t in range(len(arm.tendons)):
                pulled, _, high = walk.pulling[r][t]
                force = force - pulled
                moment = moment - np.cross(high - here, pulled)
                if r + 1 < self.rods:
                    on, low, _ = walk.pulling[r + 1][t]
                    force = force + on
                    moment = moment + np.cross(low - here, on)
            left += [walk.forces[r] - force, walk.moments[r] - moment]
        lengths = [(walk.paths[t] - self.target[t]
                    - arm.compliance[t] * unknowns[:, 6 * self.rods + i])[:, None]
                   for i, t in enumerate(self.taut)]
        return np.hstack(left + lengths)

    def on_disc(self, disc: int) -> list[tuple[Array, float, Array]]:
        """Return forces N on a disc, how far above its bottom (m), and moments, N m."""
        body, nothing = self.arm.discs[disc], np.zeros(3)
        loads = [(body.mass * self.gravity, 0.5 * body.height, nothing)]
        if disc == len(self.arm.discs) - 1:
            loads.append((self.arm.payload * self.gravity, body.height, nothing))
        loads += [(np.array(wrench.force), 0.5 * body.height, np.array(wrench.moment))
                  for wrench in self.arm.wrenches if wrench.disc == disc]
        return loads


def _integrated(place: Complex, turn: Complex, force: Complex, moment: Complex,
                flexibility: Array, weight: Array, length: float
                ) -> tuple[Complex, Complex, Complex]:
    """Return position (columns, 3), quaternion w, x, y, z (columns, 4) and moment at the end."""
    def rates(s: float, state: Complex) -> Complex:
        matrix = _matrix(state[:, 3:7])
        bend = np.einsum('cji,cj->ci', matrix, state[:, 7:]) * flexibility
        axis = matrix[:, :, 2]
        return np.hstack([axis, 0.5 * _product(state[:, 3:7], bend),
                          -np.cross(axis, force - weight * s)])

    step, state = length / INTERVALS, np.hstack([place, turn, moment])
    for i in range(INTERVALS):
        s = i * step
        k1 = rates(s, state)
        k2 = rates(s + 0.5 * step, state + 0.5 * step * k1)
        k3 = rates(s + 0.5 * step, state + 0.5 * step * k2)
        k4 = rates(s + step, state + step * k3)
        state = state + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return state[:, :3], state[:, 3:7], state[:, 7:]


def _product(turn: Complex, rate: Complex) -> Complex:
    """Return a quaternion (columns, 4) times (0, rate)."""
    w, vector = turn[:, :1], turn[:, 1:]
    return np.hstack([-(vector * rate).sum(axis=1, keepdims=True),
                      w * rate + np.cross(vector, rate)])


def _matrix(turn: Complex) -> Complex:
    """Return the rotation matrices (columns, 3, 3) of quaternions (columns, 4), of any length."""
    w, x, y, z = (turn / np.sqrt((turn**2).sum(axis=1, keepdims=True))).T
    return np.moveaxis(np.array([
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)]]), -1, 0)
