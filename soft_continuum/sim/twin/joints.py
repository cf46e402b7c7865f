# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The joints of a plant in MuJoCo: hinges of a planar arm, balls of others, with springs and jams.

The springs of MuJoCo's ball joints are isotropic and have no preload.  So each ball has three
actuators instead, about the rows of J^-1: with the rotation vector phi of the joint, and the
velocity omega of the body in its own frame, phi' = J^-1 omega (Chirikjian, Stochastic Models,
Information Theory, and Lie Groups, volume 2, 10.86).  Their damping is a property of the model,
which MuJoCo integrates implicitly: this keeps stiff ones stable.  Infinite stiffness in the
description becomes RIGID times that of the softest bending.
"""

from math import cos, inf, pi, sin
from typing import Any

import numpy as np

from soft_continuum.mechanics.arm import Arm, Array, PAPER

RIGID = 1e6
HINGE_ARMATURE = 1e-3  # kg m^2: with less, taut tendons chatter at this time step
ARMATURE, HEAVIEST = 5e-4, 30.0
"""
Armature of each ball, kg m^2 per N m/rad; stiffness up to this many times its spring counts.
MuJoCo solves for tensions as if joints moved freely, which stiff ones do not.  Without this
armature tensions chatter.
"""


class Hinges:
    """
    Joints that turn about y, with springs of MuJoCo.

    springs: (joints, axes), N m/rad.  jams: stiffness to which jams are proportional.  actuator:
    MJCF of the actuator of a joint.  shape: of the contact geometry, by half a width and half a
    length.
    """

    actuator = ''
    shape = 'type="box" size="{0!r} {0!r} {1!r}"'

    def __init__(self, arm: Arm, stiffnesses: Array, damping_time: float) -> None:
        """Take the stiffnesses of segments about x, y and z, (segments, 3), N m^2; s."""
        self.springs = self.jams = _of_joints(arm, stiffnesses[:, 1:2])
        self._damping_time = damping_time
        self.names = [f'joint_{n}' for n in range(1, len(self.springs) + 1)]

    def element(self, joint: int) -> str:
        """Return the MJCF of a joint, 0-based."""
        return (f'<joint name="j{joint}" type="hinge" axis="0 1 0" stiffness="1" '
                f'armature="{HINGE_ARMATURE!r}"/>')

    def angles(self, data: Any) -> Array:
        """Return the rotation of every joint about its axes, (joints, axes), rad."""
        return np.array(data.qpos[:, None])

    def pull(self, model: Any, data: Any, turned: Array, jam: Array, held: Array) -> None:
        """
        Give MuJoCo the springs, and jams (joints, axes) N m/rad that hold angles in rad.

        turned: the present angles.
        """
        total = self.springs + jam
        model.jnt_stiffness[:] = total[:, 0]
        model.qpos_spring[:] = (jam * held / total)[:, 0]
        model.dof_damping[:] = self._damping_time * total[:, 0]

    def energy(self, data: Any, jam: Array, held: Array) -> float:
        """Return the energy of springs and jams outside of MuJoCo's model, J."""
        return 0.0

    def direction(self, random: np.random.Generator) -> Array:
        """Return a random rotation direction (axes,) of a joint, times up to 1."""
        return random.uniform(-1.0, 1.0, 1)


class Balls:
    """The same about every axis; angles are rotation vectors in the frame of the body below."""

    shape = 'type="cylinder" size="{!r} {!r}"'
    actuator = ''.join(
        f'<general joint="j{{0}}" gear="{int(axis == 0)} {int(axis == 1)} {int(axis == 2)}" '
        'biastype="affine"/>' for axis in range(3))

    def __init__(self, arm: Arm, stiffnesses: Array, damping_time: float) -> None:
        """Take the stiffnesses as of Hinges."""
        softest = stiffnesses[:, :2].min(axis=1, keepdims=True)
        finite = stiffnesses < inf
        self.jams = _of_joints(arm, np.where(finite, stiffnesses, 0.0))
        self.springs = _of_joints(arm, np.where(finite, stiffnesses, RIGID * softest))
        self._damping_time = damping_time
        self.names = [f'joint_{n}_{axis}' for n in range(1, len(self.springs) + 1)
                      for axis in 'xyz']

    def element(self, joint: int) -> str:
        """Return the MJCF of a joint, 0-based."""
        armature = ARMATURE * float(self.springs[joint, :2].min())
        return f'<joint name="j{joint}" type="ball" armature="{armature!r}"/>'

    def angles(self, data: Any) -> Array:
        """Return the rotation of every joint about its axes, (joints, axes), rad."""
        turns = data.qpos.reshape(-1, 4)
        sines = np.linalg.norm(turns[:, 1:], axis=1)
        angles = 2.0 * np.arctan2(sines, np.abs(turns[:, 0]))
        factors = np.where(sines > 0.0, angles / np.maximum(sines, 1e-300), 2.0)
        found: Array = (np.copysign(factors, turns[:, 0]))[:, None] * turns[:, 1:]
        return found

    def pull(self, model: Any, data: Any, turned: Array, jam: Array, held: Array) -> None:
        """Give MuJoCo the springs and jams as Hinges.pull."""
        total = self.springs + jam
        data.ctrl[:] = -(self.springs * turned + jam * (turned - held)).ravel()
        model.actuator_gear[:, :3] = _inverse_jacobians(turned).reshape(-1, 3)
        heaviest = HEAVIEST * self.springs[:, :2].min(axis=1, keepdims=True)
        armature = ARMATURE * np.minimum(total, heaviest).ravel()
        before = model.dof_armature
        data.qvel *= np.minimum(1.0, before / armature)  # no energy comes from it
        before[:] = armature
        model.actuator_biasprm[:, 2] = -self._damping_time * total.ravel()

    def energy(self, data: Any, jam: Array, held: Array) -> float:
        """Return the energy of springs and jams outside of MuJoCo's model, J."""
        turned = self.angles(data)
        return 0.5 * float((self.springs * turned**2 + jam * (turned - held)**2).sum())

    def direction(self, random: np.random.Generator) -> Array:
        """Return a random rotation direction (axes,) of a joint, times up to 1."""
        direction, size = random.uniform(0.0, 2.0 * pi), random.uniform(0.0, 1.0)
        return np.array([size * cos(direction), size * sin(direction), 0.0])


def _of_joints(arm: Arm, stiffnesses: Array) -> Array:
    """Return the stiffness of every joint, (joints, axes), N m/rad; given (segments, axes)."""
    n = arm.bodies_per_segment
    parts = np.full(n + 1, 1.0 / (n + 1)) if arm.discretisation == PAPER else np.array(
        [0.5 / n, *[1.0 / n] * (n - 1), 0.5 / n])
    lengths = np.outer([segment.length for segment in arm.segments], parts).ravel()
    found: Array = np.repeat(stiffnesses, n + 1, axis=0) / lengths[:, None]
    return found


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
