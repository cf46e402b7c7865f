# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The arm as a chain of rigid bodies and springs, and its states.

A soft segment is n bodies of length l/n between n + 1 equal springs (paper, III-B); discs are
rigid.  The joints of a planar arm are hinges: its chain and solver use angles instead of
rotations.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self, TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from soft_continuum.mechanics import kinds
from soft_continuum.mechanics._checks import real_array
from soft_continuum.mechanics.arm import Arm, Array, check_arm, PAPER
from soft_continuum.mechanics.directions import bending_directions
from soft_continuum.mechanics.rotations import bending_between, bending_rates, quaternions

if TYPE_CHECKING:
    from matplotlib.axes import Axes

RIGHT, LEFT = 0, 1

SLACK = -np.inf
"""A pull that leaves the tendon slack in every shape."""


@dataclass(frozen=True, eq=False, init=False)
class Equilibrium:
    """
    A state of the arm in which all forces and moments balance.

    configuration: joint angles (joints,), rad, of a planar arm; orientations of all bodies in
    base_link, (bodies, 3, 3), of a spatial arm.  tensions: (tendons,) N at the base; nan where no
    soft segment determines it.  pulls: (tendons,) m, length of each path in the straight arm less
    its present length.  slack: (tendons,) m, length of each tendon beyond its path, inf for SLACK.
    residual: largest unbalanced moment, N m.  stiff: flag per segment.  held: joint angles held by
    jams and by friction of the joints, as joint_angles.  jumped: the equilibrium ceased to exist
    on the path and the arm snapped to another stable one.  vacuum: of each segment, 0 to 1; empty
    for full.  chain: the arm.
    """

    configuration: Array
    tensions: Array
    pulls: Array
    slack: Array
    residual: float
    iterations: int
    stiff: tuple[bool, ...]
    held: Array
    jumped: bool = False
    vacuum: tuple[float, ...] = ()
    chain: 'Chain' = field(kw_only=True, repr=False)

    def __init__(self, configuration: Array, tensions: Array, pulls: Array, slack: Array,
                 residual: float, iterations: int, stiff: tuple[bool, ...], held: Array,
                 jumped: bool = False, vacuum: tuple[float, ...] = (), *, chain: 'Chain') -> None:
        """Set all fields at once: one by one, as dataclass does, takes as long as a solve."""
        vars(self).update(
            configuration=configuration, tensions=tensions, pulls=pulls, slack=slack,
            residual=residual, iterations=iterations, stiff=stiff, held=held, jumped=jumped,
            vacuum=vacuum, chain=chain)

    @property
    def joint_angles(self) -> Array:
        """Joint angles (joints,) of planar arms, rotation vectors (bodies, 3) of others, rad."""
        return self.chain.joint_angles(self.configuration)

    @property
    def rotations(self) -> Array:
        """Orientation of every body in base_link, (bodies, 3, 3)."""
        return self.chain.rotations(self.configuration)

    @property
    def orientations(self) -> Array:
        """Orientation of every disc, base first, (discs, 3, 3)."""
        return self.chain.disc_rotations(self.configuration)

    @property
    def bending(self) -> Array:
        """
        Bending of each segment about x and y of the disc below it, (segments, 2), rad.

        Its length is the bending angle, the angle between the axes of the discs.
        """
        return self.chain.bending(self.configuration)

    @property
    def bending_angles(self) -> Array:
        """Bending angle of each segment, (segments,), rad; never negative for spatial arms."""
        return self.chain.sizes(self.bending)

    @property
    def bending_directions(self) -> Array:
        """Bending direction of each segment, (segments,), rad; empty for planar arms."""
        return self.chain.directions(self.bending)

    @property
    def jam_deflection(self) -> Array:
        """Bending of each segment less the bending that its jam holds, (segments, 2), rad."""
        return self.chain.summed(self.joint_angles - self.held)

    @property
    def points(self) -> Array:
        """Bottom and top centre of each disc, base first, (2 * discs, 3): x, y, z, m."""
        return self.chain.points(self.configuration)

    @property
    def tip(self) -> Array:
        """The last of the points: the top of the last disc, (3,), m."""
        tip: Array = self.points[-1]
        return tip

    @property
    def poses(self) -> Array:
        """Bottom and top of every disc: x, y, z (m), quaternion x, y, z, w, (2 * discs, 7)."""
        return self.chain.poses(self.configuration)

    @property
    def backbone(self) -> Array:
        """Upper end of every body, the base disc first, (bodies + 1, 3), m."""
        return self.chain.ends(self.configuration)

    @property
    def tendon_points(self) -> list[Array]:
        """Guides of each tendon, base first, (guides, 3), m."""
        return self.chain.tendon_points(self.configuration)

    @property
    def taut(self) -> tuple[bool, ...]:
        """Whether each tendon carries tension."""
        return tuple((self.tensions > 0.0).tolist())

    @property
    def coordinates(self) -> Array:
        """The joint angles as a flat list, as in KinematicsState, rad."""
        return self.joint_angles.ravel()

    @property
    def held_coordinates(self) -> Array:
        """The same for the joint angles held by jams of stiff segments, rad."""
        return self.held.ravel()

    @property
    def joint_positions(self) -> Array:
        """Joint positions of the URDF, in the order of its joint_names, rad."""
        return self.chain.joint_positions(self.configuration)

    def with_held(self, chain: 'Chain', change: Array) -> 'Equilibrium':
        """
        Return the state on another chain of the arm, with a change of the held bending.

        change: as ``bending``, added to what jams hold, distributed evenly over the joints.
        """
        return replace(self, held=self.held + chain.spread(change), chain=chain)

    def plot(self, axes: 'Axes | None' = None) -> 'Axes':
        """
        Draw the arm in mm, soft segments in colour, and return the axes.

        axes: of Matplotlib (pip install 'soft_continuum[plots]'); default: the current axes.
        """
        from matplotlib import pyplot

        from soft_continuum.mechanics.drawing import draw_arm
        axes = axes or pyplot.gca()
        draw_arm(axes, self, [s for s, stiff in enumerate(self.stiff) if not stiff])
        axes.set_ylabel('z in mm')
        return axes


