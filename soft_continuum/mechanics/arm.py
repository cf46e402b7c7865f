# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The arm: a base disc, then alternating segments and discs, straight up in its reference state.

Frame ``base_link``: origin at the bottom centre of the base disc, z along the straight arm, x and
y across it.  A positive bending about y moves the tip towards +x.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations
from math import atan2, cos, inf, pi, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from soft_continuum.mechanics._checks import finite, listed, real_array, whole
from soft_continuum.mechanics.laws import Jam, linear, MomentCurvature

Array = NDArray[np.float64]

STANDARD_GRAVITY = 9.80665  # m/s^2

LENGTH_RANGE = (1e-3, 10.0)  # m; outside it the unit is wrong
MIN_OFFSET = 1e-4  # m, of a guide that is not on the axis
HALF_TURN_TOLERANCE = 1e-3  # rad: tendons opposite each other are written with so many digits


class ArmError(ValueError):
    """The description is not that of a physical arm."""


def check_range(name: str, value: float, low: float, high: float, unit: str) -> None:
    """Raise ArmError unless the value is a number from ``low`` to ``high``."""
    if not finite(value):
        raise ArmError(
            f'{name} is {value!r}; allowed: a number from {low:g} to {high:g} {unit}'.rstrip())
    if not low <= value <= high:
        hint = ' (lengths are in metres)' if unit == 'm' else ''
        raise ArmError(f'{name} is {value:g} {unit}; allowed: {low:g} to {high:g} {unit}{hint}')


def _check_vector(name: str, value: Sequence[float], unit: str, most: float = 1e6) -> None:
    if not isinstance(value, tuple | list) or len(value) != 3:
        raise ArmError(f'{name} is {value!r}; give x, y and z in {unit}')
    for part in value:
        check_range(name, part, -most, most, unit)


