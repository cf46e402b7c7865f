# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Derivatives of an equilibrium by pulls, loads and stiffness, by implicit differentiation.

At an equilibrium F(shape, tensions; p) = 0, so d(shape, tensions)/dp = -K^-1 dF/dp with K the
matrix of the last Newton step.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from soft_continuum.mechanics import kinds
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.chain import check_start, Equilibrium
from soft_continuum.mechanics.rotations import cross_matrices
from soft_continuum.mechanics.statics import Statics


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """
    Derivatives of an equilibrium with respect to k parameters.

    turned: (bodies, 3, k), of every body, as rotation vectors in base_link, rad per unit.
    tensions: (tendons, k) N per unit.  paths: (tendons, k) m per unit, of the lengths of the
    tendons' paths.  state: the equilibrium.
    """

    turned: Array
    tensions: Array
    paths: Array
    state: Equilibrium

    @property
    def points(self) -> Array:
        """Derivatives of bottom and top centre of every disc, (2 * discs, 3, k), m per unit."""
        chain = self.state.chain
        along = chain.body_lengths[:, None] * chain.axes(self.state.configuration)
        ends = np.zeros((chain.bodies + 1, *self.turned.shape[1:]))
        np.cumsum(cross_matrices(-along) @ self.turned, axis=0, out=ends[1:])
        return chain.along_discs(ends)

    @property
    def orientations(self) -> Array:
        """Turns of every disc, rotation vectors in base_link, (discs, 3, k), rad per unit."""
        found: Array = np.concatenate([np.zeros((1, *self.turned.shape[1:])),
                                       self.turned[self.state.chain.last_body]])
        return found

    @property
    def bending(self) -> Array:
        """Derivatives of bending about x and y, (segments, 2, k), rad per unit."""
        return self.state.chain.bending_rates(self.state.configuration, self.orientations)

    @property
    def poses(self) -> Array:
        """Motion of disc bottoms, (discs, 6, k): shifts along x, y, z, m; turns, rad."""
        return np.concatenate([self.points[::2], self.orientations], axis=1)

    @property
    def tip(self) -> Array:
        """Motion of the top of the last disc: x, y, z (m), rotation vector (rad), (6, k)."""
        found: Array = np.concatenate([self.points[-1], self.orientations[-1]])
        return found


class Linearisation:
    """
    The linearised statics at one equilibrium, with its stiff segments.

    Slack tendons stay slack and taut ones taut: where that changes, the derivatives are
    one-sided, as they are where a jam yields.
    """

    def __new__(cls, statics: Statics, state: Equilibrium, *_: object, **__: object) -> Self:
        """Create the subclass for the statics."""
        check_start(state, 'state')
        kind: type[Any] = cls
        if cls is Linearisation:
            kind = kinds.subclass('Linearisation', len(statics.chain.joint_axes) == 1)
        made: Self = super().__new__(kind)
        return made

    def __init__(self, statics: Statics, state: Equilibrium, sliding: Sequence[int] = (), *,
                 tensions: ArrayLike | None = None, loading: bool = True) -> None:
        """
        Assemble the matrix, and factor it.

        sliding: as in Statics.solve.  tensions: as there: a number for each tendon with a given
        tension instead of a length, else nan (default: all lengths).  loading: whether joints at
        the yield moment of their jam continue to yield, or unload elastically.
        Raises ValueError for a state of another arm, tensions of the wrong size, and segments with
        friction.
        """
        raise NotImplementedError

    def all(self) -> Sensitivity:
        """
        Return all derivatives for an estimate, which costs little more than one.

        In order: by the held shape, a stiffness factor and K of each segment, the pulls, the
        payload.
        """
        raise NotImplementedError

    def pulls(self) -> Sensitivity:
        """Return the derivatives by the pull of each tendon, per m; 0 where tension is given."""
        raise NotImplementedError

    def tensions(self) -> Sensitivity:
        """Return the derivatives by the tension of each tendon, per N; 0 where length is given."""
        raise NotImplementedError

    def stiffness_ratio(self) -> Sensitivity:
        """Return the derivatives by the ratio K of every stiff segment; 0 if soft or rigid."""
        raise NotImplementedError

    def held_shape(self) -> Sensitivity:
        """
        Return the derivatives by the shape that the jam of every segment holds.

        Per rad of bending about x, then y, for each segment, distributed evenly over its joints;
        0 if soft or rigid.
        """
        raise NotImplementedError

    def payload(self) -> Sensitivity:
        """Return the derivatives by a mass at the tip, per kg."""
        raise NotImplementedError

    def forces(self) -> Sensitivity:
        """
        Return the derivatives by forces on the discs, per N.

        In order x, y and z (base_link) at the centre of every disc but the base, as a Wrench.
        """
        raise NotImplementedError
