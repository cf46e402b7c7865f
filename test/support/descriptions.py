# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The description files that are shipped, and checks of what is described."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from soft_continuum.nodes.parameter_table import ALL_PARAMETERS
from soft_continuum.parameters.files import given_parameters, UNCHECKED
from soft_continuum.parameters.overrides import full_name, Overrides

CONFIG = Path(__file__).resolve().parents[2] / 'config'
PLANAR, TENDON_ARM, JAMMING = (
    CONFIG / f'{name}.yaml' for name in ('manipulator', 'tendon_arm', 'spatial_jamming'))


def forward_kinematics(text, positions):
    """Return the pose (4, 4) of every link of a URDF, in which each joint turns about its axis."""
    frames, robot = {}, ElementTree.fromstring(text)
    joints = robot.findall('joint')
    root = ({link.get('name') for link in robot.findall('link')}
            - {joint.find('child').get('link') for joint in joints}).pop()
    frames[root] = np.eye(4)
    while joints:
        joint = next(j for j in joints if j.find('parent').get('link') in frames)
        joints.remove(joint)
        step = np.eye(4)
        step[:3, 3] = [float(x) for x in joint.find('origin').get('xyz').split()]
        assert joint.find('origin').get('rpy') == '0 0 0'
        if joint.get('type') == 'revolute':
            axis = np.array([float(x) for x in joint.find('axis').get('xyz').split()])
            angle = positions[joint.get('name')]
            assert abs(angle) <= float(joint.find('limit').get('upper'))
            step[:3, :3] = Rotation.from_rotvec(angle * axis).as_matrix()
        frames[joint.find('child').get('link')] = frames[joint.find('parent').get('link')] @ step
    return frames


def check_urdf(text, positions, poses):
    """Compare the links of a URDF with poses (2 * discs, 7)."""
    frames = forward_kinematics(text, positions)
    links = ['base_link', *(f'disc_{n}' for n in range(1, len(poses) // 2))]
    for link, pose in zip([*links, 'tip'], [*poses[::2], poses[-1]], strict=True):
        assert frames[link][:3, 3] == pytest.approx(pose[:3], abs=1e-9)
        assert frames[link][:3, :3] == pytest.approx(
            Rotation.from_quat(pose[3:]).as_matrix(), abs=1e-9)


def section(name: str, *lines: str) -> str:
    """Return a section of a parameter file."""
    return f'{name}:\n  ros__parameters:\n' + ''.join(f'    {line}\n' for line in lines)


def given_in(path: Path, node: str = '') -> dict[str, Any]:
    """Return what a description gives a node, or all of them, by dotted names."""
    return given_parameters(Overrides(path), ALL_PARAMETERS, full_name(node), UNCHECKED)


def given(path: Path, **changes: Any) -> Mapping[str, Any]:
    """Return what a description gives, and changes, as Rig.start takes them."""
    return {name.replace('.', '__'): value for name, value in given_in(path).items()} | changes