@dataclass(frozen=True)
class Segment:
    """
    A segment that bends.

    length: m.  stiffness_x, stiffness_y: E I of the soft state about the x and y axes of its
    cross-section, N m^2; inf about one axis makes a hinge about the other, such as a leaf spring.
    torsional_stiffness: G J, N m^2.  mass: kg, evenly distributed along the length.
    jam: the stiffness added in the stiff state.  It yields about the softer axis at its yield
    moment, about the other at that times the square root of the stiffness ratio of the axes.
    outer_diameter: m, for drawing.  bending_angle_limit: rad, largest bending angle in any
    direction for goals and inverse problems.
    friction: N m, moment that opposes bending of the soft segment, as rubbing tendons do.
    The shape then depends on earlier shapes.  presliding: 1/m, curvature before friction slides.
    soft_law: measured moment over curvature of the soft state about the softer axis, in place of
    its E I; the ratio of stiffness_x and stiffness_y scales the other axis.  In a round spring
    the moment is along the bending and depends on its size.
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

    @classmethod
    def leaf_spring(cls, length: float, stiffness: float, mass: float = 0.0, **others: Any
                    ) -> 'Segment':
        """Return a segment that bends about y only: E I in N m^2; the rest as for Segment."""
        return cls(length, inf, stiffness, mass=mass, **others)

    def __post_init__(self) -> None:
        """Raise ArmError for a segment that is not physical."""
        check_range('segment length', self.length, *LENGTH_RANGE, 'm')
        for name, value, most in (
                ('bending stiffness E I about x', self.stiffness_x, 1e3),
                ('bending stiffness E I about y', self.stiffness_y, 1e3),
                ('torsional stiffness G J', self.torsional_stiffness, 1e6)):
            if value != inf:
                check_range(name, value, 1e-9, most, 'N m^2')
        if self.stiffness_x == self.stiffness_y == inf:
            raise ArmError('a segment must bend about at least one axis; both stiffnesses are '
                           'infinite')
        check_range('bending angle limit', self.bending_angle_limit, 1e-3,
                    2 * pi if inf in (self.stiffness_x, self.stiffness_y) else pi, 'rad')
        check_range('segment mass', self.mass, 0.0, 10.0, 'kg')
        check_range('outer diameter', self.outer_diameter, *LENGTH_RANGE, 'm')
        check_range('friction of a segment', self.friction, 0.0, 1e3, 'N m')
        check_range('presliding curvature', self.presliding, 1e-3, 1e3, '1/m')
        if not isinstance(self.jam, Jam):
            raise ArmError(f'jam is {self.jam!r}; give a Jam, such as Jam(ratio=5.0)')
        if not isinstance(self.soft_law, MomentCurvature | None):
            raise ArmError(f'soft law is {self.soft_law!r}; give a MomentCurvature or none')
        if self.jam.law is not None:  # the moment added by the jam must be a law, too
            self.jam.law.minus(
                self.soft_law or linear(min(self.stiffness_x, self.stiffness_y)))

    @property
    def stiffnesses(self) -> tuple[float, ...]:
        """E I about y and x, and G J, N m^2; of a hinge about y the first alone."""
        all_three = self.stiffness_y, self.stiffness_x, self.torsional_stiffness
        return all_three[:1] if all_three[1:] == (inf, inf) else all_three

    def with_stiffness_factor(self, factor: float) -> 'Segment':
        """Return the segment with all stiffnesses times a factor, without friction."""
        check_range('factor', factor, 0.0, 1e9, '')
        return replace(self, stiffness_x=self.stiffness_x * factor,
                       stiffness_y=self.stiffness_y * factor,
                       torsional_stiffness=self.torsional_stiffness * factor, friction=0.0)


@dataclass(frozen=True)
class Disc:
    """
    A rigid disc: height l_k in m, mass in kg, centre of mass at mid-height.

    With no height it is a mark on a rod.
    """

    height: float = 0.0
    mass: float = 0.0

    def __post_init__(self) -> None:
        """Raise ArmError for a disc that is not physical."""
        if self.height != 0.0:
            check_range('disc height', self.height, *LENGTH_RANGE, 'm')
        check_range('disc mass', self.mass, 0.0, 10.0, 'kg')


@dataclass(frozen=True)
class Tendon:
    """
    A tendon, from the bottom of the base disc to the disc where it ends.

    name: unique.  angle: of its guide at the base, rad about z from x.  offset: m from the axis;
    one for all guides, or two for each segment that the tendon passes, at its lower and its upper
    end.  end: number of the last disc (base 0).  twist: rad per m of arm, for a helical tendon.
    axial_stiffness: E A in N, inf for an inextensible tendon.
    friction: Capstan coefficient at every guide.  free_length: m between motor and base, which
    stretches under the tension at the base.
    """

    name: str
    angle: float
    offset: float | tuple[float, ...]
    end: int
    twist: float = 0.0
    axial_stiffness: float = inf
    friction: float = 0.0
    free_length: float = 0.0

    def __post_init__(self) -> None:
        """Raise ArmError for an invalid tendon."""
        if not (isinstance(self.name, str) and self.name):
            raise ArmError(f'the name of a tendon is {self.name!r}; give a text')
        check_range(f'angle of {self.name}', self.angle, -4 * pi, 4 * pi, 'rad')
        if not (whole(self.end) and self.end >= 1):
            raise ArmError(f'{self.name} ends at disc {self.end!r}; the base is 0, a tendon ends '
                           'at 1 or above')
        offsets = self.offset if isinstance(self.offset, tuple) else (self.offset,)
        for offset in offsets:
            if offset != 0.0:
                check_range(f'offset of {self.name}', offset, MIN_OFFSET, LENGTH_RANGE[1], 'm')
        if len(offsets) not in (1, 2 * self.end):
            raise ArmError(f'{self.name} has {len(offsets)} offsets; needed: one, or '
                           f'{2 * self.end}, two for each segment up to disc {self.end}')
        check_range(f'twist of {self.name}', self.twist, -1e3, 1e3, 'rad/m')
        if self.axial_stiffness != inf:
            check_range(f'axial stiffness E A of {self.name}', self.axial_stiffness,
                        1.0, 1e9, 'N')
        check_range(f'friction coefficient of {self.name}', self.friction, 0.0, 2.0, '')
        check_range(f'free length of {self.name}', self.free_length, 0.0, 100.0, 'm')

    def offset_at(self, segment: int, part: float) -> float:
        """Distance from the axis in a segment (0-based), part 0 to 1 along it, m."""
        if not isinstance(self.offset, tuple) or len(self.offset) == 1:
            return self.offset[0] if isinstance(self.offset, tuple) else self.offset
        lower, upper = self.offset[2 * segment:2 * segment + 2]
        return lower + part * (upper - lower)


PAIR = ('right_tendon', 'left_tendon')
"""The tendons of a planar arm, at +x and -x."""


def tendon_pair(offset: float | tuple[float, ...], end: int, **others: Any
                ) -> tuple[Tendon, Tendon]:
    """Return the right and the left tendon of a planar arm; the rest as for Tendon."""
    right, left = (Tendon(name, angle, offset, end, **others)
                   for name, angle in zip(PAIR, (0.0, pi), strict=True))
    return right, left


@dataclass(frozen=True)
class Wrench:
    """A dead force (N) and moment (N m) on the centre of a disc (0: base), in base_link."""

    disc: int
    force: tuple[float, float, float] = (0.0, 0.0, 0.0)
    moment: tuple[float, float, float] = (0.0, 0.0, 0.0)


BEND_TIME = {True: 5e-4, False: 0.02}  # s, of planar arms and others
PAPER, SECOND_ORDER = 'paper', 'second_order'

PLANAR_AXES = np.array([True, False, True, False, True, False])
SPATIAL_AXES = np.ones(6, dtype=bool)
"""Which shifts of a disc along x, y, z and turns about them are possible."""


def mounted(angle: float, gravity: float = STANDARD_GRAVITY) -> tuple[float, float, float]:
    """Return gravity in a base_link rotated about +y from upright, rad; pi: hanging."""
    check_range('mounting angle', angle, -2 * pi, 2 * pi, 'rad')
    check_range('gravity', gravity, 0.0, 100.0, 'm/s^2')
    return gravity * sin(angle), 0.0, -gravity * cos(angle)


@dataclass(frozen=True)
class Arm:
    """
    An arm: n segments between n + 1 discs, base first, and its tendons.

    bodies_per_segment: rigid bodies n of the chain model; a multiple of spacers + 1.  spacers:
    guides of every tendon inside each segment, evenly spaced.  discretisation: PAPER, n + 1 equal
    springs, which converges to the rod like 1/n; or SECOND_ORDER, end springs twice as stiff as
    those between the bodies, which converges like 1/n^2.  payload: kg at the top of the tip disc.
    gravity: acceleration of free fall in base_link, m/s^2, such as mounted(pi).  weightless_angle:
    mounting_angle of an arm without gravity, rad.
    """

    segments: tuple[Segment, ...]
    discs: tuple[Disc, ...]
    tendons: tuple[Tendon, ...]
    bodies_per_segment: int = 12
    spacers: int = 0
    discretisation: str = PAPER
    payload: float = 0.0
    wrenches: tuple[Wrench, ...] = ()
    gravity: tuple[float, float, float] = mounted(0.0)
    weightless_angle: float = 0.0

    def __post_init__(self) -> None:
        """Raise ArmError for an arm that is not physical."""
        for name, kind in (('segments', Segment), ('discs', Disc), ('tendons', Tendon),
                           ('wrenches', Wrench)):
            parts = getattr(self, name)
            if not (isinstance(parts, tuple) and all(isinstance(p, kind) for p in parts)):
                raise ArmError(f'{name} are {parts!r}; give a tuple, each a {kind.__name__}')
        if not self.segments:
            raise ArmError('an arm needs at least one segment')
        if len(self.discs) != len(self.segments) + 1:
            raise ArmError(
                f'{len(self.segments)} segments need {len(self.segments) + 1} discs, '
                f'one below each segment and one at the tip; given: {len(self.discs)}')
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
            _check_vector('force', wrench.force, 'N')
            _check_vector('moment', wrench.moment, 'N m')
        if self.discretisation not in (PAPER, SECOND_ORDER):
            raise ArmError(f'discretisation is {self.discretisation!r}; allowed: {PAPER}, '
                           f'{SECOND_ORDER}')
        for name, least in (('bodies_per_segment', 1), ('spacers', 0)):
            value = getattr(self, name)
            if not (whole(value) and least <= value <= 1000):
                raise ArmError(f'{name.replace("_", " ")} is {value!r}; allowed: a whole number '
                               f'from {least} to 1000')
        if self.bodies_per_segment % (self.spacers + 1):
            raise ArmError(f'{self.bodies_per_segment} bodies per segment and {self.spacers} '
                           'spacers; bodies must be a multiple of spacers + 1, so that spacers '
                           'sit between bodies')
        check_range('payload', self.payload, 0.0, 100.0, 'kg')
        _check_vector('gravity', self.gravity, 'm/s^2', 100.0)
        check_range('mounting angle', self.weightless_angle, -2 * pi, 2 * pi, 'rad')
        if not self.planar:
            for segment in self.segments:  # bending beyond half a turn is bending the other way
                check_range('bending angle limit', segment.bending_angle_limit, 1e-3, pi, 'rad')

    @cached_property
    def planar(self) -> bool:
        """Whether all segments hinge about y and two opposite, equal tendons bend them."""
        if len(self.tendons) != len(PAIR) or self.spacers:
            return False
        right, left = self.tendons
        one, other = ((t.offset, t.end, t.twist, t.axial_stiffness, t.friction, t.free_length)
                      for t in self.tendons)
        return (
            (right.angle, left.angle) == (0.0, pi) and one == other
            and (right.end, right.twist) == (len(self.segments), 0.0)
            and all(right.offset_at(s, part) > 0.0
                    for s in range(len(self.segments)) for part in (0.0, 1.0))
            and all((s.stiffness_x, s.torsional_stiffness, s.friction) == (inf, inf, 0.0)
                    for s in self.segments)
            and not any(wrench.moment[1] for wrench in self.wrenches))

    @property
    def bend_time(self) -> float:
        """Approximate time to solve the statics for one bending, s."""
        return BEND_TIME[self.planar]

    @property
    def axes(self) -> str:
        """Axes of base_link along which points of the arm move."""
        return 'xz' if self.planar else 'xyz'

    @property
    def pose_axes(self) -> NDArray[np.bool_]:
        """Which shifts of discs along x, y, z and turns about them are possible, (6,)."""
        return PLANAR_AXES if self.planar else SPATIAL_AXES

    @property
    def tendon_names(self) -> tuple[str, ...]:
        """Names of the tendons, in the order of every list of tendons."""
        return tuple(tendon.name for tendon in self.tendons)

    @property
    def tendon_labels(self) -> tuple[str, ...]:
        """Names of the tendons in tables: right and left in a planar arm."""
        names = self.tendon_names
        return tuple(name.removesuffix('_tendon') for name in names) if self.planar else names

    @property
    def bending_angle_limits(self) -> Array:
        """Bending angle limit of each segment, (segments,), rad."""
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
        Pairs and triples of opposing tendons that end at one disc, by number.

        The backbone is between them: they can carry tension without bending it.
        """
        found = []
        for end in set(self.tendon_ends):
            of_disc = [t for t, tendon in enumerate(self.tendons) if tendon.end == end]
            for which in (*combinations(of_disc, 2), *combinations(of_disc, 3)):
                angles = np.sort([self.tendons[t].angle % (2 * pi) for t in which])
                if np.diff(angles, append=angles[0] + 2 * pi).max() <= pi + HALF_TURN_TOLERANCE:
                    found.append([*which])
        return found

    def places(self, tendon: int, parts: Sequence[float]) -> Array:
        """
        Return x and y of a tendon (0-based) at fractions 0 to 1 along each segment.

        (segments, fractions, 2) m; nan in segments that the tendon does not pass.
        """
        one, along = self.tendons[tendon], np.array(parts)
        found = np.full((len(self.segments), len(along), 2), np.nan)
        below = self.discs[0].height
        for s, segment in enumerate(self.segments[:one.end]):
            angle = one.angle + one.twist * (below + along * segment.length)
            lower, upper = one.offset_at(s, 0.0), one.offset_at(s, 1.0)
            offset = lower + along * (upper - lower)
            found[s, :, 0], found[s, :, 1] = offset * np.cos(angle), offset * np.sin(angle)
            below += segment.length + self.discs[s + 1].height
        return found

    @cached_property
    def guide_places(self) -> Array:
        """Positions of all guides, with spacers, (tendons, segments, spacers + 2, 2), m."""
        parts = np.linspace(0.0, 1.0, self.spacers + 2)
        found = np.array([
            self.places(t, parts.tolist()) for t in range(len(self.tendons))]).reshape(
            -1, len(self.segments), len(parts), 2)
        found.flags.writeable = False
        return found

    @property
    def guide_radii(self) -> Array:
        """Largest distance of a guide from the backbone in each segment, (segments,), m."""
        radii = np.linalg.norm(np.nan_to_num(self.guide_places[:, :, [0, -1]]), axis=-1)
        found: Array = radii.max(axis=(0, 2), initial=0.0)
        return found

    @property
    def ropes(self) -> Array:
        """Length of each tendon from motor to end in the straight arm, (tendons,), m."""
        lengths = np.array([segment.length for segment in self.segments])
        spans = np.hypot(np.linalg.norm(np.diff(self.guide_places, axis=2), axis=-1),
                         lengths[:, None] / (self.spacers + 1))
        through = np.cumsum([disc.height for disc in self.discs])[list(self.tendon_ends)]
        found: Array = np.nansum(spans, axis=(1, 2)) + through + [
            tendon.free_length for tendon in self.tendons]
        return found

    @property
    def compliance(self) -> Array:
        """Compliance of each tendon without friction, (tendons,), m/N."""
        return self.ropes / [tendon.axial_stiffness for tendon in self.tendons]

    @property
    def mounting_angle(self) -> float:
        """Rotation of base_link about +y from upright, rad; from gravity unless that is 0."""
        if not any(self.gravity):
            return self.weightless_angle
        return atan2(self.gravity[0], -self.gravity[2])

    @property
    def length(self) -> float:
        """Length of the straight arm from the bottom of the base disc to the tip, m."""
        return sum(s.length for s in self.segments) + sum(d.height for d in self.discs)

    def without_gravity(self) -> 'Arm':
        """Return the same arm without gravity."""
        return replace(self, gravity=(0.0, 0.0, 0.0), weightless_angle=self.mounting_angle)

    def without_friction(self) -> 'Arm':
        """Return the same arm without friction of tendons and segments."""
        return replace(self.with_tendons(friction=0.0), segments=tuple(
            replace(segment, friction=0.0) for segment in self.segments))

    def with_tendons(self, **changes: Any) -> 'Arm':
        """Return the same arm with these fields of all tendons replaced."""
        return replace(self, tendons=tuple(replace(t, **changes) for t in self.tendons))

    def with_force(self, disc: int, force: Sequence[float]) -> 'Arm':
        """Return the same arm with one more dead force (3,) N on a disc."""
        given = listed(real_array(force, 'a force must be x, y and z in N').tolist())
        return replace(self, wrenches=(*self.wrenches, Wrench(disc, tuple(given))))

    def with_compliant_tendons(self, stretch: float) -> 'Arm':
        """Return the same arm with a compliance, m/N, for its inextensible tendons."""
        check_range('stretch', stretch, 1e-12, 1.0, 'm/N')
        return replace(self, tendons=tuple(
            replace(tendon, axial_stiffness=float(rope) / stretch)
            if tendon.axial_stiffness == inf else tendon
            for tendon, rope in zip(self.tendons, self.ropes, strict=True)))

    def with_bodies(self, bodies_per_segment: int) -> 'Arm':
        """Return the same arm with another number of rigid bodies per segment."""
        return replace(self, bodies_per_segment=bodies_per_segment)


def check_arm(arm: object) -> None:
    """Raise ArmError if this is not an Arm."""
    if not isinstance(arm, Arm):
        raise ArmError(f'an Arm is needed; given: {arm!r}')
