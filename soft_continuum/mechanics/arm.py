# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The arm: a base disc, then segments and discs in turn, straight up in its reference state.

Frame ``base_link``: origin at the bottom centre of the base disc, z along the straight arm, x in
the bending plane.  A positive angle rotates about +y and carries the tip towards +x.
"""

from collections.abc import Sequence, Sized
from dataclasses import dataclass, replace
from math import inf, pi
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from soft_continuum.mechanics._checks import finite, whole
from soft_continuum.mechanics.laws import Jam, MomentCurvature

STANDARD_GRAVITY = 9.80665  # m/s^2

LENGTH_RANGE = (1e-3, 10.0)  # m; outside it the unit is wrong


class ArmError(ValueError):
    """The description of an arm is not one of a physical arm."""


def check_range(name: str, value: float, low: float, high: float, unit: str) -> None:
    """Refuse what is no number from ``low`` to ``high``; raises ArmError."""
    if not finite(value):
        raise ArmError(
            f'{name} is {value!r}; allowed: a number from {low:g} to {high:g} {unit}'.rstrip())
    if not low <= value <= high:
        hint = ' (lengths are in metres)' if unit == 'm' else ''
        raise ArmError(f'{name} is {value:g} {unit}; allowed: {low:g} to {high:g} {unit}{hint}')


@dataclass(frozen=True)
class Segment:
    """
    A bending segment.

    length: l, m.  bending_stiffness: E I of the soft state, N m^2.  mass: kg, spread evenly along
    the length.  guide_offsets: distance of the tendon guides from the backbone at the lower and
    at the upper end, m.  bending_angle_limit: largest allowed size of the bending angle, rad.
    outer_diameter: m, for drawing.
    soft_law: measured moment over curvature of the soft state, in place of E I.  jam: what the
    stiff state adds.
    """

    length: float
    bending_stiffness: float
    guide_offsets: tuple[float, float]
    mass: float = 0.0
    bending_angle_limit: float = pi / 2
    outer_diameter: float = 0.04
    soft_law: MomentCurvature | None = None
    jam: Jam = Jam()

    def __post_init__(self) -> None:
        """Refuse what is not a physical segment."""
        check_range('segment length', self.length, *LENGTH_RANGE, 'm')
        check_range('outer diameter', self.outer_diameter, *LENGTH_RANGE, 'm')
        if not isinstance(self.guide_offsets, Sized) or len(self.guide_offsets) != 2:
            raise ArmError('a segment has guide offsets at its lower and its upper end; '
                           f'given: {self.guide_offsets}')
        for offset in self.guide_offsets:
            check_range('guide offset', offset, 1e-4, LENGTH_RANGE[1], 'm')
        check_range('bending stiffness E I', self.bending_stiffness, 1e-9, 1e3, 'N m^2')
        check_range('segment mass', self.mass, 0.0, 10.0, 'kg')
        if not isinstance(self.jam, Jam):
            raise ArmError(f'jam is {self.jam!r}; give a Jam, such as Jam(ratio=5.0)')
        if not isinstance(self.soft_law, MomentCurvature | None):
            raise ArmError(f'soft law is {self.soft_law!r}; give a MomentCurvature or none')
        check_range('bending angle limit', self.bending_angle_limit, 1e-3, 2 * pi, 'rad')

    @property
    def stiffnesses(self) -> tuple[float, ...]:
        """What resists to bending and twisting where it does: E I about y, N m^2."""
        return (self.bending_stiffness,)

    def with_stiffness_factor(self, factor: float) -> 'Segment':
        """Return the same segment with E I times a factor."""
        return replace(self, bending_stiffness=self.bending_stiffness * factor)


@dataclass(frozen=True)
class Disc:
    """
    A rigid disc: height l_k in m, mass in kg, centre of mass at mid-height.

    It may have no height: then it is a mark on a rod.
    """

    height: float = 0.0
    mass: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what is not a physical disc."""
        if self.height != 0.0:
            check_range('disc height', self.height, *LENGTH_RANGE, 'm')
        check_range('disc mass', self.mass, 0.0, 10.0, 'kg')


