# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Elements of MJCF, the format of MuJoCo's models, for plants; SI units."""

from collections.abc import Iterable, Sequence

from soft_continuum.sim.twin.model_errors import CylinderObstacle

# MuJoCo lets a taut tendon be some tenths of a mm too long: it is tightened until it is not.
LIMIT = 'solreflimit="0.01 1" solimplimit="0.9 0.95 0.001 0.5 1"'
CONTACT = 'condim="1" solref="0.01 1" solimp="0.99 0.999 0.001 0.5 1"'
ARM = 'contype="1" conaffinity="0"'
"""Contact with obstacles, without self-contact."""


def opened(name: str, below: float, joint: str, length: float, mass: float) -> str:
    """Return a body on the previous one, without closing tag; below: length of that one."""
    inertia = max(mass * length**2 / 12.0, 1e-8)
    return (f'<body name="{name}" pos="0 0 {below!r}">{joint}'
            f'<inertial pos="0 0 {length / 2.0!r}" mass="{max(mass, 1e-6)!r}" '
            f'diaginertia="{inertia!r} {inertia!r} {inertia!r}"/>')


def payload(below: float, mass: float) -> str:
    """Return a point mass on top of the body before; empty for zero mass."""
    return (f'<body pos="0 0 {below!r}"><inertial pos="0 0 0" mass="{mass!r}" '
            'diaginertia="1e-8 1e-8 1e-8"/></body>') if mass else ''


def site(name: str, x: float, y: float, z: float) -> str:
    """Return a guide."""
    return f'<site name="{name}" pos="{x!r} {y!r} {z!r}"/>'


def tendon(sites: Iterable[str], longest: float = 0.0) -> str:
    """Return a tendon through sites; longest: m, 0: only measure its length."""
    limit = f' limited="true" range="0 {longest!r}" {LIMIT}' if longest else ''
    return f'<spatial{limit}>' + ''.join(f'<site site="{name}"/>' for name in sites) + '</spatial>'


def cylinders(obstacles: Sequence[CylinderObstacle], half: float) -> str:
    """Return obstacles that reach from -half to half along y."""
    return ''.join(
        f'<geom name="obstacle {number}" type="capsule" size="{one.radius!r}" fromto="'
        f'{one.x!r} {-half!r} {one.z!r} {one.x!r} {half!r} {one.z!r}" '
        f'contype="0" conaffinity="1" {CONTACT}/>'
        for number, one in enumerate(obstacles, start=1))


def document(gravity: Sequence[float], time_step: float, world: str, tendons: str,
             actuators: str = '') -> str:
    """Return a whole model."""
    return ('<mujoco><compiler angle="radian" autolimits="false"/>'
            f'<option timestep="{time_step!r}" integrator="implicitfast" '
            f'gravity="{" ".join(map(repr, gravity))}"/>'
            f'<worldbody>{world}</worldbody><tendon>{tendons}</tendon>'
            f'<actuator>{actuators}</actuator></mujoco>')
