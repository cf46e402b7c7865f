# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
A spatial arm: segments that bend in any direction, and any number of tendons, routed anyhow.

The frame is that of the planar arm: base_link at the bottom centre of the base disc, z along the
straight arm, x and y across it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from math import atan2, cos, inf, pi, radians, sin
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from soft_continuum.mechanics._checks import whole
from soft_continuum.mechanics.arm import (
    Arm,
    ArmError,
    check_discretisation,
    check_range,
    Disc,
    LENGTH_RANGE,
    PAPER,
    SPATIAL_AXES,
    STANDARD_GRAVITY,
)
from soft_continuum.mechanics.laws import Jam, linear, MomentCurvature

HALF_TURN_TOLERANCE = 1e-3  # rad: tendons opposite each other are written with so many digits


def _vector(name: str, value: Sequence[float], unit: str, most: float = 1e6) -> None:
    if not isinstance(value, tuple | list) or len(value) != 3:
        raise ArmError(f'{name} is {value!r}; give x, y and z in {unit}')
    for part in value:
        check_range(name, part, -most, most, unit)


@dataclass(frozen=True)
class SpatialSegment:
    """
    A segment that bends.

    length: m.  stiffness_x, stiffness_y: E I about the x and y axes of its cross-section, N m^2;
    inf for a hinge about the other axis, as a leaf spring is.  torsional_stiffness: G J, N m^2.
    mass: kg.  jam: how it is stiffened; it yields by the moment of bending, about the softer axis
    at its yield moment, about the other at as many times it as the root of the stiffness.
    outer_diameter: m, for drawing.  bending_angle_limit: largest bending angle in any direction
    that goals and inverse problems may use, rad.
    friction: moment, N m, with which the soft segment resists being bent, whichever way, as do
    tendons that rub in guides; so its shape depends on those before.  presliding: curvature, 1/m,
    by which it bends against its friction before this slides.
    soft_law: measured moment over curvature of the soft state about the softer axis, in place of
    its E I; the other axis is as many times stiffer as stiffness_x and stiffness_y say.  In a
    round spring the moment is along the bending, by its size.
    """

    length: float
    stiffness_x: float
    stiffness_y: float
    torsional_stiffness: float = inf
    mass: float = 0.0
    jam: Jam = field(default_factory=Jam)
    outer_diameter: float = 0.04
    bending_angle_limit: float = pi / 2
    friction: float = 0.0
    presliding: float = 0.5
    soft_law: MomentCurvature | None = None

    def __post_init__(self) -> None:
        """Refuse what is not a physical segment."""
        check_range('bending angle limit', self.bending_angle_limit, 1e-3, pi, 'rad')
        check_range('segment length', self.length, *LENGTH_RANGE, 'm')
        for name in ('stiffness_x', 'stiffness_y', 'torsional_stiffness'):
            if getattr(self, name) != inf:
                check_range(name.replace('_', ' '), getattr(self, name), 1e-9, 1e6, 'N m^2')
        if self.stiffness_x == self.stiffness_y == inf:
            raise ArmError('a segment must bend about one axis at least; both stiffnesses are '
                           'infinite')
        check_range('segment mass', self.mass, 0.0, 10.0, 'kg')
        check_range('outer diameter', self.outer_diameter, *LENGTH_RANGE, 'm')
        check_range('friction of a segment', self.friction, 0.0, 1e3, 'N m')
        check_range('presliding curvature', self.presliding, 1e-3, 1e3, '1/m')
        if not isinstance(self.jam, Jam):
            raise ArmError(f'jam is {self.jam!r}; give a Jam, such as Jam(ratio=5.0)')
        if not isinstance(self.soft_law, MomentCurvature | None):
            raise ArmError(f'soft law is {self.soft_law!r}; give a MomentCurvature or none')
        if self.jam.law is not None:  # what the jam adds must be a law, too
            self.jam.law.minus(
                self.soft_law or linear(min(self.stiffness_x, self.stiffness_y)))

    @property
    def stiffnesses(self) -> tuple[float, ...]:
        """What resists to bending and twisting: E I about y and about x, and G J, N m^2."""
        return self.stiffness_y, self.stiffness_x, self.torsional_stiffness

    def with_stiffness_factor(self, factor: float) -> 'SpatialSegment':
        """Return it with all stiffnesses times a factor, and without friction."""
        return replace(self, stiffness_x=self.stiffness_x * factor,
                       stiffness_y=self.stiffness_y * factor,
                       torsional_stiffness=self.torsional_stiffness * factor, friction=0.0)


