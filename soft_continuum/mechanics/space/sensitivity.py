# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Derivatives of a spatial equilibrium by pulls, loads and stiffness.

The matrix of the last Newton step is eliminated as a band; its border (taut tendons, and forces
across spans) is a small dense system.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
import scipy

from soft_continuum.mechanics import _kernel
from soft_continuum.mechanics._checks import sliding_signs, tensions_of
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.chain import Equilibrium
from soft_continuum.mechanics.sensitivity import Linearisation, Sensitivity
from soft_continuum.mechanics.space._laws import (
    HELD,
    JAM,
    JAM_TABLE,
    LAW,
    SPRING_TABLE,
    STIFFNESS,
    YIELD,
)
from soft_continuum.mechanics.space.joints import parts_of_laws
from soft_continuum.mechanics.space.statics import SpaceStatics


class SpaceLinearisation(Linearisation):
    """The linearised statics of a spatial arm."""

    def __init__(self, statics: SpaceStatics, state: Equilibrium, sliding: Sequence[int] = (), *,
                 tensions: ArrayLike | None = None, loading: bool = True) -> None:
        """Factor the matrix; arguments as in Linearisation."""
        chain = statics.chain
        if state.chain.arm != chain.arm:
            raise ValueError('this is a state of another arm')
        if any(segment.friction for segment in chain.arm.segments):
            raise ValueError('derivatives and inverse problems exclude friction of segments; '
                             'remove it with replace(segment, friction=0.0)')
        count = len(chain.arm.tendons)
        given = np.full(count, np.nan) if tensions is None else tensions_of(
            tensions, count, optional=True)
        self._statics, self._chain, self._state = statics, chain, state
        self._by_force = ~np.isnan(given)
        sliding = sliding_signs(sliding, count)
        ways = sliding if any(sliding) else None
        tensions = np.nan_to_num(state.tensions)
        rigid = chain.rigid(state.stiff)
        self._link = np.cumsum(~rigid) - 1
        self._system, _ = chain.system(
            state.rotations, self._link,
            chain.laws.joints(state.stiff, state.vacuum, state.held)[~rigid],
            np.ones(len(chain.span_tendons)) if ways is None else statics.friction.carried(
                state.rotations, ways)[0])
        first = np.flatnonzero(~rigid)
        self._segment = first // chain.joints_per_segment  # of each link's joint
        self._rotations = np.ascontiguousarray(state.rotations[first])
        self._angles = state.joint_angles[first]
        joints = self._system[0]
        self._away = self._angles - joints[:, HELD]
        # Rounding must not decide which joints yield: they go a little beyond, or back.
        most = joints[:, LAW, YIELD] * (1.0 - 1e-9)
        at_yield = self._jam_parts(most)[1] == 0.0
        joints[at_yield, HELD] -= (1e-7 if loading else -1e-7) * self._away[at_yield]
        self._away = self._angles - joints[:, HELD]
        band, across, forces, self._by_tension, self._jacobian = (
            _kernel.functions().spatial_linearise(self._rotations, tensions, self._system))
        compliance = statics.stretch_rates(state, sliding)
        self._taut = np.flatnonzero(
            (tensions > 0.0) & ~self._by_force
            & ((compliance > 0.0) | self._jacobian.any(axis=0)))
        lost, spans, stretched = self._friction(tensions, ways)
        self._columns = np.hstack([self._by_tension[:, self._taut], across, spans])
        self._rows = np.hstack([(self._jacobian - stretched)[:, self._taut], across, lost])
        self._half = band.shape[1] - 1
        self._band, self._pivots = _factored_band(band, np.einsum(
            'kji,kj->ki', self._rotations, self._system[3]))
        self._inside = self._without_tendons(self._columns)
        self._border = scipy.linalg.lu_factor(
            self._rows.T @ self._inside + np.diag(np.concatenate(
                [compliance[self._taut], 1.0 / forces, np.ones(spans.shape[1])])),
            check_finite=False)

    def _friction(self, tensions: Array, ways: Sequence[int] | None
                  ) -> tuple[Array, Array, Array]:
        """
        Return the effect of turns of the links on tensions of spans with friction, per N m.

        (3 links, k), to be multiplied by their effect on the links, (3 links, k); and on the
        stretch of each tendon, (3 links, tendons), m.  ways: sliding, None for no friction.
        """
        chain, size = self._chain, 3 * len(self._rotations)
        if ways is None:
            return np.zeros((size, 0)), np.zeros((size, 0)), np.zeros((size, len(tensions)))
        ratios, compliances = self._statics.friction.rates(self._state.rotations, ways)
        rub = np.flatnonzero(np.abs(ratios).max(axis=(1, 2)) * tensions[chain.span_tendons] > 0.0)
        each = np.concatenate([ratios[rub], compliances * tensions[:, None, None]])
        turned = self._by_torques(np.moveaxis(each, 0, 2))
        vectors, spans = chain.spans(self._state.configuration)
        pulls = tensions[chain.span_tendons, None] * spans / np.linalg.norm(
            spans, axis=1, keepdims=True)
        forces = np.zeros((chain.bodies, 3, len(spans)))
        np.add.at(forces, (chain.entry_bodies[:, None], np.arange(3), chain.entry_spans[:, None]),
                  np.cross(vectors, pulls[chain.entry_spans]))
        return turned[:, :len(rub)], self._by_torques(forces[:, :, rub]), turned[:, len(rub):]

    def all(self) -> Sensitivity:
        """Return the derivatives that an estimate needs."""
        each = (self.held_shape(), self.stiffness_factors(), self.stiffness_ratio(),
                self.pulls(), self.payload())
        turned, tensions, paths = (np.concatenate(
            [getattr(one, name) for one in each], axis=-1)
            for name in ('turned', 'tensions', 'paths'))
        return Sensitivity(turned, tensions, paths, self._state)

    def pulls(self) -> Sensitivity:
        """Return the derivatives by the pull of each tendon, per m; 0 where tension is given."""
        return self._solve(pulls=np.eye(len(self._by_force)))

    def tensions(self) -> Sensitivity:
        """Return the derivatives by the tension of each tendon, per N; 0 where length is given."""
        return self._solve(tensions=np.diag(self._by_force.astype(float)))

    def stiffness_factors(self) -> Sensitivity:
        """
        Return the derivatives by a factor, now 1, of every stiffness of each segment.

        It scales bending, torsional and jam stiffness, but not the moment of a yielding jam.
        """
        joints = self._system[0]
        secant, _ = parts_of_laws(joints[:, STIFFNESS], self._angles, joints[:, LAW, SPRING_TABLE],
                                  self._system[8], np.full(len(joints), np.inf))
        moments = _bent(secant) * joints[:, STIFFNESS] * self._angles
        return self._solve(-self._by_springs(self._of_segments(moments + self._jam_moments())))

    def stiffness_ratio(self) -> Sensitivity:
        """Return the derivatives by the ratio K of every stiff segment; 0 if soft or rigid."""
        more = np.array([segment.jam.ratio - 1.0 for segment in self._chain.arm.segments])
        stiff = np.array(self._state.stiff)[self._segment]
        each = np.where(stiff, 1.0 / more[self._segment], 0.0)[:, None] * self._jam_moments()
        return self._solve(-self._by_springs(self._of_segments(each)))

    def held_shape(self) -> Sensitivity:
        """Return the derivatives by the shape that the jam of every segment holds."""
        stiffness = self._system[0][:, JAM]
        secant, tangent = self._jam_parts(self._system[0][:, LAW, YIELD])
        pull = stiffness[:, :2] * self._away[:, :2]
        along = np.maximum((pull * self._away[:, :2]).sum(axis=1), 1e-300)
        slopes = np.zeros((len(pull), 3, 2))
        slopes[:, :2] = (secant[:, None] * stiffness[:, :2])[:, :, None] * np.eye(2)
        slopes[:, :2] += ((tangent - secant) / along)[:, None, None] * (
            pull[:, :, None] * pull[:, None, :])
        slopes[tangent == 0.0] = 0.0
        count = self._chain.segments
        each = self._of_segments(slopes.reshape(len(pull), 6) / self._chain.joints_per_segment)
        each = each.reshape(len(pull), 3, 2, count).transpose(0, 1, 3, 2)
        return self._solve(self._by_springs(each.reshape(len(pull), 3, 2 * count)))

    def payload(self) -> Sensitivity:
        """Return the derivatives by a mass at the tip, per kg."""
        return self._solve(self._by_torques(np.cross(
            self._vectors(), np.array(self._chain.arm.gravity))[:, :, None]))

    def forces(self) -> Sensitivity:
        """Return the derivatives by forces on the discs, per N."""
        chain, bodies = self._chain, np.arange(self._chain.bodies)
        below = (bodies < chain.last_body[:, None]) + 0.5 * (bodies == chain.last_body[:, None])
        levers = np.cross(self._vectors()[:, None], np.eye(3)).transpose(0, 2, 1)
        each = below.T[:, None, :, None] * levers[:, :, None, :]
        return self._solve(self._by_torques(each.reshape(chain.bodies, 3, -1)))

    def moments(self) -> Sensitivity:
        """Return the derivatives by dead moments on the discs, per N m, in turn as ``forces``."""
        chain = self._chain
        each = np.zeros((chain.bodies, 3, chain.segments, 3))
        each[chain.last_body, :, np.arange(chain.segments)] = np.eye(3)
        return self._solve(self._by_torques(each.reshape(chain.bodies, 3, -1)))

    def _vectors(self) -> Array:
        """Return the vector from the lower to the upper end of each body, (bodies, 3), m."""
        found: Array = self._chain.body_lengths[:, None] * self._state.rotations[:, :, 2]
        return found

    def _jam_parts(self, most: Array) -> tuple[Array, Array]:
        """Return secant and tangent of the jams over their first stiffness, yielding at most."""
        joints = self._system[0]
        return parts_of_laws(joints[:, JAM], self._away, joints[:, LAW, JAM_TABLE],
                             self._system[8], most)

    def _jam_moments(self) -> Array:
        """Return what elastic jams bear, (links, 3), N m; in one that yields its twist alone."""
        secant, tangent = self._jam_parts(self._system[0][:, LAW, YIELD])
        bent = _bent(np.where(tangent > 0.0, secant, 0.0))
        moments: Array = bent * self._system[0][:, JAM] * self._away
        return moments

    def _of_segments(self, each: Array) -> Array:
        """Return what joints have (links, k) as that of each segment, (links, k, segments)."""
        mine = self._segment[:, None] == np.arange(self._chain.segments)
        found: Array = each[:, :, None] * mine[:, None, :]
        return found

    def _by_springs(self, moments: Array) -> Array:
        """Return what moments (links, 3, k) in the joints do to the links, (3 links, k)."""
        _, turns, loads, dead, *routing, _, ratios = self._system
        found = np.zeros((3 * len(moments), moments.shape[2]))
        alone = np.zeros_like(self._system[0])
        alone[:, JAM], alone[:, LAW] = 1.0, (np.inf, -1.0, -1.0)
        for k in range(moments.shape[2]):
            alone[:, HELD] = self._angles - moments[:, :, k]  # springs of 1 N m/rad
            found[:, k] = _kernel.functions().spatial_balance(
                self._rotations, np.zeros(len(self._by_force)),
                (alone, turns, np.zeros_like(loads), np.zeros_like(dead), *routing,
                 self._system[8], ratios)).ravel()
        return found

    def _by_torques(self, torques: Array) -> Array:
        """Return what torques (bodies, 3, k) in base_link on the bodies do to the links."""
        on_links = np.zeros((len(self._rotations) + 1, *torques.shape[1:]))  # last: the base
        np.add.at(on_links, self._link, torques)
        turned: Array = self._rotations.transpose(0, 2, 1) @ on_links[:-1]
        return turned.reshape(3 * len(turned), torques.shape[2])

    def _without_tendons(self, columns: Array) -> Array:
        """Solve with the band alone."""
        if not columns.size:
            return columns
        found: Array = scipy.linalg.lapack.dgbtrs(
            self._band, self._half, self._half, columns, self._pivots)[0]
        return found

    def _solve(self, moments: Array | None = None, *, pulls: Array | None = None,
               tensions: Array | None = None) -> Sensitivity:
        """Return what follows from moments (3 links, k), pulls and tensions (tendons, k)."""
        taut = self._taut
        parameters = next(a for a in (moments, pulls, tensions) if a is not None).shape[1]
        change = np.zeros((len(self._by_force), parameters)) if tensions is None else tensions
        right = (np.zeros((len(self._columns), parameters)) if moments is None else moments
                 ) - self._by_tension @ change
        alone = self._without_tendons(right)
        border = self._rows.T @ alone
        if pulls is not None:
            border[:len(taut)] += pulls[taut]
        carried = border
        if len(border):
            carried = scipy.linalg.lu_solve(self._border, border, check_finite=False)
        turned = alone - self._inside @ carried
        change = change.copy()
        change[taut] += carried[:len(taut)]
        links = np.concatenate([self._rotations @ turned.reshape(-1, 3, parameters),
                                np.zeros((1, 3, parameters))])
        return Sensitivity(links[self._link], change, self._jacobian.T @ turned, self._state)


def _bent(parts: Array) -> Array:
    """Return parts (links,) of the stiffness about x, y and, of twist, 1 where not 0."""
    return np.column_stack([parts, parts, np.ones(len(parts))])


def _factored_band(lower: Array, moments: Array) -> tuple[Array, NDArray[np.int32]]:
    """
    Return the LU factors of a band as LAPACK has bands.

    lower: (rows, half + 1), of its symmetric part, as _assembly.Work has it.  moments: (links, 3),
    N m, dead ones in the frames of the links: the other part is -[m] / 2.
    """
    rows, half = len(lower), lower.shape[1] - 1
    band = np.zeros((3 * half + 1, rows))
    for i in range(half + 1):
        band[2 * half + i, :rows - i] = band[2 * half - i, i:] = lower[:rows - i, i]
    for axis, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        band[2 * half + i - j, j::3] += 0.5 * moments[:, axis]
        band[2 * half + j - i, i::3] -= 0.5 * moments[:, axis]
    if not rows:
        return band, np.zeros(0, np.int32)
    factors, pivots, _ = scipy.linalg.lapack.dgbtrf(band, half, half)
    return factors, pivots
