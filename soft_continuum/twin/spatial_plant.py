# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
A spatial arm as a plant: ball joints, and tendons routed anyhow.

The springs of MuJoCo's ball joints are as stiff about every axis and know no moment.  So each
joint has three actuators instead, about the rows of J^-1: with the rotation vector phi of the
joint, and the velocity omega of the body in its own frame, phi' = J^-1 omega (Chirikjian,
Stochastic Models, Information Theory, and Lie Groups, volume 2, 10.86).  Their damping is a
property of the model, which MuJoCo integrates implicitly: that is what makes stiff ones stable.
What is described as infinitely stiff is RIGID times as stiff as the softest bending.
"""

from dataclasses import dataclass
from math import cos, inf, pi, sin

import numpy as np
from numpy.typing import NDArray

from soft_continuum.mechanics.arm import Arm
from soft_continuum.twin import mjcf
from soft_continuum.twin.any_plant import (
    AnyPlant,
    Array,
    joint_stiffness,
    stiffness_factors,
    TIME_STEP,
)
from soft_continuum.twin.differences import Differences, TwinError

RIGID = 1e6
ARMATURE, HEAVIEST = 5e-4, 30.0
"""
kg m^2 of each joint for each N m/rad, of what is stiff at most for this many times its spring.

MuJoCo finds the tensions as if its joints moved freely, as stiff ones do not.  As long as these
are heavier tensions settle; else they chatter.
"""
AXES = 'xyz'


class SpatialPlant(AnyPlant):
    """The plant of a spatial arm; joints are rotation vectors about x, y, z of the body below."""

    arm: Arm

    def __init__(self, arm: Arm, differences: Differences) -> None:
        """Build it as AnyPlant."""
        factors = stiffness_factors(arm, differences)[:, None]
        if any(segment.friction for segment in arm.segments):
            raise TwinError('the twin knows friction of tendons only, as guide_friction of its '
                            'presets; the description has some of segments')
        given = np.array([[s.stiffness_x, s.stiffness_y, s.torsional_stiffness]
                          for s in arm.segments]) * factors
        given[:, 0] *= differences.lateral_stiffness_factor
        least = given[:, :2].min(axis=1, keepdims=True)
        finite = joint_stiffness(arm, np.where(given < inf, given, 0.0))
        springs = joint_stiffness(arm, np.where(given < inf, given, RIGID * least))
        random = np.random.default_rng([differences.seed, 2])
        self._guides = _guides(arm, random.normal(
            0.0, differences.angle_error, len(arm.tendons)).tolist())
        super().__init__(arm, differences, _model(
            arm, self._guides, springs, differences), springs, finite)
        self._compliance += arm.compliance
        spans = [(t, high.body) for t, guides in enumerate(self._guides)
                 for low, high in zip(guides, guides[1:], strict=False) if high.ends_span]
        self._span_tendons, self._span_bodies = np.array(spans, dtype=np.intp).reshape(-1, 2).T

    @property
    def joint_names(self) -> list[str]:
        """Names of the joints, base first."""
        return [f'joint_{n}_{axis}' for n in range(1, len(self._springs) + 1) for axis in AXES]

    @property
    def joint_angles(self) -> Array:
        """Rotation vectors of all joints, base first, (3 * joints,), rad."""
        return self._angles().ravel()

    @property
    def poses(self) -> Array:
        """Bottom and top of every disc: x, y, z (m), quaternion x, y, z, w, (2 * discs, 7)."""
        found = np.zeros((len(self.arm.discs), 2, 7))
        found[0, :, 6] = 1.0
        for k in range(1, len(self.arm.discs)):
            body = self._disc(k)
            w, x, y, z = self._data.xquat[body]
            found[k, :, 3:] = (x, y, z, w) if w >= 0.0 else (-x, -y, -z, -w)
            found[k, :, :3] = self._data.xpos[body]
            found[k, 1, :3] += self.arm.discs[k].height * self._data.xmat[body, 2::3]
        found[0, 1, 2] = self.arm.discs[0].height
        return found.reshape(-1, 7)

    @property
    def points(self) -> Array:
        """Bottom and top of every disc, base first, (2 * discs, 3), m."""
        return self.poses[:, :3]

    @property
    def energy(self) -> float:
        """Kinetic and potential energy, J."""
        turned = self._angles()
        springs = self._springs * turned**2 + self._jam * (turned - self._held)**2
        return super().energy + 0.5 * float(springs.sum())

    def _load(self) -> None:
        for wrench in self.arm.wrenches:
            if wrench.disc > 0:  # the base does not move
                self._data.xfrc_applied[self._disc(wrench.disc)] += wrench.force + wrench.moment

    def _angles(self) -> Array:
        turns = self._data.qpos.reshape(-1, 4)
        sines = np.linalg.norm(turns[:, 1:], axis=1)
        angles = 2.0 * np.arctan2(sines, np.abs(turns[:, 0]))
        factors = np.where(sines > 0.0, angles / np.maximum(sines, 1e-300), 2.0)
        found: Array = (np.copysign(factors, turns[:, 0]))[:, None] * turns[:, 1:]
        return found

    def _set_springs(self) -> None:
        turned = self._angles()
        total = self._springs + self._jam
        self._data.ctrl[:] = -(self._springs * turned + self._jam * (turned - self._held)).ravel()
        self._model.actuator_gear[:, :3] = _inverse_jacobians(turned).reshape(-1, 3)
        heaviest = HEAVIEST * self._springs[:, :2].min(axis=1, keepdims=True)
        armature = ARMATURE * np.minimum(total, heaviest).ravel()
        before = self._model.dof_armature
        self._data.qvel *= np.minimum(1.0, before / armature)  # no energy comes from it
        before[:] = armature
        self._model.actuator_biasprm[:, 2] = -self.differences.damping_time * total.ravel()

    def _shift(self) -> Array:
        direction, size = self._random.uniform(0.0, 2.0 * pi), self._random.uniform(0.0, 1.0)
        return np.array([size * cos(direction), size * sin(direction), 0.0])

    def _turned(self) -> tuple[NDArray[np.intp], Array]:
        turned = np.cumsum(np.linalg.norm(self._angles()[:, :2], axis=1))
        return self._span_tendons, turned[self._span_bodies]


@dataclass(frozen=True)
class Guide:
    """
    Where a tendon passes a body (-1: the base): x, y, z from its lower end, m.

    ends_span: whether the guide before it is in the same segment.
    """

    name: str
    body: int
    place: tuple[float, float, float]
    ends_span: bool


def _guides(arm: Arm, turns: list[float]) -> list[list[Guide]]:
    """Return the guides of each tendon, base first; turns: rad, of all of a tendon."""
    found: list[list[Guide]] = []
    n, spans = arm.bodies_per_segment, arm.spacers + 1
    for t, tendon in enumerate(arm.tendons):
        guides, bottom = [], arm.discs[0].height
        for s, segment in enumerate(arm.segments[:tendon.end]):
            for k in range(spans + 1):
                along = k / spans * segment.length
                angle = tendon.angle + turns[t] + tendon.twist * (bottom + along)
                offset = tendon.offset_at(s, k / spans)
                on_top = k == 0  # of the disc below
                guides.append(Guide(
                    f's{t}_{s}_{k}', s * (n + 1) + (-1 if on_top else k * n // spans),
                    (offset * cos(angle), offset * sin(angle),
                     arm.discs[s].height if on_top else 0.0), not on_top))
            bottom += segment.length + arm.discs[s + 1].height
        found.append(guides)
    return found


def _model(arm: Arm, guides: list[list[Guide]], springs: Array,
           differences: Differences) -> str:
    """Return the arm as MJCF, in base_link: z along the straight arm; springs: as of AnyPlant."""
    sites: dict[int, str] = {}
    for guide in (guide for each in guides for guide in each):
        sites[guide.body] = sites.get(guide.body, '') + mjcf.site(guide.name, *guide.place)
    lines, below, joint = [sites.get(-1, '')], arm.discs[0].height, 0
    for segment, disc in zip(arm.segments, arm.discs[1:], strict=True):
        n = arm.bodies_per_segment
        for length, mass in [(segment.length / n, segment.mass / n)] * n + [
                (disc.height, disc.mass)]:
            armature = ARMATURE * float(springs[joint, :2].min())
            ball = f'<joint name="j{joint}" type="ball" armature="{armature!r}"/>'
            lines.append(mjcf.opened(
                f'b{joint}', below, ball, length, differences.mass_factor * mass))
            if differences.obstacles and length:
                lines.append(
                    f'<geom type="cylinder" size="{segment.outer_diameter / 2.0!r} '
                    f'{length / 2.0!r}" pos="0 0 {length / 2.0!r}" {mjcf.ARM} {mjcf.CONTACT}/>')
            lines.append(sites.get(joint, ''))
            below, joint = length, joint + 1
    lines.append(mjcf.payload(below, arm.payload))
    tendons = [mjcf.tendon([guide.name for guide in each], 10.0 * arm.length) for each in guides]
    if differences.guide_friction > 0.0:
        tendons += [mjcf.tendon([low.name, high.name]) for each in guides
                    for low, high in zip(each, each[1:], strict=False) if high.ends_span]
    actuators = ''.join(
        f'<general joint="j{j}" gear="{int(axis == 0)} {int(axis == 1)} {int(axis == 2)}" '
        'biastype="affine"/>' for j in range(joint) for axis in range(3))
    return mjcf.document(
        [float(part) for part in arm.gravity], TIME_STEP,
        mjcf.cylinders(differences.obstacles, arm.length) + ''.join(lines) + '</body>' * joint,
        ''.join(tendons), actuators)


def _inverse_jacobians(vectors: Array) -> Array:
    """Return J^-1 of rotation vectors (joints, 3), (joints, 3, 3)."""
    square = (vectors**2).sum(axis=1)
    angle = np.sqrt(np.maximum(square, 1e-8))
    factor = np.where(square < 1e-4, 1.0 / 12.0 + square / 720.0,
                      1.0 / angle**2 - (1.0 + np.cos(angle)) / (2.0 * angle * np.sin(angle)))
    x, y, z = vectors.T
    none = np.zeros_like(x)
    cross = np.array([[none, -z, y], [z, none, -x], [-y, x, none]]).transpose(2, 0, 1)
    found: Array = np.eye(3) + 0.5 * cross + factor[:, None, None] * (cross @ cross)
    return found