@dataclass(frozen=True)
class Tendon:
    """
    What both tendons are made of.

    axial_stiffness: E A in N, infinite for the paper's inextensible tendon.  free_length: m of
    tendon between stepper and base, which stretches too.  friction: Capstan coefficient at every
    guide.
    """

    axial_stiffness: float = inf
    free_length: float = 0.0
    friction: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what is not a tendon."""
        if self.axial_stiffness != inf:
            check_range('tendon axial stiffness E A', self.axial_stiffness, 1.0, 1e9, 'N')
        check_range('tendon free length', self.free_length, 0.0, 100.0, 'm')
        check_range('tendon friction coefficient', self.friction, 0.0, 2.0, '')


@dataclass(frozen=True)
class PointForce:
    """A dead force on the centre of a disc (0: base): x and z in the base frame, N."""

    disc: int
    x: float
    z: float


PAPER, SECOND_ORDER = 'paper', 'second_order'
TENDONS = ('right_tendon', 'left_tendon')
"""The tendons of a planar arm, at +x and -x."""


PLANAR_AXES = np.array([True, False, True, False, True, False])
SPATIAL_AXES = np.ones(6, dtype=bool)
"""Which of a disc's shifts along x, y, z and turns about them there are."""


def check_discretisation(value: str) -> None:
    """Refuse what is no discretisation; raises ArmError."""
    if value not in (PAPER, SECOND_ORDER):
        raise ArmError(f'discretisation is {value!r}; allowed: {PAPER}, {SECOND_ORDER}')


