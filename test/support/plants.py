# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Plants of the paper's arm, and time that passes for them."""

from dataclasses import replace

import numpy as np

from soft_continuum.mechanics.rotations import planar_pose
from soft_continuum.ros.description import load_arm
from soft_continuum.sim.twin.model_errors import read_model_errors
from soft_continuum.sim.twin.plant import Plant, TIME_STEP
from soft_continuum.user_files import description_file

ARM = load_arm(description_file())
IDEAL = read_model_errors(description_file().with_name('twin.yaml'), 'ideal')
STIFF, SOFT = np.ones(3), np.zeros(3)
FREE = np.full(2, -0.05)  # m: both tendons paid out


def plant(arm=ARM, **changes):
    """Return an ideal plant with other values of its preset."""
    return Plant(arm, replace(IDEAL, **changes))


def points_of(found):
    """Return bottom and top centre of every disc of a plant: x, z (m) and angle (rad)."""
    return np.array([planar_pose(pose) for pose in found.poses])


def run(found, begin, end, vacuum, seconds):
    """Let time pass, while the motors go from ``begin`` to ``end`` in the first half of it."""
    steps = round(seconds / TIME_STEP)
    for i in range(steps):
        found.step(begin + min(1.0, 2.0 * (i + 1) / steps) * (end - begin), vacuum)
    return end


def only(segment):
    """Return the vacuum of an arm of which one segment is soft."""
    return np.array([float(s != segment) for s in range(3)])