@dataclass(frozen=True, eq=False)
class Batch(Sequence[Any]):
    """
    Equilibria of m problems, as arrays; an index gives one Equilibrium.

    configurations: (m, ...), tensions, pulls, slack: (m, tendons) N and m, as in Equilibrium.
    found: (m,), whether one was found; other rows are nan, and their index raises LookupError.
    jumped: (m,).  residual: (m,) N m.
    """

    configurations: Array
    tensions: Array
    pulls: Array
    slack: Array
    found: NDArray[np.bool_]
    jumped: NDArray[np.bool_]
    residual: Array
    _chains: Sequence['Chain'] = field(repr=False)
    _state: Callable[[int], Equilibrium] = field(repr=False)

    def __len__(self) -> int:
        """Return the number of problems."""
        return len(self.found)

    def __getitem__(self, index: Any) -> Any:
        """Return one state, or a list for a slice; raises LookupError where none was found."""
        rows = range(len(self))[index]
        if isinstance(rows, range):
            return [self[i] for i in rows]
        if not self.found[rows]:
            raise LookupError(f'no equilibrium was found for problem {rows}')
        return self._state(rows)

    @property
    def bending(self) -> Array:
        """Bending of each segment about x and y of the disc below it, (m, segments, 2), rad."""
        return self._chains[0].bending(self.configurations)

    @property
    def tips(self) -> Array:
        """The centre of the top of the last disc, (m, 3), m."""
        axes = self._chains[0].axes(self.configurations)
        lengths = np.broadcast_to(
            np.array([chain.body_lengths for chain in self._chains]), axes.shape[:2])
        tips: Array = np.einsum('mb,mbi->mi', lengths, axes)
        tips[:, 2] += [chain.arm.discs[0].height for chain in self._chains]
        return tips


