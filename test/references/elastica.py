# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The arm with elastic rods for its soft segments: what the rigid chain is measured against.

A soft segment is a planar Kirchhoff rod (an inextensible elastica) of stiffness E I with its
weight spread evenly; discs are rigid and stiff segments keep the shape they are held in.  With arc
length s, tangent angle theta, curvature kappa and n the force that the part above exerts (its
weight and the tendons that cross the cut):

    x' = sin(theta)  z' = cos(theta)  theta' = kappa  E I kappa' = n_z sin(theta) - n_x cos(theta)

(S. S. Antman, Nonlinear Problems of Elasticity, 2nd ed., 2005, ch. 4: inextensible, unshearable).
Tendons touch discs only, so their part of n is constant along a segment.  All soft segments are
mapped to 0..1 and solved at once, as one boundary value problem by collocation.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_bvp

from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.chain import Equilibrium, SLACK
from soft_continuum.mechanics.plane.chain import PlaneChain
from soft_continuum.mechanics.statics import Statics, StaticsError

TOLERANCE = 1e-9  # residual, relative; lengths and angles come out about 1e-13 of themselves
JUST_TAUT = 1e-10  # m by which a slack tendon may come out too short
SAME_BRANCH = 0.35  # rad: a tangent further from the chain's is not the equilibrium looked for
INTERVALS = 40  # of the first mesh
MAX_NODES = 5000
SIDES = np.array([[1.0], [-1.0]])  # right, left

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Rod:
    """
    A state of the arm with elastic rods in which all moments balance.

    points: (2 * discs, 3), x and z in m and tangent angle in rad at the calculation points, as
    PlaneChain.points.  bending_angles: (segments,) rad.  tensions, pulls, slack: (2,) in N, m and
    m of the right and left tendon, as in Equilibrium.  residual: largest relative residual of the
    differential equations (rms over a mesh interval) and of the end conditions.
    """

    points: Array
    bending_angles: Array
    tensions: Array
    pulls: Array
    slack: Array
    residual: float


class Elastica:
    """Equilibria of one arm whose soft segments are elastic rods."""

    def __init__(self, arm: Arm) -> None:
        """Prepare the rigid chain of ``arm`` that gives the first guess."""
        if arm.tendons[0].axial_stiffness < np.inf:
            raise ValueError('the tendons of the rods do not stretch')
        if arm.tendons[0].friction > 0.0:
            raise ValueError('the model of rods knows no friction; leave it out with '
                             'arm.without_friction()')
        if any(s.soft_law is not None for s in arm.segments):
            raise ValueError('a rod is linear: a segment with a moment-curvature law has none')
        self.chain = PlaneChain(arm)
        self._statics = Statics(arm)

    def solve(self, start: Equilibrium, pulls: Sequence[float], soft: Sequence[bool]) -> Rod:
        """
        Return the equilibrium of the rods for given pulls, next to the one that the chain finds.

        start: state of this arm's rigid chain from which the chain is followed; a stiff segment
        keeps its polyline.  pulls: (right, left) in m, how much shorter each tendon is than in
        the straight arm, SLACK for one that never carries.  soft: one flag per segment.

        The chain's equilibrium is stable; the rods' is taken to be so because it is near, within
        SAME_BRANCH in every tangent.  Raises StaticsError, with the chain's state, when there is
        none, and whatever Statics.solve raises.
        """
        guess = self._statics.solve(start, pulls, soft)
        mask = np.array(soft, dtype=bool)
        if not mask.any():
            q = guess.joint_angles
            return Rod(self.chain.plane_points(q), self.chain.bending_angles(q), guess.tensions,
                       guess.pulls, guess.slack, 0.0)
        failure = StaticsError('with every set of taut tendons that balances the rods a tendon '
                               'has to push or another one is too short', guess)
        target = np.array(pulls, dtype=float)
        taut_sets = np.array(list(product((True, False), repeat=2)))
        changes = (taut_sets != guess.taut).sum(axis=1)
        for taut in taut_sets[np.argsort(changes, kind='stable')]:
            if np.any(taut & (target == SLACK)):
                continue
            try:
                rod = _Problem(self.chain, guess, mask, target, taut).solve()
                if np.all(np.where(taut, rod.tensions >= 0.0, rod.pulls >= target - JUST_TAUT)):
                    return rod
            except StaticsError as error:
                failure = error
        raise failure


