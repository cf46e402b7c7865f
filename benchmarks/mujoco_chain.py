# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The same chain in MuJoCo, which has to come to rest in time steps.

Only where it rests counts, so that inertia and damping are free: both are made proportional to
the stiffness of each joint, which gives all joints the same time constants.
"""

from dataclasses import dataclass
import time

import mujoco
import numpy as np

from benchmarks.paper import apart, Task
from benchmarks.timing import Sampler
from soft_continuum.mechanics import (
    Statics,
)
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.plane.chain import PlaneChain

REST = 3000  # steps, at most
SAMPLES = 5


@dataclass(frozen=True)
class Settings:
    """
    How MuJoCo integrates.

    time_step: s.  armature: s^2 and damping: s, times the stiffness of a joint (N m/rad).
    limit: stiffness and damping of the tendon beyond its length, over its inertia, 1/s^2 and 1/s.
    physical: real masses, with armature in kg m^2 and damping in N m s/rad for every joint alike.
    """

    integrator: str
    solver: str
    time_step: float
    armature: float
    damping: float
    limit: tuple[float, float]
    physical: bool = False


# The best of many random settings for this very arm that came to rest (130 and 3,000, in this
# order): the fewest steps to within 0.02 mm of it.  The integrator ``discrete``, new in MuJoCo
# 3.13, is implicit in the springs too.
SETTINGS = {
    'MuJoCo, real masses': Settings(
        'implicit', 'Newton', 0.01, 2e-5, 0.16, (2.8e3, 530.0), physical=True),
    'MuJoCo, free masses': Settings(
        'discrete', 'PGS', 1.0, 0.0145, 0.038, (1.2e5, 1.26e4)),
}


class MujocoArm:
    """A weightless arm, all segments soft, with the right tendon, in MuJoCo."""

    def __init__(self, statics: Statics, settings: Settings) -> None:
        """Build the model."""
        self._statics = statics
        self._model = mujoco.MjModel.from_xml_string(_xml(PlaneChain(statics.chain.arm), settings))
        self._data = mujoco.MjData(self._model)
        mujoco.mj_forward(self._model, self._data)
        self._straight = float(self._data.ten_length[0])

    def settle(self, task: Task, tolerance: float) -> tuple[int, Array, float]:
        """
        Let the arm come to rest.

        Returns the number of steps after which no calculation point is further than ``tolerance``
        (m) from where it comes to rest, the joint angles there, and the pull (m) it ends with:
        MuJoCo's limits are soft.
        """
        self._prepare(task)
        way = [self._data.qpos.copy()]
        while len(way) < REST:
            mujoco.mj_step(self._model, self._data)
            way.append(self._data.qpos.copy())
            if np.abs(way[-1] - way[-2]).max() < 1e-14:
                break
        else:
            raise RuntimeError(f'MuJoCo has not come to rest after {REST} steps')
        rest = way[-1]
        mujoco.mj_forward(self._model, self._data)
        pull = self._straight - float(self._data.ten_length[0])
        steps = len(way) - 1
        while steps > 0 and apart(self._statics, way[steps - 1], rest) <= tolerance:
            steps -= 1
        return steps, rest, pull

    def sampler(self, task: Task, steps: int) -> Sampler:
        """Return a sampler of so many steps; setting the start is not counted."""
        def run() -> float:
            total = 0.0
            for _ in range(SAMPLES):
                self._prepare(task)
                begin = time.thread_time()
                mujoco.mj_step(self._model, self._data, steps)
                total += time.thread_time() - begin
            return total / SAMPLES

        return run

    def _prepare(self, task: Task) -> None:
        mujoco.mj_resetData(self._model, self._data)
        self._data.qpos[:] = task.start.joint_angles
        self._model.tendon_range[0] = 0.0, self._straight - task.pull


def _xml(chain: PlaneChain, settings: Settings) -> str:
    arm = chain.arm
    n = arm.bodies_per_segment
    lines = [_site('0', chain.guides[0, 0], arm.discs[0].height)]
    guides = ['0']
    below = arm.discs[0].height
    for joint, stiffness in enumerate(chain.joint_stiffness.tolist()):
        segment, body = divmod(joint, n + 1)
        scale, mass, inertia = (1.0, float(chain.body_masses[joint]), 1e-6) if (
            settings.physical) else (stiffness, 1e-6, 1e-9)
        length = float(chain.body_lengths[joint])
        lines.append(
            f'<body pos="0 0 {below!r}"><joint type="hinge" axis="0 1 0" '
            f'stiffness="{stiffness!r}" damping="{settings.damping * scale!r}" '
            f'armature="{settings.armature * scale!r}"/><inertial pos="0 0 {length / 2!r}" '
            f'mass="{mass!r}" diaginertia="{inertia!r} {inertia!r} {inertia!r}"/>')
        below = length
        if body == n:
            lines.append(_site(f'{segment}u', chain.guides[segment, 1], 0.0))
            guides.append(f'{segment}u')
            if segment + 1 < chain.segments:
                lines.append(_site(f'{segment}l', chain.guides[segment + 1, 0], below))
                guides.append(f'{segment}l')
    stiff, damp = settings.limit
    return (
        '<mujoco><compiler angle="radian" autolimits="false"/>'
        f'<option timestep="{settings.time_step!r}" integrator="{settings.integrator}" '
        f'solver="{settings.solver}" iterations="20" tolerance="1e-14" jacobian="dense">'
        '<flag contact="disable" gravity="disable"/></option><worldbody>'
        + ''.join(lines) + '</body>' * chain.bodies + '</worldbody><tendon>'
        f'<spatial limited="true" range="0 1" solreflimit="{-stiff!r} {-damp!r}" '
        'solimplimit="0.9999 0.9999 0.001 0.5 1">'
        + ''.join(f'<site site="{name}"/>' for name in guides)
        + '</spatial></tendon></mujoco>')


def _site(name: str, x: float, z: float) -> str:
    return f'<site name="{name}" pos="{float(x)!r} 0 {z!r}"/>'
