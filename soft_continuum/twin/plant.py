# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A planar arm as a plant: hinges about y, and tendons at both sides."""

from collections.abc import Sequence
from math import cos, sin

import numpy as np
from numpy.typing import NDArray

from soft_continuum.mechanics.arm import Arm
from soft_continuum.mechanics.chain import full_poses
from soft_continuum.twin import mjcf
from soft_continuum.twin.any_plant import (
    AnyPlant,
    Array,
    joint_stiffness,
    stiffness_factors,
    TIME_STEP,
)
from soft_continuum.twin.differences import Differences, Obstacle
from soft_continuum.twin.spatial_plant import SpatialPlant

__all__ = ('Plant', 'plant_of', 'TIME_STEP')
ARMATURE = 1e-3  # kg m^2 of each hinge: with less, taut tendons chatter at this time step


def plant_of(arm: Arm, differences: Differences) -> AnyPlant:
    """Return the plant of an arm, planar or spatial; raises TwinError."""
    if arm.planar:
        return Plant(arm, differences)
    return SpatialPlant(arm, differences)


class Plant(AnyPlant):
    """The plant of a planar arm; joints are hinges."""

    arm: Arm

    def __init__(self, arm: Arm, differences: Differences) -> None:
        """Build it as AnyPlant."""
        factors = stiffness_factors(arm, differences)
        stiffnesses = np.array([s.stiffness_y for s in arm.segments]) * factors
        springs = joint_stiffness(arm, stiffnesses[:, None])
        super().__init__(arm, differences,
                         _model(arm, differences.mass_factor, differences.obstacles),
                         springs, springs)

    @property
    def joint_names(self) -> list[str]:
        """Names of the joints, base first."""
        return [f'joint_{n}' for n in range(1, self._model.nv + 1)]

    @property
    def joint_angles(self) -> Array:
        """Angles of all joints, base first, (joints,), rad."""
        angles: Array = self._data.qpos.copy()
        return angles

    @property
    def points(self) -> Array:
        """Bottom and top of every disc: (x, z, angle), (2 * discs, 3), m and rad, base first."""
        theta = np.cumsum(self._data.qpos)
        rows = [(0.0, 0.0, 0.0), (0.0, self.arm.discs[0].height, 0.0)]
        for k, disc in enumerate(self.arm.discs[1:], start=1):
            x, _, z = self._data.xpos[self._disc(k)]
            angle = float(theta[k * self._per_segment - 1])
            rows += [(x, z, angle), (x + disc.height * sin(angle), z + disc.height * cos(angle),
                                     angle)]
        return np.array(rows)

    @property
    def poses(self) -> Array:
        """Bottom and top of every disc: x, y, z (m), quaternion x, y, z, w, (2 * discs, 7)."""
        return full_poses(self.points)

    def _load(self) -> None:
        for wrench in self.arm.wrenches:
            if wrench.disc > 0:  # the base does not move
                self._data.xfrc_applied[self._disc(wrench.disc), :3] = wrench.force

    def _angles(self) -> Array:
        angles: Array = self._data.qpos[:, None]
        return angles

    def _set_springs(self) -> None:
        total = self._springs + self._jam
        self._model.jnt_stiffness[:] = total[:, 0]
        self._model.qpos_spring[:] = (self._jam * self._held / total)[:, 0]
        self._model.dof_damping[:] = self.differences.damping_time * total[:, 0]

    def _shift(self) -> Array:
        return self._random.uniform(-1.0, 1.0, 1)

    def _turned(self) -> tuple[NDArray[np.intp], Array]:
        turned = np.cumsum(np.abs(self._data.qpos.reshape(-1, self._per_segment).sum(axis=1)))
        return np.repeat([0, 1], len(turned)), np.tile(turned, 2)


def _model(arm: Arm, mass_factor: float, obstacles: Sequence[Obstacle]) -> str:
    """Return the arm as MJCF, in base_link: z along the straight arm, bending about y."""
    half_width = max(segment.outer_diameter for segment in arm.segments)
    hinge = f'<joint type="hinge" axis="0 1 0" stiffness="1" armature="{ARMATURE!r}"/>'
    pulled = arm.tendons[0]
    lines = [_sites('base', pulled.offset_at(0, 0.0), arm.discs[0].height)]
    guides = ['base']
    below, joint = arm.discs[0].height, 0
    for k, segment in enumerate(arm.segments):
        n, disc = arm.bodies_per_segment, arm.discs[k + 1]
        for length, mass in [(segment.length / n, segment.mass / n)] * n + [
                (disc.height, disc.mass)]:
            lines.append(mjcf.opened(f'b{joint}', below, hinge, length, mass_factor * mass))
            if obstacles:
                half = segment.outer_diameter / 2.0
                lines.append(f'<geom type="box" size="{half!r} {half!r} {length / 2.0!r}" '
                             f'pos="0 0 {length / 2.0!r}" {mjcf.ARM} {mjcf.CONTACT}/>')
            below, joint = length, joint + 1
        lines.append(_sites(f'top{k}', pulled.offset_at(k, 1.0), 0.0))
        guides.append(f'top{k}')
        if k + 1 < len(arm.segments):
            lines.append(_sites(f'end{k}', pulled.offset_at(k + 1, 0.0), disc.height))
            guides.append(f'end{k}')
    lines.append(mjcf.payload(below, arm.payload))
    tendons = [mjcf.tendon([f'{guide}_{name}' for guide in guides], 10.0 * arm.length)
               for name in arm.tendon_names]
    spans = [mjcf.tendon([f'{lower}_{name}', f'{upper}_{name}']) for name in arm.tendon_names
             for lower, upper in zip(guides[::2], guides[1::2], strict=True)]
    return mjcf.document(
        [float(part) for part in arm.gravity], TIME_STEP,
        mjcf.cylinders(obstacles, half_width) + ''.join(lines) + '</body>' * joint,
        ''.join(tendons + spans))


def _sites(name: str, offset: float, height: float) -> str:
    """Return the guides of both tendons at one height."""
    return ''.join(mjcf.site(f'{name}_{tendon}', side * offset, 0.0, height)
                   for tendon, side in (('right_tendon', 1.0), ('left_tendon', -1.0)))