class _Problem:
    """
    One boundary value problem: which segments are rods, which tendons are taut.

    Unknown functions of s / l in 0..1, stacked as (4, rods): tangent angle theta, curvature times
    length kappa l, and position from the lower end x / l, z / l.  Unknown parameters: the tendons'
    part of n over E I / l^2 in every rod, stacked as (2, rods), and the taut tendons' tensions.
    """

    def __init__(self, chain: PlaneChain, guess: Equilibrium, soft: Mask, pulls: Array,
                 taut: Mask) -> None:
        self.chain, self.guess, self.soft, self.taut = chain, guess, soft, taut
        self.target = chain.straight_paths - pulls
        arm, q, top = chain.arm, guess.joint_angles, chain.last_body[soft]
        self.length, stiffness, mass = np.array(
            [(s.length, s.stiffness_y, s.mass) for s in arm.segments])[soft].T
        self.flexibility, self.guides = self.length**2 / stiffness, chain.guides[soft]
        weight = self.flexibility * np.array(arm.gravity)[[[0], [2]]]
        above = np.cumsum(chain.body_masses[::-1])[::-1][top]
        self.own_weight = weight * mass
        self.end_weight = weight * (above + arm.payload)
        for wrench in arm.wrenches:
            beyond = wrench.disc > np.flatnonzero(soft)
            self.end_weight += beyond * self.flexibility * np.array(wrench.force)[[[0], [2]]]

        # Between a rod and the next: a disc, and stiff segments with their discs.  They turn with
        # the rod's upper end, so that all their load coefficients add up to two.
        free = np.repeat(soft, chain.joints_per_segment)
        held = np.cumsum(np.where(free, 0.0, q))
        between = np.cumsum(free) == np.cumsum(free)[top][:, None]
        turn = held - held[top][:, None]
        sine, cosine = np.sin(turn), np.cos(turn)
        wx, wz = chain.load_coefficients.T
        self.rigid_x = (between * (wx * cosine - wz * sine)).sum(axis=1)
        self.rigid_z = (between * (wx * sine + wz * cosine)).sum(axis=1)
        self.held_turn = np.diff(held[top], prepend=0.0)

        self.backbone = chain.backbone(q)
        points = chain.plane_points(q)
        lower, upper = points[1:-1:2][~soft], points[2::2][~soft]
        self.held_length = _lengths(_spans(
            chain.guides[~soft], (upper - lower)[:, :2].T, lower[:, 2], upper[:, 2]))

    def solve(self) -> Rod:
        """Return the rods' equilibrium with the taut tendons holding, whatever their tension."""
        rods = self.length.size
        mesh, y, p = self._first_guess()
        found = solve_bvp(self._rates, self._mismatch, mesh, y, p=p, tol=TOLERANCE,
                          fun_jac=self._jacobian, max_nodes=MAX_NODES)
        if found.status != 0:
            raise StaticsError(f'no equilibrium of the rods found: {found.message}', self.guess)
        if np.abs(found.sol(mesh)[:rods] - y[:rods]).max() > SAME_BRANCH:
            raise StaticsError('the rods have no equilibrium near that of the chain; one of more '
                               'bodies per segment may come nearer', self.guess)
        missed = np.abs(self._mismatch(found.y[:, 0], found.y[:, -1], found.p)).max()
        spans = self._rod_spans(found.y[:, 0].reshape(4, rods), found.y[:, -1].reshape(4, rods))
        lengths = self.held_length + _lengths(spans)
        slack = np.where(self.taut, 0.0, np.maximum(self.target - lengths, 0.0))
        points = self._points(found.sol(1.0))
        return Rod(points, points[2::2, 2] - points[1:-1:2, 2], self._tensions(found.p),
                   self.chain.straight_paths - lengths, slack,
                   float(max(missed, found.rms_residuals.max())))

    def _rates(self, s: Array, y: Array, p: Array) -> Array:
        """Return the derivatives of the unknown functions."""
        theta, bend = y.reshape(4, -1, s.size)[:2]
        sine, cosine = np.sin(theta), np.cos(theta)
        x, z = self._force(s, p)
        return np.concatenate([bend, z * sine - x * cosine, sine, cosine])

    def _jacobian(self, s: Array, y: Array, p: Array) -> tuple[Array, Array]:
        """Return the derivatives of the rates by functions and by parameters."""
        rods = self.length.size
        sine, cosine = np.sin(y[:rods]), np.cos(y[:rods])
        x, z = self._force(s, p)
        by_y = np.zeros((4, rods, 4, rods, s.size))
        by_p = np.zeros((4, rods, p.size, s.size))
        r = np.arange(rods)
        by_y[0, r, 1, r] = 1.0
        by_y[1, r, 0, r] = z * cosine + x * sine
        by_y[2, r, 0, r] = cosine
        by_y[3, r, 0, r] = -sine
        by_p[1, r, r] = -cosine
        by_p[1, r, rods + r] = sine
        return by_y.reshape(4 * rods, 4 * rods, -1), by_p.reshape(4 * rods, p.size, -1)

    def _force(self, s: Array, p: Array) -> Array:
        """Return n over E I / l^2 at ``s``, shape (2, rods, s): x and z."""
        ends = self.end_weight + p[:2 * self.length.size].reshape(2, -1)
        return np.asarray(ends[:, :, None] + self.own_weight[:, :, None] * (1.0 - s))

    def _mismatch(self, ya: Array, yb: Array, p: Array) -> Array:
        """Return by how much the end conditions are missed, one number per unknown."""
        rods = self.length.size
        lower, upper = ya.reshape(4, rods), yb.reshape(4, rods)
        spans = self._rod_spans(lower, upper)
        pulling = _pulling(self._tensions(p), spans)
        # On a rod's upper end act the tendons at the guides there, the weights above, and through
        # the rigid bodies the next rod's lower end with the tendons at its guides.
        theta = upper[0]
        moment = self.rigid_z * np.sin(theta) - self.rigid_x * np.cos(theta)
        moment -= _couple(self.guides[:, 1], theta, pulling)
        at_lower_end = _couple(self.guides[:, 0], lower[0], pulling)
        at_lower_end += lower[1] * self.length / self.flexibility
        moment[:-1] += at_lower_end[1:]
        over = self.held_length + _lengths(spans) - self.target
        return np.concatenate([
            lower[0] - np.append(0.0, theta[:-1]) - self.held_turn, lower[2], lower[3],
            upper[1] - moment * self.flexibility / self.length,
            p[:2 * rods] - self._tendon_force(pulling), over[self.taut] / self.length.sum()])

    def _tensions(self, p: Array) -> Array:
        """Return the tension of the right and left tendon, (2,), N."""
        tensions = np.zeros(2)
        tensions[self.taut] = p[2 * self.length.size:]
        return tensions

    def _rod_spans(self, lower: Array, upper: Array) -> Array:
        """Return the tendons' spans along the rods from the functions at both ends."""
        return _spans(self.guides, (upper - lower)[2:] * self.length, lower[0], upper[0])

    def _tendon_force(self, pulling: Array) -> Array:
        """Return the tendons' part of n over E I / l^2, (2 * rods,)."""
        return np.ravel(-self.flexibility * pulling.sum(axis=0))

    def _first_guess(self) -> tuple[Array, Array, Array]:
        """Return mesh, functions and parameters from the chain's state."""
        n, q = self.chain.arm.bodies_per_segment, self.guess.joint_angles
        mesh = np.linspace(0.0, 1.0, INTERVALS + 1)
        ends = np.arange(n + 1) / n
        middles = np.concatenate([[0.0], (ends[1:] + ends[:-1]) / 2.0, [1.0]])
        angles = np.append(0.0, np.cumsum(q))
        bends = q * self.chain.joint_stiffness
        functions = np.empty((4, self.length.size, mesh.size))
        for r, top in enumerate(self.chain.last_body[self.soft]):
            joints = slice(top - n, top + 1)
            run = self.backbone[joints, :2].T / self.length[r]
            functions[0, r] = np.interp(mesh, middles, angles[top - n:top + 2])
            functions[1, r] = np.interp(mesh, ends, bends[joints])
            functions[1, r] *= self.flexibility[r] / self.length[r]
            functions[2, r] = np.interp(mesh, ends, run[0] - run[0, 0])
            functions[3, r] = np.interp(mesh, ends, run[1] - run[1, 0])
        spans = self._rod_spans(functions[:, :, 0], functions[:, :, -1])
        force = self._tendon_force(_pulling(self.guess.tensions, spans))
        parameters = np.append(force, self.guess.tensions[self.taut])
        return mesh, functions.reshape(-1, mesh.size), parameters

    def _points(self, upper: Array) -> Array:
        """Return the calculation points from the unknown functions at the rods' upper ends."""
        discs, joints = self.chain.arm.discs, self.chain.joints_per_segment
        theta, _, x, z = upper.reshape(4, -1)
        rods = iter(np.stack([x * self.length, z * self.length, theta], axis=1))
        at = np.array([0.0, discs[0].height, 0.0])
        points = [np.zeros(3), at]
        for k, bend in enumerate(self.guess.bending_angles):
            if self.soft[k]:
                run_x, run_z, tangent = next(rods)
            else:  # the polyline, turned about +y
                held = self.backbone[k * joints:(k + 1) * joints]
                turn, tangent = at[2] - held[0, 2], at[2] + bend
                along_x, along_z = held[-1, :2] - held[0, :2]
                run_x = along_x * np.cos(turn) + along_z * np.sin(turn)
                run_z = along_z * np.cos(turn) - along_x * np.sin(turn)
            bottom = np.array([at[0] + run_x, at[1] + run_z, tangent])
            at = bottom + discs[k + 1].height * np.array([np.sin(tangent), np.cos(tangent), 0.0])
            points += [bottom, at]
        return np.array(points)