@dataclass(frozen=True)
class SpatialTendon:
    """
    A tendon, from the bottom of the base disc to the disc where it ends.

    name: unique.  angle: of its guide at the base, rad about z from x.  offset: m from the axis;
    one for all guides, or two for each segment up to the disc where it ends, at its lower and its
    upper end.  end: number of that disc (base 0).  twist: rad per m of arm, by which a helical
    tendon winds around it.  compliance: m/N by which it stretches where nothing rubs.  friction:
    Capstan coefficient at every guide.  free_length: m of it between motor and base, which
    stretches by the tension at the base.
    """

    name: str
    angle: float
    offset: float | tuple[float, ...]
    end: int
    twist: float = 0.0
    compliance: float = 0.0
    friction: float = 0.0
    free_length: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what is not a tendon."""
        if not (isinstance(self.name, str) and self.name):
            raise ArmError(f'the name of a tendon is {self.name!r}; give a text')
        check_range(f'angle of {self.name}', self.angle, -4 * pi, 4 * pi, 'rad')
        if not (whole(self.end) and self.end >= 1):
            raise ArmError(f'{self.name} ends at disc {self.end!r}; the base is 0, a tendon ends '
                           'at 1 or above')
        offsets = self.offset if isinstance(self.offset, tuple) else (self.offset,)
        for offset in offsets:
            check_range(f'offset of {self.name}', offset, 0.0, LENGTH_RANGE[1], 'm')
        if len(offsets) not in (1, 2 * self.end):
            raise ArmError(f'{self.name} has {len(offsets)} offsets; needed: one, or '
                           f'{2 * self.end}, two for each segment up to disc {self.end}')
        check_range(f'twist of {self.name}', self.twist, -1e3, 1e3, 'rad/m')
        check_range(f'compliance of {self.name}', self.compliance, 0.0, 1.0, 'm/N')
        check_range(f'friction coefficient of {self.name}', self.friction, 0.0, 2.0, '')
        check_range(f'free length of {self.name}', self.free_length, 0.0, 100.0, 'm')

    def offset_at(self, segment: int, part: float) -> float:
        """Distance from the axis in a segment (0-based), part 0 to 1 along it, m."""
        if not isinstance(self.offset, tuple) or len(self.offset) == 1:
            return self.offset[0] if isinstance(self.offset, tuple) else self.offset
        lower, upper = self.offset[2 * segment:2 * segment + 2]
        return lower + part * (upper - lower)


@dataclass(frozen=True)
class Wrench:
    """A dead force (N) and moment (N m) on the centre of a disc (0: base), in base_link."""

    disc: int
    force: tuple[float, float, float] = (0.0, 0.0, 0.0)
    moment: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class SpatialArm:
    """
    A spatial arm: n segments between n + 1 discs, base first.

    spacers: guides of every tendon inside each segment, evenly spaced.  bodies_per_segment: of the
    chain of rigid bodies; a multiple of spacers + 1.  discretisation: as of Arm.  gravity:
    acceleration of free fall in base_link, m/s^2.
    """

    segments: tuple[SpatialSegment, ...]
    discs: tuple[Disc, ...]
    tendons: tuple[SpatialTendon, ...]
    bodies_per_segment: int = 12
    spacers: int = 0
    discretisation: str = PAPER
    payload: float = 0.0
    wrenches: tuple[Wrench, ...] = ()
    gravity: tuple[float, float, float] = (0.0, 0.0, -STANDARD_GRAVITY)

    bend_time: ClassVar[float] = 0.02
    """How long the statics take for one bending, roughly, s."""

    def __post_init__(self) -> None:
        """Refuse what is not a physical arm."""
        for name, kind in (('segments', SpatialSegment), ('discs', Disc),
                           ('tendons', SpatialTendon), ('wrenches', Wrench)):
            parts = getattr(self, name)
            if not (isinstance(parts, tuple) and all(isinstance(p, kind) for p in parts)):
                raise ArmError(f'{name} are {parts!r}; give a tuple, each a {kind.__name__}')
        if not self.segments or len(self.discs) != len(self.segments) + 1:
            raise ArmError(
                f'{len(self.segments)} segments and {len(self.discs)} discs; needed: at least '
                'one segment, one disc below each and one at the tip')
        names = [tendon.name for tendon in self.tendons]
        if len(set(names)) != len(names):
            raise ArmError(f'the tendons are named {", ".join(names)}; give each its own name')
        for tendon in self.tendons:
            if tendon.end > len(self.segments):
                raise ArmError(f'{tendon.name} ends at disc {tendon.end}; the last one is '
                               f'{len(self.segments)}')
        for wrench in self.wrenches:
            if not (whole(wrench.disc) and 0 <= wrench.disc < len(self.discs)):
                raise ArmError(f'there is no disc {wrench.disc}; the discs are 0 to '
                               f'{len(self.discs) - 1}')
            _vector('force', wrench.force, 'N')
            _vector('moment', wrench.moment, 'N m')
        check_discretisation(self.discretisation)
        for name in ('bodies_per_segment', 'spacers'):
            value = getattr(self, name)
            if not (whole(value) and 0 <= value <= 1000):
                raise ArmError(f'{name} is {value!r}; allowed: whole numbers up to 1000')
        if not self.bodies_per_segment or self.bodies_per_segment % (self.spacers + 1):
            raise ArmError(f'{self.bodies_per_segment} bodies per segment and {self.spacers} '
                           'spacers; bodies must be a multiple of spacers + 1, so that spacers '
                           'sit between bodies')
        check_range('payload', self.payload, 0.0, 100.0, 'kg')
        _vector('gravity', self.gravity, 'm/s^2', 100.0)

    @property
    def tendon_names(self) -> tuple[str, ...]:
        """Names of the tendons, in the order of every list of tendons."""
        return tuple(tendon.name for tendon in self.tendons)

    @property
    def tendon_labels(self) -> tuple[str, ...]:
        """How tables name the tendons."""
        return self.tendon_names

    @property
    def bending_angle_limits(self) -> NDArray[np.float64]:
        """How far each segment may bend, (segments,), rad."""
        return np.array([segment.bending_angle_limit for segment in self.segments])

    @property
    def bending_axes(self) -> NDArray[np.bool_]:
        """Whether each segment bends about x and y, (segments, 2)."""
        return np.isfinite([[s.stiffness_x, s.stiffness_y] for s in self.segments])

    @property
    def tendon_ends(self) -> tuple[int, ...]:
        """Number of the disc where each tendon ends (base 0)."""
        return tuple(tendon.end for tendon in self.tendons)

    @property
    def opposing_tendons(self) -> list[list[int]]:
        """
        Numbers of the tendons that oppose each other, twos and threes of a disc.

        The backbone is between them: what all of them carry bends nothing.
        """
        found = []
        for end in set(self.tendon_ends):
            of_disc = [t for t, tendon in enumerate(self.tendons) if tendon.end == end]
            for which in (*combinations(of_disc, 2), *combinations(of_disc, 3)):
                angles = np.sort([self.tendons[t].angle % (2 * pi) for t in which])
                if np.diff(angles, append=angles[0] + 2 * pi).max() <= pi + HALF_TURN_TOLERANCE:
                    found.append([*which])
        return found

    @property
    def guide_radii(self) -> NDArray[np.float64]:
        """Largest distance of a guide from the backbone in each segment, (segments,), m."""
        return np.array([max((tendon.offset_at(s, part) for tendon in self.tendons
                              if tendon.end > s for part in (0.0, 1.0)), default=0.0)
                         for s in range(len(self.segments))])

    def tendon_places(self, segment: int) -> NDArray[np.float64]:
        """Return x and y along the tendons that pass a segment (0-based), (k, 2) m."""
        return np.array([place_of(self, tendon, segment, part) for tendon in self.tendons
                         if tendon.end > segment for part in (0.0, 0.5, 1.0)])

    @property
    def mounting_angle(self) -> float:
        """Rotation of base_link about +y from upright, rad, as gravity has it."""
        return atan2(self.gravity[0], -self.gravity[2])

    @property
    def free_fall(self) -> NDArray[np.float64]:
        """Acceleration of free fall in base_link, (3,), m/s^2."""
        return np.array(self.gravity)

    @property
    def axes(self) -> str:
        """Names of the axes of base_link along which its points move."""
        return 'xyz'

    @property
    def pose_axes(self) -> NDArray[np.bool_]:
        """Which of its discs' shifts along x, y, z and turns about them there are, (6,): all."""
        return SPATIAL_AXES

    def with_force(self, disc: int, force: Sequence[float]) -> 'SpatialArm':
        """Return the same arm with one more dead force (3,) N on a disc."""
        x, y, z = map(float, force)
        return replace(self, wrenches=(*self.wrenches, Wrench(disc, (x, y, z))))

    def with_compliant_tendons(self, stretch: float) -> 'SpatialArm':
        """Return the same arm, inextensible tendons now stretching by ``stretch`` m/N."""
        return replace(self, tendons=tuple(
            replace(tendon, compliance=tendon.compliance or stretch) for tendon in self.tendons))

    def without_gravity(self) -> 'SpatialArm':
        """Return the same arm with gravity left out."""
        return replace(self, gravity=(0.0, 0.0, 0.0))

    def with_bodies(self, bodies_per_segment: int) -> 'SpatialArm':
        """Return the same arm with another number of rigid bodies per segment."""
        return replace(self, bodies_per_segment=bodies_per_segment)

    @property
    def length(self) -> float:
        """Length of the straight arm from the bottom of the base disc to the tip, m."""
        return sum(s.length for s in self.segments) + sum(d.height for d in self.discs)


