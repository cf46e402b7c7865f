# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
What planar and spatial arms have in common, for those that need not know which one they have.

A state says where everything is in space; its coordinates are what tells one shape from another.
"""

from collections.abc import Sequence
from math import atan2
from typing import Any, Protocol, TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from soft_continuum.mechanics.arm import Arm
from soft_continuum.mechanics.chain import Array, RigidChain
from soft_continuum.mechanics.spatial.arm import SpatialArm
from soft_continuum.mechanics.spatial.chain import SpatialChain

if TYPE_CHECKING:
    from soft_continuum.mechanics.spatial.statics import SpatialStatics
    from soft_continuum.mechanics.statics import Statics

AnyArm = Arm | SpatialArm
AnyChain = RigidChain | SpatialChain


class State(Protocol):
    """Equilibrium or SpatialEquilibrium."""

    @property
    def chain(self) -> AnyChain:
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
    def chain(self) -> AnyChain:
        """The arm."""

    @property
    def compliance(self) -> Array:
        """By how much each tendon stretches, (tendons,), m/N."""

    def solve(self, start: Any, pulls: ArrayLike, soft: Sequence[bool], *,
              vacuum: Sequence[float] | None = None, sliding: Sequence[int] = ()) -> State:
        """Return the equilibrium for pulls (tendons,) m, followed from ``start``."""


def mounting_angle_of(arm: AnyArm) -> float:
    """Return the rotation of base_link about +y from upright, rad: in space, as gravity has it."""
    if isinstance(arm, Arm):
        return arm.mounting_angle
    return atan2(arm.gravity[0], -arm.gravity[2])


def chain_of(arm: AnyArm) -> AnyChain:
    """Return an arm as a chain of rigid bodies."""
    return RigidChain(arm) if isinstance(arm, Arm) else SpatialChain(arm)


def bent(statics: Any, state: Any, soft: Sequence[bool], goal: Array) -> Any:
    """
    Return the state in which soft segments bend as a goal says, all others stiff.

    goal: as State.bending, of which that of soft segments counts; in the plane one is soft.
    Raises StaticsError where no tendon holds them there.
    """
    if isinstance(statics.chain.arm, Arm):
        segment = list(soft).index(True)
        return statics.bend(state, segment, float(goal[segment, 1]))
    from soft_continuum.mechanics.spatial.inverse import PRETENSION, pulls_that_hold
    wanted = np.where(np.array(soft)[:, None], goal, np.nan)
    # With it first: it hardly changes the shape, and what falls over costs a second to find out.
    return pulls_that_hold(statics, state, wanted, soft, (PRETENSION, 0.0)).state


def statics_of(arm: AnyArm) -> 'Statics | SpatialStatics':
    """Return what solves for the equilibria of an arm."""
    if isinstance(arm, Arm):  # here, because descriptions are read by those that solve nothing
        from soft_continuum.mechanics.statics import Statics
        return Statics(arm)
    from soft_continuum.mechanics.spatial.statics import SpatialStatics
    return SpatialStatics(arm)
