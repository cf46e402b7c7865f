# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Drawn pictures of a spatial arm with its rings of tags, and where its discs are in them."""

import numpy as np
from scipy.spatial.transform import Rotation

from soft_continuum.mechanics.space.chain import SpaceChain
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.files import load_description
from soft_continuum.sensing.layout import FRONT, RingLayout
from soft_continuum.twin.camera import TwinCamera
from soft_continuum.user_files import description_file
from support import views

PATH = description_file().with_name('spatial_jamming.yaml')
VALUES = load_description(PATH, node='camera')
ARM = arm_from_parameters(VALUES)
CHAIN = SpaceChain(ARM)
EXACT = {'tag_offset': 0.0, 'fixed_offset': 0.0, 'calibration_error': 0.0}


def layout(**changes):
    """Return the tags of the arm with other parameters tags.*."""
    return RingLayout.of(VALUES | {f'tags.{k}': v for k, v in changes.items()}, ARM)


def camera(preset='ideal', tags=None, direction=FRONT, **changes):
    """Return a drawn camera."""
    return TwinCamera(tags or layout(), views.differences(preset, **changes), direction)


def discs(*bending):
    """Return the pose (7,) of every disc of an arm that bends about x and y, in circles."""
    return CHAIN.uniform(bending).poses[::2]


poses = discs


def random_discs(random):
    """Return the discs of an arm with random bending."""
    return discs(*random.uniform(-0.6, 0.6, (CHAIN.segments, 2)))


def error(pose, truth):
    """Return by how much a pose is off, (6,): m, and a rotation vector along the fixed axes."""
    turn = Rotation.from_quat(pose[3:]) * Rotation.from_quat(truth[3:]).inv()
    return np.concatenate([pose[:3] - truth[:3], turn.as_rotvec()])


def errors(sight, truth):
    """Return the errors of all discs that are seen, (discs, 6)."""
    return np.array([error(found.pose, truth[n]) for n, found in sight.discs.items()]
                    ).reshape(-1, 6)
