# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The arm as a URDF robot: every body and joint of the rigid chain, with masses, discs and skins.

Frames: ``base_link`` at the bottom centre of the base disc, z along the straight arm; of every
body ``segment_S_body_J`` at the joint below it, z along the body; ``disc_S`` for the disc above
segment S, whose origin is the distal end of that segment; ``tip`` at the top of the last disc.
Joints are called as joint_states calls them and turn about +y; in a spatial arm each is three, one
after another about x, y and z, whose names end so.  Where the base frame is called
``left/base_link``, every frame begins with ``left/``: two arms then share one TF tree.
"""

from collections.abc import Sequence
from math import pi
import re
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from numpy.typing import NDArray

from soft_continuum.mechanics.arm import Arm, PLANAR_AXES, SPATIAL_AXES
from soft_continuum.mechanics.chain import Chain

MATERIALS = {'disc': '0.75 0.78 0.82 1', 'skin': '0.35 0.30 0.25 1'}
AXES = {'x': '1 0 0', 'y': '0 1 0', 'z': '0 0 1'}
ROBOT_DESCRIPTION, MAX_BYTES = 'robot_description', 10**7
"""The topic with the URDF of the arm, and what subscribers accept."""
SKIN = 0.9  # of the outer diameter, so that discs stand out
EFFORT, SPEED = 1e3, 1e2  # N m, rad/s: URDF asks for limits; nothing drives these joints


def joint_names(chain: Chain) -> list[str]:
    """Return the names of all joints, base first, as joint_states and the URDF have them."""
    return [name for s in range(1, chain.segments + 1)
            for j in range(1, chain.joints_per_segment + 1)
            for name in _names_of_axes(f'segment_{s}_joint_{j}', chain.joint_axes)]


def _names_of_axes(joint: str, axes: Sequence[str]) -> list[str]:
    return [joint] if len(axes) == 1 else [f'{joint}_{axis}' for axis in axes]


def are_of_an_arm(joints: Sequence[str]) -> bool:
    """Return whether joints with these names are those of an arm, base first."""
    return joints[:1] in (['segment_1_joint_1'], ['segment_1_joint_1_x'])


def pose_axes_of(joints: Sequence[str]) -> NDArray[np.bool_]:
    """Return pose_axes of the arm whose joints have these names; of none: of a planar arm."""
    return SPATIAL_AXES if any(name.endswith('_x') for name in joints[:1]) else PLANAR_AXES


def first_joint(urdf: str) -> list[str]:
    """Return the name of the first joint of the arm in a robot_description; none without one."""
    return re.findall(r'<joint name="(?:[^"]*/)?(segment_1_joint_1(?:_x)?)"', urdf)[:1]


def arm_urdf(arm: Arm, base_frame: str = 'base_link') -> str:
    """Return ``arm`` as URDF in SI units; ``base_frame``: the name of its root link."""
    prefix = base_frame[:base_frame.rfind('/') + 1]
    robot = Element('robot', name='soft_continuum')
    for name, colour in MATERIALS.items():
        SubElement(SubElement(robot, 'material', name=name), 'color', rgba=colour)
    diameters = [arm.segments[0].outer_diameter, *(s.outer_diameter for s in arm.segments)]
    _link(robot, base_frame, arm.discs[0].height, diameters[0] / 2, arm.discs[0].mass, 'disc')
    below, length, n = base_frame, arm.discs[0].height, arm.bodies_per_segment
    axes = Chain(arm).joint_axes
    for s in range(1, len(arm.segments) + 1):
        segment = arm.segments[s - 1]
        for j in range(1, n + 2):
            is_disc = j == n + 1
            name = prefix + (f'disc_{s}' if is_disc else f'segment_{s}_body_{j}')
            joints = _names_of_axes(f'segment_{s}_joint_{j}', axes)
            between = [prefix + joint for joint in joints[:-1]]  # links without extent and mass
            for link in between:
                SubElement(robot, 'link', name=link)
            for axis, joint, link in zip(axes, joints, [*between, name], strict=True):
                _revolute(robot, joint, AXES[axis], below, link, length,
                          segment.bending_angle_limit)
                below, length = link, 0.0
            if is_disc:
                disc = arm.discs[s]
                below, length = name, disc.height
                _link(robot, name, length, diameters[s] / 2, disc.mass, 'disc')
            else:
                below, length = name, segment.length / n
                _link(robot, name, length, SKIN * diameters[s] / 2, segment.mass / n, 'skin')
    tip = SubElement(robot, 'link', name=f'{prefix}tip')
    if arm.payload > 0.0:
        _inertial(tip, 0.0, arm.payload, (0.0, 0.0))
    fixed = SubElement(robot, 'joint', name='tip_joint', type='fixed')
    _connect(fixed, below, f'{prefix}tip', length)
    ElementTree.indent(robot)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(robot, encoding='unicode') + '\n'


def _link(robot: Element, name: str, length: float, radius: float, mass: float,
          material: str) -> None:
    """Add a solid cylinder from the link's origin upwards."""
    link = SubElement(robot, 'link', name=name)
    if mass > 0.0:
        across = mass * (3 * radius**2 + length**2) / 12
        _inertial(link, length / 2, mass, (across, mass * radius**2 / 2))
    visual = SubElement(link, 'visual')
    SubElement(visual, 'origin', xyz=f'0 0 {length / 2!r}', rpy='0 0 0')
    SubElement(SubElement(visual, 'geometry'), 'cylinder', radius=repr(radius),
               length=repr(length))
    SubElement(visual, 'material', name=material)


def _inertial(link: Element, height: float, mass: float, moments: tuple[float, float]) -> None:
    inertial = SubElement(link, 'inertial')
    SubElement(inertial, 'origin', xyz=f'0 0 {height!r}', rpy='0 0 0')
    SubElement(inertial, 'mass', value=repr(mass))
    across, along = (repr(moment) for moment in moments)
    SubElement(inertial, 'inertia', ixx=across, iyy=across, izz=along, ixy='0', ixz='0', iyz='0')


def _revolute(robot: Element, name: str, axis: str, parent: str, child: str, height: float,
              limit: float) -> None:
    joint = SubElement(robot, 'joint', name=name, type='revolute')
    _connect(joint, parent, child, height)
    SubElement(joint, 'axis', xyz=axis)
    most = repr(min(limit, pi))  # of one joint: no more than of the whole segment
    SubElement(joint, 'limit', lower=f'-{most}', upper=most, effort=repr(EFFORT),
               velocity=repr(SPEED))


def _connect(joint: Element, parent: str, child: str, height: float) -> None:
    SubElement(joint, 'parent', link=parent)
    SubElement(joint, 'child', link=child)
    SubElement(joint, 'origin', xyz=f'0 0 {height!r}', rpy='0 0 0')
