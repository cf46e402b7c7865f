# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Distances between arms and obstacles, against the arm as a dense cloud of points."""

from math import inf, pi
from pathlib import Path

import numpy as np
import pytest

from soft_continuum.mechanics.either import chain_of
from soft_continuum.obstacles import (
    Box,
    Capsule,
    Clearance,
    Cylinder,
    Obstacle,
    ObstacleError,
    Sphere,
    Surroundings,
    turned_by,
)
from soft_continuum.parameters.files import load_any_arm

CONFIG = Path(__file__).parents[2] / 'config'
FILES = 'manipulator', 'tendon_arm', 'spatial_jamming'
GRID = 0.0017  # m: half the distance between two points of the cloud, and what mitres add


@pytest.fixture(scope='module', params=FILES)
def chain(request):
    return chain_of(load_any_arm(CONFIG / f'{request.param}.yaml'))


def bent(chain, random):
    """Return a state whose joints all bend at random, up to the limits of the segments."""
    even = random.uniform(-0.07, 0.07, chain.coordinate_count // chain.joints_per_segment)
    joints = np.repeat(even, chain.joints_per_segment)
    return chain.state_of(
        joints + random.uniform(-0.02, 0.02, chain.coordinate_count),
        np.zeros(chain.coordinate_count), (False,) * chain.segments)


def cloud(chain, state):
    """Return points on the surface of discs and swept segments, by circles that turn along it."""
    turns = np.linspace(0.0, 2 * pi, 60, endpoint=False)
    circle = np.stack([np.cos(turns), np.sin(turns), 0 * turns], axis=1)
    rotations = np.concatenate([np.eye(3)[None], state.rotations])
    ends, n = state.backbone, chain.joints_per_segment
    points = []
    for s, segment in enumerate(chain.arm.segments):
        for j in range(s * n, s * n + n):
            is_disc = j == s * n + n - 1
            radius = segment.outer_diameter / 2
            start = ends[j]
            if is_disc:  # all radii: its faces
                around = [chain.arm.segments[min(s + 1, chain.segments - 1)].outer_diameter / 2]
                rims = np.linspace(0.0, max(radius, *around), 15)[1:]
            else:  # in the joint below, the circle turns from one body to the next
                for part in np.linspace(0.0, 1.0, 5):
                    mixed = (1 - part) * rotations[j] + part * rotations[j + 1]
                    u, _, v = np.linalg.svd(mixed)
                    points.append(start + radius * circle @ (u @ v).T)
                rims = [radius]
            length = np.linalg.norm(ends[j + 1] - start)
            for height in np.linspace(0.0, length, 15 if is_disc else 5):
                faces = rims if is_disc and height in (0.0, length) else rims[-1:]
                for rim in faces:
                    points.append(start + (circle * rim + [0.0, 0.0, height])
                                  @ rotations[j + 1].T)
    for guides in state.tendon_points:
        for one, other in zip(guides, guides[1:], strict=False):
            points.append(one + np.linspace(0.0, 1.0, 30)[:, None] * (other - one))
    return np.concatenate(points)


def to_sphere(local, shape):
    return np.linalg.norm(local, axis=1) - shape.radius


def to_box(local, shape):
    beyond = np.abs(local) - np.array(shape.size) / 2
    return np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)


def to_cylinder(local, shape):
    beyond = np.stack([np.hypot(local[:, 0], local[:, 1]) - shape.radius,
                       np.abs(local[:, 2]) - shape.length / 2], axis=1)
    return np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)


def to_capsule(local, shape):
    along = np.clip(local[:, 2], -shape.length / 2, shape.length / 2)
    return np.linalg.norm(local - along[:, None] * [0.0, 0.0, 1.0], axis=1) - shape.radius


SHAPES = [(Sphere(0.03), to_sphere), (Box((0.06, 0.3, 0.02)), to_box),
          (Cylinder(0.02, 0.1), to_cylinder), (Capsule(0.01, 0.2), to_capsule)]


@pytest.mark.parametrize(('shape', 'formula'), SHAPES)
def test_the_distance_is_that_of_a_dense_cloud_of_points_and_never_larger(chain, shape, formula):
    random = np.random.default_rng(7)
    compared = 0
    for _ in range(12):
        state = bent(chain, random)
        points = cloud(chain, state)
        place = state.backbone[-12] + random.normal(size=3) * 0.06
        if place[2] < 0.08:
            continue
        obstacle = Obstacle('it', shape, tuple(place), turned_by(*random.uniform(-3.0, 3.0, 3)))
        local = (points - place) @ obstacle.rotation
        true = formula(local, shape).min()
        try:
            found = Surroundings(chain.arm, [obstacle]).clearance(state)
        except ObstacleError:  # it is in the base
            continue
        compared += 1
        assert found.obstacle == 'it'
        if true > GRID:
            assert found.distance <= true
            assert found.distance >= true - GRID
        else:
            assert found.distance <= GRID
    assert compared > 5


def test_the_nearest_of_many_obstacles_is_the_nearest_of_each_alone(chain):
    random = np.random.default_rng(3)
    several = [Obstacle(f'{k}', shape, tuple(random.uniform(0.1, 0.3, 3)),
                        turned_by(*random.uniform(-3.0, 3.0, 3)))
               for k, (shape, _) in enumerate(SHAPES)]
    together = Surroundings(chain.arm, several)
    alone = [Surroundings(chain.arm, [one]) for one in several]
    states = [bent(chain, random) for _ in range(10)]
    for state, found in zip(states, together.clearances(states), strict=True):
        best = min((one.clearance(state) for one in alone), key=lambda c: c.distance)
        assert found == best


def test_without_obstacles_the_distance_is_infinite(chain):
    assert Surroundings(chain.arm).clearance(chain.straight()) == Clearance(inf, '')