class Chain:
    """
    The rigid multibody model of an arm; for a planar arm ``Chain(arm)`` returns a PlaneChain.

    joint_axes: axes of each joint in the URDF, in order.  forces: (bodies, 3) N at the upper end
    of each body, including the weight of all above.  straight_paths: (tendons,) m, lengths of the
    tendons' paths through the segments of the straight arm.
    """

    joint_axes: tuple[str, ...]
    straight_paths: Array

    def __new__(cls, arm: Arm | None = None) -> Self:
        """Create the subclass for the arm; unpickled objects keep theirs."""
        kind: type[Any] = cls
        if cls is Chain and arm is not None:
            check_arm(arm)
            kind = kinds.subclass('Chain', arm.planar)
        made: Self = super().__new__(kind)
        return made

    def __init__(self, arm: Arm) -> None:
        """Discretise ``arm``."""
        self.arm, n = arm, arm.bodies_per_segment
        self.segments, self.joints_per_segment = len(arm.segments), n + 1
        self.bodies = self.segments * (n + 1)
        self.last_body = np.arange(1, self.segments + 1) * (n + 1) - 1
        """The disc above each segment."""
        lengths, masses, joint_lengths = [], [], []
        for segment, disc in zip(arm.segments, arm.discs[1:], strict=True):
            lengths += [segment.length / n] * n + [disc.height]
            masses += [segment.mass / n] * n + [disc.mass]
            joint_lengths += joint_lengths_of(segment.length, n, arm.discretisation)
        self.body_lengths, self.body_masses = np.array(lengths), np.array(masses)
        self.joint_lengths = np.array(joint_lengths)
        above = np.cumsum(self.body_masses[::-1])[::-1] - self.body_masses + arm.payload
        self.forces = (0.5 * self.body_masses + above)[:, None] * np.array(arm.gravity)
        for wrench in arm.wrenches:
            if wrench.disc > 0:  # the base does not move
                body = self.last_body[wrench.disc - 1]
                self.forces[:body] += wrench.force
                self.forces[body] += 0.5 * np.array(wrench.force)

    # What depends on the kind; configuration: as that of an Equilibrium.

    def configuration(self, joint_angles: Array, /) -> Array:
        """Return the configuration for joint angles, which were validated."""
        raise NotImplementedError

    def joint_angles(self, configuration: Array, /) -> Array:
        """Return Equilibrium.joint_angles."""
        raise NotImplementedError

    def angles_at(self, joint_positions: Array, /) -> Array:
        """Return the joint angles for joint positions of the URDF, rad."""
        raise NotImplementedError

    def joint_positions(self, configuration: Array, /) -> Array:
        """Return Equilibrium.joint_positions."""
        raise NotImplementedError

    def rotations(self, configuration: Array) -> Array:
        """Return Equilibrium.rotations."""
        raise NotImplementedError

    def spread(self, bending: Array) -> Array:
        """Return joint angles for bending (segments, 2), rad, even over each segment's joints."""
        raise NotImplementedError

    def summed(self, joint_angles: Array, /) -> Array:
        """Return the sum of joint angles over each segment about x and y, (segments, 2), rad."""
        raise NotImplementedError

    def axes(self, configuration: Array) -> Array:
        """Return the directions of all bodies, (..., bodies, 3)."""
        raise NotImplementedError

    def tendon_points(self, configuration: Array) -> list[Array]:
        """Return the guides of each tendon, base first, (guides, 3), m."""
        raise NotImplementedError

    def paths(self, configuration: Array) -> Array:
        """Return the length of the path of each tendon through the segments, (tendons,), m."""
        raise NotImplementedError

    @property
    def disc_radii(self) -> Array:
        """Radius of every disc in drawings, (discs,), m."""
        raise NotImplementedError

    # States.

    def straight(self) -> Equilibrium:
        """Return the straight arm with all tendons just taut and no pull."""
        return self._straight

    @cached_property
    def _straight(self) -> Equilibrium:
        return self.state(np.zeros(self.joint_shape))

    @property
    def joint_shape(self) -> tuple[int, ...]:
        """Shape of the joint angles."""
        return (self.bodies,) if len(self.joint_axes) == 1 else (self.bodies, 3)

    def state(self, joint_angles: ArrayLike) -> Equilibrium:
        """Return joint angles (rad) as a held state with tendons just taut, without tension."""
        count, *three = self.joint_shape
        wanted = (f'joint angles must be {count} {"rotation vectors" if three else "numbers"} '
                  f'(finite, rad), {self.joints_per_segment} for each segment')
        angles = real_array(joint_angles, wanted)
        if angles.shape != self.joint_shape or not np.all(np.isfinite(angles)):
            raise ValueError(wanted)
        there, nothing = self.configuration(angles), np.zeros(len(self.straight_paths))
        return Equilibrium(there, nothing, self.straight_paths - self.paths(there), nothing,
                           0.0, 0, (True,) * self.segments, angles, chain=self)

    def state_of(self, coordinates: Array, held: Array, stiff: Sequence[bool],
                 vacuum: Sequence[float] = ()) -> Equilibrium:
        """
        Return a state without tension from coordinates, held coordinates and stiff flags.

        vacuum: as in Equilibrium.
        """
        return replace(self.state(coordinates.reshape(self.joint_shape)),
                       held=held.reshape(self.joint_shape), stiff=tuple(stiff),
                       vacuum=tuple(vacuum))

    @property
    def coordinate_count(self) -> int:
        """Number of coordinates of a state."""
        return int(np.prod(self.joint_shape))

    def at(self, joint_positions: ArrayLike) -> Equilibrium:
        """Return the held state for joint positions of the URDF, rad, as in joint_states."""
        wanted = f'joint positions must be {self.coordinate_count} finite numbers (rad)'
        given = real_array(joint_positions, wanted)
        if given.size != self.coordinate_count or not np.all(np.isfinite(given)):
            raise ValueError(f'{wanted}; given: {joint_positions!r}')
        return self.state(self.angles_at(given))

    def uniform(self, bending: ArrayLike) -> Equilibrium:
        """
        Return the held state with bending distributed evenly over the joints of each segment.

        bending: as Equilibrium.bending; for planar arms also angles (segments,), rad.
        """
        return self.state(self.spread(real_array(bending, 'bending must be numbers (rad)')))

    # Geometry of both kinds of chain.

    def bending(self, configuration: Array, /) -> Array:
        """Return the bending of configurations, (..., segments, 2), rad."""
        return bending_between(self.disc_rotations(configuration))

    def bending_rates(self, configuration: Array, turned: Array) -> Array:
        """Return the change of bending (segments, 2, k) for turns of the discs (discs, 3, k)."""
        return bending_rates(self.disc_rotations(configuration), turned)

    def disc_rotations(self, configuration: Array) -> Array:
        """Return the orientation of every disc, base first, (..., discs, 3, 3)."""
        turned = self.rotations(configuration)
        discs = np.empty((*turned.shape[:-3], self.segments + 1, 3, 3))
        discs[..., 0, :, :], discs[..., 1:, :, :] = np.eye(3), turned[..., self.last_body, :, :]
        return discs

    def sizes(self, bending: Array) -> Array:
        """Return the bending angles (segments,) of bending (segments, 2), rad."""
        sizes: Array = np.linalg.norm(bending, axis=1)
        return sizes

    def directions(self, bending: Array) -> Array:
        """Return the directions (segments,) of bending (segments, 2), rad."""
        return bending_directions(bending)

    def points(self, configuration: Array) -> Array:
        """Return Equilibrium.points."""
        return self.along_discs(self.ends(configuration))

    def poses(self, configuration: Array) -> Array:
        """Return Equilibrium.poses."""
        turned = quaternions(self.disc_rotations(configuration))
        return np.column_stack([self.points(configuration), np.repeat(turned, 2, 0)])

    def ends(self, configuration: Array) -> Array:
        """Return the upper end of every body, the base disc first, (bodies + 1, 3), m."""
        ends = np.zeros((self.bodies + 1, 3))
        np.cumsum(self.body_lengths[:, None] * self.axes(configuration), axis=0, out=ends[1:])
        ends[:, 2] += self.arm.discs[0].height
        return ends

    def along_discs(self, ends: Array) -> Array:
        """Return the points at the bottom and top of every disc of ends (bodies + 1, ...)."""
        points = np.zeros((2 * self.segments + 2, *ends.shape[1:]))
        points[1], points[2::2], points[3::2] = (
            ends[0], ends[self.last_body], ends[self.last_body + 1])
        return points

    def rigid(self, stiff: Sequence[bool]) -> NDArray[np.bool_]:
        """Return which joints are locked, (bodies,)."""
        return np.repeat([is_stiff and s.jam.rigid for s, is_stiff in zip(
            self.arm.segments, stiff, strict=True)], self.joints_per_segment)


def joint_lengths_of(length: float, bodies: int, discretisation: str) -> list[float]:
    """Return the length of spring (m) that each of the n + 1 joints of a segment models."""
    if discretisation == PAPER:
        return [length / (bodies + 1)] * (bodies + 1)
    return [length / (2 * bodies), *[length / bodies] * (bodies - 1), length / (2 * bodies)]


def check_start(start: object, what: str = 'start') -> None:
    """Raise ValueError if the start, or another state, is not an Equilibrium."""
    if not isinstance(start, Equilibrium):
        raise ValueError(f'the {what} must be an Equilibrium, such as '
                         f'statics.chain.straight(); given: {start!r}')