def place_of(arm: SpatialArm, tendon: SpatialTendon, segment: int, part: float = 0.5
             ) -> tuple[float, float]:
    """Return (x, y) of a tendon in a segment (0-based), part 0 to 1 along it, m."""
    below = sum(s.length for s in arm.segments[:segment]) + sum(
        d.height for d in arm.discs[:segment + 1])
    angle = tendon.angle + tendon.twist * (below + part * arm.segments[segment].length)
    offset = tendon.offset_at(segment, part)
    return offset * cos(angle), offset * sin(angle)


def spatial(arm: Arm) -> SpatialArm:
    """Return a planar arm as a spatial one: leaf springs about y, tendons at +x and -x."""
    offsets = tuple(offset for s in arm.segments for offset in s.guide_offsets)
    angle, tendon, last = arm.mounting_angle, arm.tendon, len(arm.segments)
    rope = tendon.free_length + sum(arm.straight_spans) + sum(d.height for d in arm.discs)
    return SpatialArm(
        tuple(SpatialSegment(s.length, inf, s.bending_stiffness, inf, s.mass, s.jam,
                             s.outer_diameter, min(s.bending_angle_limit, pi),
                             soft_law=s.soft_law)
              for s in arm.segments),
        arm.discs,
        tuple(SpatialTendon(name, turn, offsets, last, 0.0, rope / tendon.axial_stiffness,
                            tendon.friction, tendon.free_length)
              for name, turn in zip(arm.tendon_names, (0.0, radians(180.0)), strict=True)),
        arm.bodies_per_segment, 0, arm.discretisation, arm.payload,
        tuple(Wrench(f.disc, (f.x, 0.0, f.z)) for f in arm.forces),
        (arm.gravity * sin(angle), 0.0, -arm.gravity * cos(angle)))
