# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Drawn pictures of arms with their tags, and where their discs are in them."""

from dataclasses import replace

import numpy as np

from soft_continuum.estimation.sensing.layout import FRONT, layout_of
from soft_continuum.mechanics import Chain
from soft_continuum.mechanics.rotations import displacement
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.ros.description import load_description
from soft_continuum.sim.twin.camera import TwinCamera
from soft_continuum.sim.twin.model_errors import read_model_errors
from soft_continuum.user_files import description_file

EXACT = {'tag_offset': 0.0, 'fixed_offset': 0.0, 'depth_offset': 0.0}


class Views:
    """Pictures of one arm."""

    def __init__(self, name):
        self.PATH = description_file().with_name(name)
        self.VALUES = load_description(self.PATH, node='camera')
        self.ARM = arm_from_parameters(self.VALUES)
        self.CHAIN = Chain(self.ARM)

    def layout(self, **changes):
        """Return the tags of the arm with other parameters tags.*."""
        return layout_of(self.VALUES | {f'tags.{k}': v for k, v in changes.items()})

    def camera(self, preset='ideal', tags=None, direction=FRONT, **changes):
        """Return a drawn camera; changes: of the preset of the twin."""
        given = read_model_errors(description_file().with_name('twin.yaml'), preset)
        return TwinCamera(tags or self.layout(), replace(given, **changes), direction)

    def poses(self, *bending):
        """Return the pose (7,) of every disc of an arm that bends in circles."""
        return self.CHAIN.uniform(bending).poses[::2]

    def random_poses(self, random):
        """Return the poses of an arm with random bending."""
        return self.poses(*random.uniform(-0.6, 0.6, (3, 2)) * self.ARM.bending_axes)


views, space_views = Views(description_file().name), Views('spatial_jamming.yaml')


def errors(sight, truth):
    """Return the errors of all discs that are seen, (discs, 6), m and rad."""
    return np.array([displacement(found.pose, truth[n]) for n, found in sight.discs.items()]
                    ).reshape(-1, 6)


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
