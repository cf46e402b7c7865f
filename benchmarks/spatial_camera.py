# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""How well discs in space are measured in drawn pictures, by one camera and by two."""

from dataclasses import replace
from math import pi

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.tables import machine, number, Section, table
from benchmarks.timing import progress
from soft_continuum.estimation.sensing.layout import FRONT, RingLayout
from soft_continuum.estimation.sensing.tag_camera import DiscPose, TagCamera
from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.space.chain import SpaceChain
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.ros.description import load_description
from soft_continuum.sim.twin.camera import TwinCamera
from soft_continuum.sim.twin.model_errors import ModelErrors, PRESETS, read_model_errors
from soft_continuum.user_files import description_file

ARM = 'spatial_jamming.yaml'
RIGS, PICTURES = 50, 6  # each rig has other tags, and its cameras another place and calibration
DIRECTIONS = (FRONT, FRONT - pi / 3)  # from where they look
ANGLE = 0.6  # rad, largest bending angle of a segment
INSIDE = 12.592  # chi squared of six that 95 % are below
HEAD = ('preset, cameras', 'discs seen', 'error of the position, mm: median', '95 %',
        'of the orientation, mrad: median', '95 %', 'inside the 95 % ellipsoid')


def run(quick: bool) -> Section:
    """Measure; the section is of the page about estimation."""
    cv2.setNumThreads(1)
    values = load_description(description_file().with_name(ARM), node='camera')
    arm = arm_from_parameters(values)
    assert isinstance(arm, Arm)
    layout, chain = RingLayout.of(values, arm), SpaceChain(arm)
    random, rigs, rows = np.random.default_rng(1), 2 if quick else RIGS, []
    for preset in PRESETS:
        given = read_model_errors(description_file().with_name('twin.yaml'), preset)
        found: dict[int, list[Array]] = {1: [], 2: []}
        for seed in range(rigs):
            _measure(layout, chain, replace(given, seed=seed), random, found)
        for cameras, errors in found.items():
            position, turn, squares = np.array(errors).T
            total = rigs * PICTURES * len(arm.discs)
            rows.append((
                f'`{preset}`, {cameras}', f'{len(errors)} of {total}',
                *(number(float(np.quantile(e, part)) * 1e3) for e in (position, turn)
                  for part in (0.5, 0.95)), f'{np.mean(squares < INSIDE):.1%}'))
        progress(f'spatial_camera: {preset} done')
    body = '\n\n'.join([
        f'Simulated: {rigs} rigs of `config/{ARM}`, {PICTURES} shapes of each, images of '
        '1280 x 960, no tare. Two cameras are 60° apart. '
        + machine(), table(HEAD, rows)])
    return Section('benchmarks/estimation.md', 'spatial_camera', body)


def _measure(layout: RingLayout, chain: SpaceChain, given: ModelErrors,
             random: np.random.Generator, found: dict[int, list[Array]]) -> None:
    """Add errors of position (m) and turn (rad), and their squares over the covariance."""
    drawn = [TwinCamera(layout, given, direction) for direction in DIRECTIONS]
    cameras = [TagCamera(layout, camera.lens) for camera in drawn]
    for _ in range(PICTURES):
        discs = chain.uniform(random.uniform(-ANGLE, ANGLE, (chain.segments, 2))).poses[::2]
        sights = [camera.measure(one.picture(discs))
                  for camera, one in zip(cameras, drawn, strict=True)]
        for n, truth in enumerate(discs):
            seen = [sight.discs[n] for sight in sights if n in sight.discs]
            if n in sights[0].discs:
                found[1].append(_error([sights[0].discs[n]], truth))
            if seen:
                found[2].append(_error(seen, truth))


def _error(seen: list[DiscPose], truth: NDArray[np.float64]) -> Array:
    """Return the error of what was measured, weighted by its covariance: m, rad, and squares."""
    back = Rotation.from_quat(truth[3:]).inv()
    errors = [np.concatenate([one.pose[:3] - truth[:3],
                              (Rotation.from_quat(one.pose[3:]) * back).as_rotvec()])
              for one in seen]
    weights = [np.linalg.inv(one.covariance) for one in seen]
    total = sum(weights)
    error = np.linalg.solve(total, sum(w @ e for w, e in zip(weights, errors, strict=True)))
    return np.array([np.linalg.norm(error[:3]), np.linalg.norm(error[3:]), error @ total @ error])