@dataclass(frozen=True)
class Arm:
    """
    A planar arm: n segments between n + 1 discs, base first.

    bodies_per_segment: rigid bodies n of the chain model.  discretisation: PAPER, n + 1 equal
    springs, which converges to the rod like 1/n; or SECOND_ORDER, end springs twice as stiff as
    those between the bodies, which converges like 1/n^2.  payload: kg at the top of the tip disc.
    mounting_angle: rotation about +y of base_link from upright, rad: 0 upright, pi hanging.
    gravity: m/s^2, 0 to leave it out.
    """

    segments: tuple[Segment, ...]
    discs: tuple[Disc, ...]
    bodies_per_segment: int = 12
    discretisation: str = PAPER
    tendon: Tendon = Tendon()
    payload: float = 0.0
    forces: tuple[PointForce, ...] = ()
    mounting_angle: float = 0.0
    gravity: float = STANDARD_GRAVITY

    bend_time: ClassVar[float] = 5e-4
    """How long the statics take for one bending, roughly, s."""

    def __post_init__(self) -> None:
        """Refuse what is not a physical arm."""
        for name, parts, kind in (('segments', self.segments, Segment),
                                  ('discs', self.discs, Disc),
                                  ('forces', self.forces, PointForce)):
            if not (isinstance(parts, Sequence) and all(isinstance(p, kind) for p in parts)):
                raise ArmError(f'{name} are {parts!r}; give a tuple, each a {kind.__name__}')
        if not isinstance(self.tendon, Tendon):
            raise ArmError(f'tendon is {self.tendon!r}; give a Tendon')
        if not self.segments:
            raise ArmError('an arm needs at least one segment')
        if len(self.discs) != len(self.segments) + 1:
            raise ArmError(
                f'{len(self.segments)} segments need {len(self.segments) + 1} discs, '
                f'one below each segment and one at the tip; given: {len(self.discs)}')
        if not (whole(self.bodies_per_segment)
                and 1 <= self.bodies_per_segment <= 1000):
            raise ArmError(
                f'bodies per segment is {self.bodies_per_segment}; allowed: a whole '
                'number from 1 to 1000')
        check_discretisation(self.discretisation)
        for force in self.forces:
            if not (whole(force.disc) and 0 <= force.disc < len(self.discs)):
                raise ArmError(f'there is no disc {force.disc}; the discs are 0 to '
                               f'{len(self.discs) - 1}')
            check_range('point force x', force.x, -1e6, 1e6, 'N')
            check_range('point force z', force.z, -1e6, 1e6, 'N')
        check_range('payload', self.payload, 0.0, 100.0, 'kg')
        check_range('mounting angle', self.mounting_angle, -2 * pi, 2 * pi, 'rad')
        check_range('gravity', self.gravity, 0.0, 100.0, 'm/s^2')

    @property
    def tendon_names(self) -> tuple[str, ...]:
        """Names of the tendons, in the order of every list of tendons."""
        return TENDONS

    @property
    def tendon_labels(self) -> tuple[str, ...]:
        """How tables name the tendons."""
        return tuple(name.removesuffix('_tendon') for name in TENDONS)

    @property
    def bending_angle_limits(self) -> NDArray[np.float64]:
        """How far each segment may bend, (segments,), rad."""
        return np.array([segment.bending_angle_limit for segment in self.segments])

    @property
    def bending_axes(self) -> NDArray[np.bool_]:
        """Whether each segment bends about x and y, (segments, 2): about y only."""
        return np.tile([False, True], (len(self.segments), 1))

    @property
    def tendon_ends(self) -> tuple[int, ...]:
        """Number of the disc where each tendon ends (base 0): the last one."""
        return (len(self.segments),) * len(TENDONS)

    @property
    def opposing_tendons(self) -> list[list[int]]:
        """Numbers of the tendons that oppose each other, in groups: the two."""
        return [[0, 1]]

    @property
    def guide_radii(self) -> NDArray[np.float64]:
        """Largest distance of a guide from the backbone in each segment, (segments,), m."""
        return np.array([max(segment.guide_offsets) for segment in self.segments])

    def tendon_places(self, segment: int) -> NDArray[np.float64]:
        """Return x and y of the tendons at both ends of a segment (0-based), (k, 2) m."""
        offsets = self.segments[segment].guide_offsets
        return np.array([(side * offset, 0.0) for side in (1.0, -1.0) for offset in offsets])

    @property
    def spacers(self) -> int:
        """Guides of every tendon inside each segment: none."""
        return 0

    @property
    def free_fall(self) -> NDArray[np.float64]:
        """Acceleration of free fall in base_link, (3,), m/s^2."""
        turn = self.mounting_angle
        return self.gravity * np.array([np.sin(turn), 0.0, -np.cos(turn)])

    @property
    def axes(self) -> str:
        """Names of the axes of base_link along which its points move."""
        return 'xz'

    @property
    def pose_axes(self) -> NDArray[np.bool_]:
        """Which of its discs' shifts along x, y, z and turns about them there are, (6,)."""
        return PLANAR_AXES

    @property
    def length(self) -> float:
        """Length of the straight arm from the bottom of the base disc to the tip, m."""
        return sum(s.length for s in self.segments) + sum(d.height for d in self.discs)

    @property
    def straight_spans(self) -> tuple[float, ...]:
        """Length of a tendon between the guides at both ends of each segment, straight arm, m."""
        return tuple(
            float((s.length**2 + (s.guide_offsets[1] - s.guide_offsets[0])**2)**0.5)
            for s in self.segments)

    def without_gravity(self) -> 'Arm':
        """Return the same arm with gravity left out."""
        return replace(self, gravity=0.0)

    def without_friction(self) -> 'Arm':
        """Return the same arm with the friction of its tendons left out."""
        return replace(self, tendon=replace(self.tendon, friction=0.0))

    def with_force(self, disc: int, force: Sequence[float]) -> 'Arm':
        """Return the same arm with one more dead force (3,) N, of which x and z act, on a disc."""
        x, _, z = map(float, force)
        return replace(self, forces=(*self.forces, PointForce(disc, x, z)))

    def with_compliant_tendons(self, stretch: float) -> 'Arm':
        """Return the same arm, inextensible tendons now stretching by ``stretch`` m/N."""
        if self.tendon.axial_stiffness < inf:
            return self
        length = self.tendon.free_length + self.length
        return replace(self, tendon=replace(self.tendon, axial_stiffness=length / stretch))

    def with_bodies(self, bodies_per_segment: int) -> 'Arm':
        """Return the same arm with another number of rigid bodies per segment."""
        return replace(self, bodies_per_segment=bodies_per_segment)

    def with_bending_stiffness(self, segment: int, bending_stiffness: float) -> 'Arm':
        """Return the same arm with E I (N m^2) of one segment (0-based) replaced."""
        if not (whole(segment) and 0 <= segment < len(self.segments)):
            raise ArmError(f'there is no segment {segment}; the segments are 0 to '
                           f'{len(self.segments) - 1}')
        segments = tuple(
            replace(s, bending_stiffness=bending_stiffness) if i == segment else s
            for i, s in enumerate(self.segments))
        return replace(self, segments=segments)
