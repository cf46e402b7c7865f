# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Faults of the simulated arm in space: which cause is named, how soon, and without any."""

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.fault_runs import (
    ANGLE,
    CAMERA,
    DEVIATIONS,
    Fault,
    LEAST_ANGLE,
    LEAST_TENSION,
    NOISE,
    Rig,
    simulate,
    SyntheticCamera,
    TAG,
)
from benchmarks.faults import alarms, HEAD, judge, observe, Outcome, RIGHT, row, total, UNSEEN
from benchmarks.lab import Description
from benchmarks.tables import machine, Section, table
from benchmarks.timing import progress
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.directions import bending_vectors
from soft_continuum.mechanics.orientations import bending_between, matrices
from soft_continuum.mechanics.space.statics import SpaceStatics
from soft_continuum.sequencing.planner import Planner, PlanSettings
from soft_continuum.sequencing.plans import Move, PlanError, Shape
from soft_continuum.sequencing.shape_plans import plans_to
from soft_continuum.twin.model_errors import read_model_errors
from soft_continuum.user_files import description_file

ARM = 'spatial_jamming.yaml'
RUNS, OPEN = 5, 10  # of each fault; sequences without one
FIRST_SEED = 300
SHAPES = 3  # of a sequence without a fault
SPREAD = np.repeat(DEVIATIONS[[0, 2]], 3)  # m, rad of a disc, as in the plane
COVARIANCE = np.diag(SPREAD**2 * (1.0 + NOISE**2))
MIDDLE = np.array([0.0, 0.0, 0.15])  # m, about which a camera turns


class SpatialCamera(SyntheticCamera):
    """The same of poses in space."""

    covariance = COVARIANCE
    spread = SPREAD

    def __call__(self, poses: Array) -> Array:
        """Return poses (discs, 7) as they are seen."""
        return np.array([_off(pose, *np.split(one, 2)) for pose, one in zip(
            poses, self._away(len(poses)), strict=True)])


class SpatialRig(Rig):
    """The plant in space with its boards."""

    def _discs(self) -> Array:
        return np.asarray(self.plant.poses[::2])

    def _places(self) -> Array:
        return np.asarray(self.plant.points)

    def _bent(self) -> Array:
        bending = bending_between(matrices(self._discs()[:, 3:]))
        return np.asarray(np.linalg.norm(bending, axis=1))

    def _way(self, tendon: int) -> Array:
        # Against a taut tendon nothing moves: it pushes more or less towards that.
        angle = self.plant.arm.tendons[tendon].angle + self.random.uniform(-1.0, 1.0)
        lift = self.random.uniform(-0.5, 0.5)
        return np.asarray([np.cos(angle), np.sin(angle), lift] / np.hypot(1.0, lift))

    def _knock_tag(self, disc: int) -> None:
        shift = self.random.uniform(*TAG) * _direction(self.random)
        turn = np.radians(self.random.uniform(0.0, 10.0)) * _direction(self.random)

        def poses(seen: Array) -> Array:
            return np.array([_off(pose, shift, turn) if n == disc else pose
                             for n, pose in enumerate(seen)])

        self.poses = poses
        self.broke(f'disc {disc}, {np.linalg.norm(shift) * 1e3:.1f} mm, '
                   f'{np.degrees(np.linalg.norm(turn)):.1f} degrees')

    def _knock_camera(self) -> None:
        shift = self.random.uniform(*CAMERA) * _direction(self.random)
        turn = np.radians(self.random.uniform(0.0, 4.0)) * _direction(self.random)

        def poses(seen: Array) -> Array:
            turned = Rotation.from_rotvec(turn).apply(seen[:, :3] - MIDDLE) + MIDDLE
            return np.array([_off(np.concatenate([place, pose[3:]]), shift, turn)
                             for place, pose in zip(turned, seen, strict=True)])

        self.poses = poses
        self.broke(f'{np.linalg.norm(shift) * 1e3:.1f} mm, '
                   f'{np.degrees(np.linalg.norm(turn)):.1f} degrees')

    @staticmethod
    def plan(arm: Any, random: np.random.Generator, shapes: int
             ) -> tuple[list[Move], list[int | None]]:
        """Return moves of random shapes that can be planned, and what carries after each."""
        planner, statics = Planner(arm, PlanSettings()), SpaceStatics(arm)
        state, pulls = statics.chain.straight(), np.zeros(len(arm.tendons))
        count, found = len(arm.segments), list[Move]()
        carrying: list[int | None] = []
        while len(found) < shapes * count:
            angles = random.uniform(LEAST_ANGLE, ANGLE, count)
            directions = random.uniform(-np.pi, np.pi, count)
            away = bending_vectors(arm, angles.tolist(), directions.tolist()) - state.bending
            if np.linalg.norm(away, axis=1).min() < LEAST_ANGLE:
                continue
            try:
                plan, = plans_to(planner, [Shape(
                    'random', tuple(angles.tolist()), 0.0, tuple(directions.tolist()))],
                    state, pulls)
            except PlanError:
                continue
            for move in plan.moves:
                state = statics.solve(
                    state, move.pulls[-1], [s == move.segment for s in range(count)])
                carrying.append(int(np.argmax(state.tensions))
                                if max(state.tensions) > LEAST_TENSION else None)
            found += plan.moves
            state, pulls = plan.state, plan.moves[-1].pulls[-1]
        return found, carrying


