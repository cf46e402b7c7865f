# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Drawn pictures of the paper's arm with its tags, and where its discs are in them."""

from dataclasses import replace

import numpy as np

from soft_continuum.mechanics import Chain
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.files import load_description
from soft_continuum.sensing.layout import TagLayout
from soft_continuum.sensing.rigid import planar_pose
from soft_continuum.twin.camera import TwinCamera
from soft_continuum.twin.model_errors import read_model_errors
from soft_continuum.user_files import description_file
from support.paper_arm import plane_points

VALUES = load_description(description_file(), node='camera')
ARM = arm_from_parameters(VALUES)
CHAIN = Chain(ARM)


def layout(**changes):
    """Return the tags of the paper's arm with other parameters tags.*."""
    return TagLayout.of(VALUES | {f'tags.{k}': v for k, v in changes.items()}, ARM)


def differences(preset, **changes):
    """Return a preset of the twin with other values."""
    path = description_file().with_name('twin.yaml')
    return replace(read_model_errors(path, preset), **changes)


def camera(preset='ideal', tags=None, **changes):
    """Return a drawn camera."""
    return TwinCamera(tags or layout(), differences(preset, **changes))


def discs(*bending_angles):
    """Return x, z and angle of the bottom of every disc of an arm bent in circles."""
    return plane_points(CHAIN.uniform(bending_angles))[::2]


def poses(*bending_angles):
    """Return the pose (7,) of the bottom of every disc of an arm bent in circles."""
    return CHAIN.uniform(bending_angles).poses[::2]


def random_discs(random):
    """Return the discs of an arm with random bending angles."""
    return discs(*random.uniform(-0.6, 0.6, len(ARM.segments)))


def errors(sight, truth):
    """Return the errors of all discs that are seen, (discs, 3), m and rad."""
    return np.array([planar_pose(found.pose) - truth[n] for n, found in sight.discs.items()]
                    ).reshape(-1, 3)


def without_pose(sight, *words):
    """Assert that no disc is measured, and that one problem says why."""
    assert not sight.discs
    assert len(sight.problems) == 1
    for word in words:
        assert word in sight.problems[0]


def covered(drawn, picture, points, half=45):
    """Return a picture with grey squares over points (k, 3)."""
    hidden = picture.copy()
    for u, v in drawn.project(points).astype(int):
        hidden[max(0, v - half):v + half, max(0, u - half):u + half] = 90
    return hidden
