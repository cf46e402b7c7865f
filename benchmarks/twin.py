# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Where the ideal twin rests after random sequences, against the statics, and its speed."""

from dataclasses import replace
from math import degrees, pi
import time

import numpy as np

from benchmarks.paper import only
from benchmarks.tables import machine, number, Section, table
from benchmarks.timing import progress
from soft_continuum.mechanics import Arm, Jam, Statics, StaticsError
from soft_continuum.mechanics.chain import Array
from soft_continuum.nodes.up import description_file
from soft_continuum.parameters.files import load_arm
from soft_continuum.twin.differences import Differences, PRESETS, read_differences
from soft_continuum.twin.plant import Plant, TIME_STEP

SEQUENCES, STEPS = 50, 6  # a step: soften a segment, pull, stiffen it
ANGLE = 0.6  # rad, largest bending angle of a segment
SLACK_PULL = 0.003  # m by which a slack tendon is paid out beyond what it needs
SWITCHING, PULLING, RESTING = 0.5, 1.5, 2.0  # s
GOAL = 0.1  # mm
RATE_TIME = 10.0  # s simulated to find how fast


def run(quick: bool) -> Section:
    """Measure; the section is of the page about the twin."""
    random = np.random.default_rng(1)
    arm = load_arm(description_file())
    file = description_file().with_name('twin.yaml')
    ideal = read_differences(file, 'ideal')
    count = 3 if quick else SEQUENCES
    found = []
    for n in range(count):
        mounted = replace(arm, mounting_angle=float(random.uniform(-pi, pi)))
        found.append(_walk(mounted, ideal, random))
        progress(f'twin: sequence {n + 1}, mounted at {degrees(mounted.mounting_angle):.0f} '
                 f'degrees: {", ".join(f"{d * 1e3:.4f}" for d in found[-1].max(axis=0))} mm')
    distances = np.concatenate(found) * 1e3
    rows = [(name, number(float(np.median(each))), number(float(np.quantile(each, 0.95))),
             number(float(each.max())), f'{np.mean(each <= GOAL):.1%}')
            for name, each in zip(('rigid, as described', f'K = {ideal.stiff_ratio:,.0f} as in '
                                   '`ideal`'), distances.T, strict=True)]
    rates = [(f'`{preset}`', number(_rate(arm, read_differences(file, preset))))
             for preset in PRESETS]
    body = '\n\n'.join([
        f'Simulated: {count} random sequences (seed 1) of {STEPS} steps with '
        f'{len(arm.segments)} segments, each set to up to {degrees(ANGLE):.0f}° in random order, '
        'the arm mounted at random angles. ' + machine(),
        table(('stiff segments of the statics', 'the farthest disc, mm: median', '95 %', 'worst',
               f'steps within {GOAL:g} mm'), rows),
        table(('preset', 'simulated time over processor time, one core'), rates)])
    return Section('../how_to/try_it_on_a_simulated_rig.md', 'twin', body)


def _walk(arm: Arm, ideal: Differences, random: np.random.Generator) -> Array:
    """Return how far a disc is at most from each statics after each step, (STEPS, 2), m."""
    plant, rigid = Plant(arm, ideal), Statics(arm)
    elastic = Statics(replace(arm, segments=tuple(
        replace(s, jam=Jam(ratio=ideal.stiff_ratio)) for s in arm.segments)))
    state = same = rigid.chain.straight()
    distances: list[tuple[float, float]] = []
    pulls, stiff = np.zeros(2), np.ones(len(arm.segments))
    _wait(plant, pulls, stiff, SWITCHING)
    while len(distances) < STEPS:
        segment = int(random.integers(len(arm.segments)))
        soft = only(segment, len(arm.segments))
        try:
            state = rigid.bend(state, segment, float(random.uniform(-ANGLE, ANGLE)))
        except StaticsError:  # tendons cannot hold this one there
            continue
        goal = np.where(state.tensions > 0.0, state.pulls, state.pulls - SLACK_PULL)
        same = elastic.solve(same, goal, soft)
        vacuum = 1.0 - np.array(soft, dtype=float)
        _wait(plant, pulls, vacuum, SWITCHING)
        steps = round(PULLING / TIME_STEP)
        for i in range(steps):
            plant.step(pulls + (i + 1) / steps * (goal - pulls), vacuum)
        pulls = goal
        _wait(plant, pulls, vacuum, RESTING)
        _wait(plant, pulls, stiff, SWITCHING)
        distances.append((_apart(plant.points, state.points), _apart(plant.points, same.points)))
    return np.array(distances)


def _wait(plant: Plant, pulls: Array, vacuum: Array, duration: float) -> None:
    for _ in range(round(duration / TIME_STEP)):
        plant.step(pulls, vacuum)


def _apart(one: Array, other: Array) -> float:
    """Return the largest distance of discs, m."""
    return float(np.linalg.norm((one - other)[:, :2], axis=1).max())


def _rate(arm: Arm, given: Differences) -> float:
    """Return how many seconds the plant simulates in one of this thread, while it is bent."""
    plant, vacuum = Plant(arm, given), 1.0 - np.array(only(1), dtype=float)
    begin, steps = time.thread_time(), round(RATE_TIME / TIME_STEP)
    for i in range(steps):
        plant.step(np.array([0.012, -0.02]) * (i / steps), vacuum)
    return plant.time / (time.thread_time() - begin)
