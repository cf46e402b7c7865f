# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The description files that are shipped, and checks of what is described."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco
import pytest
from scipy.spatial.transform import Rotation

from soft_continuum.parameters.files import given_parameters
from soft_continuum.parameters.overrides import full_name, Overrides
from soft_continuum.ros.description import UNCHECKED
from soft_continuum.ros.parameter_table import ALL_PARAMETERS

CONFIG = Path(__file__).resolve().parents[2] / 'config'
PLANAR, TENDON_ARM, JAMMING = (
    CONFIG / f'{name}.yaml' for name in ('manipulator', 'tendon_arm', 'spatial_jamming'))


def parsed(urdf: str) -> Any:
    """Return MuJoCo's model of a URDF, with all its links, also those without a mass."""
    keep = ('<mujoco><compiler fusestatic="false" discardvisual="false" boundmass="1e-12" '
            'boundinertia="1e-15"/></mujoco>')
    return mujoco.MjModel.from_xml_string(urdf.replace('</robot>', keep + '</robot>'))


def check_urdf(urdf: str, positions: Mapping[str, float], poses: Any) -> None:
    """Compare the links of a URDF, as an independent parser has them, with poses (2 discs, 7)."""
    model = parsed(urdf)
    assert {model.joint(n).name for n in range(model.njnt)} == positions.keys()
    data = mujoco.MjData(model)
    for name, position in positions.items():
        assert abs(position) <= model.joint(name).range[1]
        data.joint(name).qpos[0] = position
    mujoco.mj_kinematics(model, data)
    links = ['base_link', *(f'disc_{n}' for n in range(1, len(poses) // 2)), 'tip']
    for link, pose in zip(links, [*poses[::2], poses[-1]], strict=True):
        assert data.body(link).xpos == pytest.approx(pose[:3], abs=1e-9)
        assert data.body(link).xmat.reshape(3, 3) == pytest.approx(
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
