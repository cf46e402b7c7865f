# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
How an equilibrium changes with pulls, loads and stiffness, by differentiating it implicitly.

At an equilibrium F(shape, tensions; p) = 0, so d(shape, tensions)/dp = -K^-1 dF/dp with K the
matrix of the last Newton step.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.chain import Equilibrium
from soft_continuum.mechanics.orientations import cross_matrices
from soft_continuum.mechanics.statics import Statics


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """
    Derivatives of an equilibrium with respect to k parameters.

    turned: (bodies, 3, k), of every body, as rotation vectors in base_link, rad per unit.
    tensions: (tendons, k) N per unit.  paths: (tendons, k) m per unit, of the lengths of the
    tendons' paths.  state: of which they are.
    """

    turned: Array
    tensions: Array
    paths: Array
    state: Equilibrium

    @property
    def points(self) -> Array:
        """Of bottom and top centre of every disc, (2 * discs, 3, k), m per unit."""
        chain = self.state.chain
        along = chain.body_lengths[:, None] * chain.axes(self.state.configuration)
        ends = np.zeros((chain.bodies + 1, *self.turned.shape[1:]))
        np.cumsum(cross_matrices(-along) @ self.turned, axis=0, out=ends[1:])
        return chain.along_discs(ends)

    @property
    def orientations(self) -> Array:
        """Of every disc, as rotation vectors in base_link, (discs, 3, k), rad per unit."""
        found: Array = np.concatenate([np.zeros((1, *self.turned.shape[1:])),
                                       self.turned[self.state.chain.last_body]])
        return found

    @property
    def bending(self) -> Array:
        """Of each segment about x and y, (segments, 2, k), rad per unit."""
        return self.state.chain.bending_rates(self.state.configuration, self.orientations)

    @property
    def poses(self) -> Array:
        """Of the discs' bottoms, (discs, 6, k): shifts along x, y, z, m; turns about them, rad."""
        return np.concatenate([self.points[::2], self.orientations], axis=1)

    @property
    def tip(self) -> Array:
        """Of the top of the last disc: x, y, z (m), then its rotation vector (rad), (6, k)."""
        found: Array = np.concatenate([self.points[-1], self.orientations[-1]])
        return found


class Linearisation:
    """
    The linearised statics at one equilibrium, for the stiff segments that it was found with.

    A slack tendon stays slack and a taut one taut: where that changes, the derivatives are
    one-sided.  So they are where a jam yields.
    """

    def __new__(cls, statics: Statics, *_: object, **__: object) -> Self:
        """Make one of the kind of the statics."""
        kind: type[Any] = cls
        if cls is Linearisation:
            from soft_continuum.mechanics.plane.sensitivity import PlaneLinearisation
            from soft_continuum.mechanics.space.sensitivity import SpaceLinearisation
            kind = SpaceLinearisation if len(statics.chain.joint_axes) > 1 else PlaneLinearisation
        made: Self = super().__new__(kind)
        return made

    def __init__(self, statics: Statics, state: Equilibrium, sliding: Sequence[int] = (), *,
                 tensions: ArrayLike | None = None, loading: bool = True) -> None:
        """
        Assemble the matrix, and factor it.

        sliding: as in Statics.solve.  tensions: as there: a number for each tendon whose tension
        is given and not its length, else nan (default: all lengths).  loading: whether joints
        whose jam bears just its yield moment go on to yield, or all turn back and are elastic.
        Raises ValueError for a state of another arm, tensions of the wrong size, and segments with
        friction.
        """
        raise NotImplementedError

    def all(self) -> Sensitivity:
        """
        Return all of them that an estimate needs, which costs little more than one.

        In turn: by the held shape, a factor of the stiffness and K of each segment, the pulls, the
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

        Per rad of its bending about x, then y, of each segment in turn, spread evenly over its
        joints; 0 for one that is soft, or rigid.
        """
        raise NotImplementedError

    def payload(self) -> Sensitivity:
        """Return the derivatives by a mass at the tip, per kg."""
        raise NotImplementedError

    def forces(self) -> Sensitivity:
        """
        Return the derivatives by forces on the discs, per N.

        In turn x, y and z (base_link) at the centre of every disc but the base, as a Wrench.
        """
        raise NotImplementedError