def _spans(guides: Array, run: Array, below: Array, above: Array) -> Array:
    """
    Return the tendons' spans from lower to upper guide, (2, 2, segments): tendon, x or z; m.

    guides (segments, 2), m; run (2, segments) from lower to upper end, m; tangent angles, rad.
    """
    across = guides[:, 1] * np.array([np.cos(above), -np.sin(above)])
    across -= guides[:, 0] * np.array([np.cos(below), -np.sin(below)])
    return np.asarray(run + SIDES[:, None] * across)


def _lengths(spans: Array) -> Array:
    """Return the length of each tendon, (2,), m."""
    return np.asarray(np.hypot(spans[:, 0], spans[:, 1]).sum(axis=1))


def _pulling(tension: Array, spans: Array) -> Array:
    """Return the tendons' forces on the lower guides, (2, 2, segments): tendon, x or z; N."""
    return np.asarray(tension[:, None, None] * spans / np.hypot(spans[:, :1], spans[:, 1:]))


def _couple(offsets: Array, theta: Array, forces: Array) -> Array:
    """Return the moment of forces on the guides of discs at ``theta`` about their axes, N m."""
    along = np.sin(theta) * forces[:, 0] + np.cos(theta) * forces[:, 1]
    return np.asarray(-offsets * (SIDES * along).sum(axis=0))