def _direction(random: np.random.Generator) -> Array:
    """Return a random direction, (3,)."""
    found: Array = random.normal(size=3)
    return found / np.linalg.norm(found)


def _off(pose: Array, shift: Array, turn: Array) -> Array:
    """Return a pose (7,) that is shifted (m) and turned (rad)."""
    turned = Rotation.from_rotvec(turn) * Rotation.from_quat(pose[3:])
    return np.concatenate([pose[:3] + shift, turned.as_quat()])


def watched(arm: Any, fault: Fault, seed: int, shapes: int = 1) -> Outcome:
    """Return what became of one run."""
    typical = read_model_errors(description_file().with_name('twin.yaml'), 'typical')
    one = simulate(arm, typical, fault, seed, shapes, kind=SpatialRig)
    named = observe(arm, one, SpatialCamera(np.random.default_rng(seed)))
    progress(f'spatial_faults: {fault.value}, seed {seed}, {one.detail}: ' + (
        ', '.join(f'{a.cause.name} at {a.time:.1f} s' for a in named) or 'nothing named'))
    found = judge(one, named)
    if fault is Fault.NONE or found.first in RIGHT[fault]:
        return found
    without = simulate(arm, typical, fault, seed, shapes, True, SpatialRig)
    away = float(np.linalg.norm((one.poses - without.poses)[:, :, :3], axis=2).max())
    progress(f'spatial_faults: it moved a disc by {away * 1e3:.1f} mm')
    return replace(found, unseen=away < UNSEEN)


def run(quick: bool) -> Section:
    """Measure; the section is of the page about estimation."""
    arm = Description.read(description_file().with_name(ARM)).arm

    def seeds(count: int) -> range:
        return range(FIRST_SEED, FIRST_SEED + (1 if quick else count))

    broken = {fault: [watched(arm, fault, seed) for seed in seeds(RUNS)] for fault in RIGHT}
    sequences = [watched(arm, Fault.NONE, seed, 1 if quick else SHAPES) for seed in seeds(OPEN)]
    body = '\n\n'.join([
        f'Simulated: as for the planar arm, with `config/{ARM}` in random directions. '
        + machine(),
        table((*HEAD[:2], 's until named, worst'), [
            (*row(fault, outcomes)[:2], row(fault, outcomes)[3])
            for fault, outcomes in broken.items()]), total(broken),
        alarms(in_open_loop=sequences, before_faults=sum(broken.values(), []))])
    return Section('benchmarks/estimation.md', 'spatial_faults', body)
