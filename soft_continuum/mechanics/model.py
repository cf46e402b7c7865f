# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The model of an arm, whichever kernel solves for it: what its states and its statics offer.

A state says where everything is in space; its coordinates are what tells one shape from another.
"""

from collections.abc import Sequence
from typing import Any, Protocol, TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from soft_continuum.mechanics.arm import Arm
from soft_continuum.mechanics.chain import Array, RigidChain
from soft_continuum.mechanics.constant_curvature import pulls
from soft_continuum.mechanics.spatial.chain import SpatialChain
from soft_continuum.mechanics.spatial.directions import ONE_PLANE

if TYPE_CHECKING:
    from soft_continuum.mechanics.spatial.statics import SpatialStatics
    from soft_continuum.mechanics.statics import HeldBending, Statics

SMALL = 1e-3  # rad, for derivatives
Chain = RigidChain | SpatialChain


class State(Protocol):
    """Equilibrium or SpatialEquilibrium."""

    @property
    def chain(self) -> Chain:
        """The arm."""

    @property
    def points(self) -> Array:
        """Bottom and top centre of every disc: x, y, z in m; in the plane x, z, angle in rad."""

    @property
    def poses(self) -> Array:
        """Bottom and top of every disc: x, y, z (m), quaternion x, y, z, w, (2 * discs, 7)."""

    @property
    def backbone(self) -> Array:
        """Upper end of every body, the base disc first, (bodies + 1, 3), m."""

    @property
    def rotations(self) -> Array:
        """Orientation of every body in base_link, (bodies, 3, 3)."""

    @property
    def tendon_points(self) -> list[Array]:
        """Guides of each tendon, base first, (guides, 3), m."""

    @property
    def bending_angles(self) -> Array:
        """Bending angle of each segment, (segments,), rad; in space never negative."""

    @property
    def bending(self) -> Array:
        """How far each segment bends about x and y of the disc below it, (segments, 2), rad."""

    @property
    def bending_directions(self) -> Array:
        """In space the direction of each segment, (segments,), rad; in the plane empty."""

    @property
    def coordinates(self) -> Array:
        """Numbers that tell the shape, as KinematicsState has them, rad."""

    @property
    def held_coordinates(self) -> Array:
        """The same of what the jams of stiff segments hold, rad."""

    @property
    def jam_deflection(self) -> Array:
        """By how much each segment is bent from what its jam holds, (segments, 2), rad."""

    @property
    def joint_positions(self) -> Array:
        """Angles of the joints of the URDF, rad."""

    @property
    def tensions(self) -> Array:
        """Tension of each tendon, (tendons,), N."""

    @property
    def pulls(self) -> Array:
        """By how much the path of each tendon is shorter than in the straight arm, m."""

    @property
    def taut(self) -> tuple[bool, ...]:
        """Whether each tendon carries tension."""

    @property
    def slack(self) -> Array:
        """By how much each tendon is longer than its path, (tendons,), m."""

    @property
    def stiff(self) -> tuple[bool, ...]:
        """Which segments are stiff."""

    @property
    def vacuum(self) -> tuple[float, ...]:
        """Of each segment, 0 to 1; empty for full."""

    @property
    def jumped(self) -> bool:
        """Whether the arm went over to another equilibrium."""


class Solver(Protocol):
    """Statics or SpatialStatics."""

    @property
    def chain(self) -> Chain:
        """The arm."""

    @property
    def compliance(self) -> Array:
        """By how much each tendon stretches, (tendons,), m/N."""

    def solve(self, start: Any, pulls: ArrayLike, soft: Sequence[bool], *,
              vacuum: Sequence[float] | None = None, sliding: Sequence[int] = ()) -> State:
        """Return the equilibrium for pulls (tendons,) m, followed from ``start``."""

    def hold(self, start: Any, bending: Array, soft: Sequence[bool]) -> 'HeldBending':
        """Return the state in which soft segments have their bending, and what holds it."""

    def commanded_pulls(self, state: Any) -> Array:
        """Return the pulls (tendons,) m at the motors that give a state: paths and stretch."""


def chain_of(arm: Arm) -> Chain:
    """Return an arm as a chain of rigid bodies."""
    return RigidChain(arm) if arm.planar else SpatialChain(arm)


def fully_actuated(arm: Arm) -> bool:
    """
    Return whether tendons alone bend each segment by itself to where it can bend, all being soft.

    That is, their lengths tell all bendings from each other.  Two tendons along three segments do
    not; without jamming such an arm bends as a whole.
    """
    axes = np.argwhere(arm.bending_axes)
    rates = np.zeros((len(axes), len(arm.tendon_names)))
    for rate, (segment, axis) in zip(rates, axes, strict=True):
        bending = np.zeros((len(arm.segments), 2))
        bending[segment, axis] = SMALL
        rate[:] = (pulls(arm, bending) - pulls(arm, -bending)) / (2.0 * SMALL)
    rank = np.linalg.matrix_rank(rates, tol=ONE_PLANE * np.abs(rates).max(initial=0.0))
    return bool(rank == len(axes))


def linearised(statics: Any, state: Any, sliding: Sequence[int] = ()) -> Any:
    """
    Return the Linearisation or SpatialLinearisation at a state; both have all() and forces().

    sliding: as of a solve; in space tendons do not rub here.
    """
    if isinstance(statics.chain, RigidChain):
        from soft_continuum.mechanics.sensitivity import Linearisation
        return Linearisation(statics, state, sliding or (0, 0))
    from soft_continuum.mechanics.spatial.sensitivity import SpatialLinearisation
    return SpatialLinearisation(statics, state)


def statics_of(arm: Arm) -> 'Statics | SpatialStatics':
    """Return what solves for the equilibria of an arm."""
    if arm.planar:  # here, because descriptions are read by those that solve nothing
        from soft_continuum.mechanics.statics import Statics
        return Statics(arm)
    from soft_continuum.mechanics.spatial.statics import SpatialStatics
    return SpatialStatics(arm)
