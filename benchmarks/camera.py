# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""How well and how fast discs are measured in drawn pictures, of which the truth is known."""

from dataclasses import replace
import time

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.tables import machine, number, Section, table
from benchmarks.timing import progress
from soft_continuum.estimation.sensing.corners import TagDetector
from soft_continuum.estimation.sensing.layout import TagLayout
from soft_continuum.estimation.sensing.tag_camera import TagCamera
from soft_continuum.mechanics.arm import PLANAR_AXES
from soft_continuum.mechanics.plane.chain import PlaneChain
from soft_continuum.mechanics.rotations import full_poses, planar_pose
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.ros.description import load_description
from soft_continuum.sim.twin.camera import TwinCamera
from soft_continuum.sim.twin.model_errors import ModelErrors, PRESETS, read_model_errors
from soft_continuum.user_files import description_file

IN_PLANE = np.ix_(PLANAR_AXES, PLANAR_AXES)  # of a covariance (6, 6)
CAMERAS, PICTURES = 50, 6  # each camera has other tags, another place and another calibration
ANGLE = 0.6  # rad, largest bending angle of a segment
INSIDE = 7.815  # chi squared of three that 95 % are below
CLUTTER = 10_000
SMALL = 320, 240  # px
HEAD = ('preset', 'discs seen', 'error of the position, mm: RMS', '95 %',
        'of the angle, degrees: RMS', 'inside the 95 % ellipsoid', 'ms per image')


def run(quick: bool) -> Section:
    """Measure; the section is of the page about estimation."""
    cv2.setNumThreads(1)
    random = np.random.default_rng(1)
    values = load_description(description_file(), node='camera')
    arm = arm_from_parameters(values)
    chain = PlaneChain(arm)
    layout = TagLayout.of(values, arm)
    rows = []
    for preset in PRESETS:
        given = read_model_errors(description_file().with_name('twin.yaml'), preset)
        count = 2 if quick else CAMERAS
        measured = [_measure(chain, layout, replace(given, seed=seed), random)
                    for seed in range(count)]
        errors, inside = (np.concatenate([m[k] for m in measured]) for k in range(2))
        distance = np.linalg.norm(errors[:, :2], axis=1) * 1e3
        rows.append((
            f'`{preset}`', f'{len(errors)} of {count * PICTURES * len(arm.discs)}',
            number(_rms(distance)), number(float(np.quantile(distance, 0.95))),
            number(np.degrees(_rms(errors[:, 2]))), f'{np.mean(inside):.1%}',
            number(float(np.median([m[2] for m in measured])) * 1e3)))
        progress(f'camera: {preset} done')
    found = _false_detections(layout, random, 20 if quick else CLUTTER)
    body = '\n\n'.join([
        f'Simulated: {CAMERAS} cameras, {PICTURES} images of 1280 x 960 each, on one core. '
        + machine(), table(HEAD, rows),
        f'Tags found in {20 if quick else CLUTTER} images of random black and white cells: '
        f'{found}.'])
    return Section('benchmarks/estimation.md', 'camera', body)


def _measure(chain: PlaneChain, layout: TagLayout, given: ModelErrors,
             random: np.random.Generator) -> tuple[NDArray[np.float64], ...]:
    """Return errors (k, 3), which are inside, and s."""
    drawn = TwinCamera(layout, given)
    camera = TagCamera(layout, drawn.lens)
    errors, inside, times = [], [], []
    for _ in range(PICTURES):
        state = chain.uniform(random.uniform(-ANGLE, ANGLE, chain.segments))
        discs = chain.plane_points(state.configuration)[::2]
        picture = drawn.picture(full_poses(discs))
        begin = time.perf_counter()
        sight = camera.measure(picture)
        times.append(time.perf_counter() - begin)
        for n, disc in sight.discs.items():
            pose, covariance = planar_pose(disc.pose), disc.covariance[IN_PLANE]
            error = pose - discs[n]
            errors.append(error)
            inside.append(error @ np.linalg.solve(covariance, error) < INSIDE)
    return np.reshape(errors, (-1, 3)), np.array(inside), np.array(np.median(times))


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _false_detections(layout: TagLayout, random: np.random.Generator, count: int) -> int:
    """Return how many tags are seen where there is none."""
    lens = TwinCamera(layout, read_model_errors(
        description_file().with_name('twin.yaml'), 'ideal')).lens
    small = replace(lens, size=SMALL)
    detector, found = TagDetector(small, layout.fixed_numbers), 0
    for _ in range(count):
        size = int(random.integers(4, 25))
        cells = random.integers(
            0, 2, (SMALL[1] // size + 1, SMALL[0] // size + 1), dtype=np.uint8) * 255
        clutter = np.kron(cells, np.ones((size, size), dtype=np.uint8))[:SMALL[1], :SMALL[0]]
        found += len(detector.numbers(np.ascontiguousarray(clutter)))
    return found
