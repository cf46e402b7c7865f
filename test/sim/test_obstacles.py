# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The arm touches obstacles and not itself, and no contact gives it energy."""

from dataclasses import replace

import numpy as np
import pytest

from soft_continuum.mechanics.arm import mounted
from soft_continuum.sim.twin.model_errors import CylinderObstacle, TwinError
from support.plants import ARM, FREE, only, plant, points_of, run, SOFT

PULLS = np.array([0.016, -0.05])  # m: 30 degrees and more to the right
MIRROR = np.array([-1.0, 1.0, -1.0])  # of x, z and angle
INSIDE = 2e-4  # m by which a contact may give


def clearance(found, obstacle):
    """How far the axis of an obstacle is from the surface of the arm, m; negative: inside."""
    distances, (x, z, angle) = [], points_of(found)[1]
    middle = np.array([obstacle.x, obstacle.z])
    arm, joints = found.arm, iter(found.joint_angles)
    for segment, disc in zip(arm.segments, arm.discs[1:], strict=True):
        n = arm.bodies_per_segment
        for length in [segment.length / n] * n + [disc.height]:
            angle += next(joints)
            along = np.array([np.sin(angle), np.cos(angle)])
            across = np.array([along[1], -along[0]])
            away = middle - [x, z] - length / 2.0 * along
            out = np.abs([away @ across, away @ along]) - [segment.outer_diameter / 2.0,
                                                           length / 2.0]
            distances.append(np.hypot(*np.maximum(out, 0.0)) + min(0.0, out.max()))
            x, z = np.array([x, z]) + length * along
    return min(distances)


@pytest.mark.parametrize(('x', 'z', 'radius'), [(0.08, 0.2, 0.02), (0.06, 0.1, 0.01)])
def test_an_arm_that_is_bent_into_an_obstacle_rests_against_it(x, z, radius):
    shapes = []
    for side, is_there in ((1, False), (1, True), (-1, True)):
        obstacle = CylinderObstacle(side * x, z, radius)
        found = plant(ARM.without_gravity(), obstacles=(obstacle,) * is_there)
        run(found, np.zeros(2), np.zeros(2), only(0), 0.5)
        run(found, np.zeros(2), PULLS[::side], only(0), 3.0)
        assert found.speed < 1e-6
        left = clearance(found, obstacle) - radius
        if is_there:
            assert left == pytest.approx(-INSIDE / 2.0, abs=INSIDE / 2.0)
        else:
            assert left < -0.005  # it is where the obstacle would be
        shapes.append(points_of(found))
    assert shapes[2] == pytest.approx(shapes[1] * MIRROR, abs=1e-5)


def test_an_obstacle_gives_no_energy():
    obstacle = CylinderObstacle(0.09, 0.3, 0.03)
    found = plant(replace(ARM, gravity=mounted(2.0)), obstacles=(obstacle,))
    pulls = run(found, np.zeros(2), np.zeros(2), only(2), 0.5)
    run(found, pulls, np.array([-0.05, 0.015]), only(2), 1.0)
    energies, touched = [], False
    for i in range(1500):
        found.step(FREE, SOFT)
        energies.append(found.energy)
        if i % 10 == 0:
            touched = touched or clearance(found, obstacle) < obstacle.radius
    assert touched
    assert max(np.diff(energies[1:])) < 1e-4 * np.ptp(energies)
    assert energies[-1] < energies[1] - 1e-3


def test_the_arm_does_not_touch_itself():
    angles = []
    for obstacles in ((), (CylinderObstacle(5.0, 5.0, 0.1),)):
        found = plant(obstacles=obstacles)
        run(found, np.zeros(2), np.array([0.05, -0.05]), SOFT, 0.5)
        angles.append(found.joint_angles)
    assert np.abs(angles[0]).max() > 0.05
    assert np.array_equal(*angles)


def test_an_obstacle_in_the_straight_arm_is_refused():
    with pytest.raises(TwinError, match='obstacle 2 overlaps the straight arm'):
        plant(obstacles=(CylinderObstacle(0.1, 0.2, 0.02), CylinderObstacle(-0.03, 0.2, 0.02)))
