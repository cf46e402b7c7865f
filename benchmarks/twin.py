# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Where the ideal twin rests after random sequences, against the statics, and its speed."""

from dataclasses import replace
from math import cos, degrees, nan, pi, sin
import time
from typing import Any

import numpy as np

from benchmarks.paper import only
from benchmarks.tables import machine, number, Section, table
from benchmarks.timing import progress
from soft_continuum.mechanics import Jam, pulls_for_bending, Statics, StaticsError
from soft_continuum.mechanics.arm import Arm, Array, mounted, STANDARD_GRAVITY
from soft_continuum.ros.description import load_arm
from soft_continuum.sim.twin.model_errors import ModelErrors, PRESETS, read_model_errors
from soft_continuum.sim.twin.plant import Plant, TIME_STEP
from soft_continuum.user_files import description_file

SEQUENCES, IN_SPACE, STEPS = 50, 20, 6  # a step: soften a segment, pull, stiffen it
ANGLE = 0.6  # rad, largest bending angle of a segment
PAYLOAD = 0.05  # kg, of every other sequence in space
PRETENSION = 0.5  # N, of every other goal in space
SLACK_PULL = 0.003  # m by which a slack tendon is paid out beyond what it needs
SWITCHING, PULLING, RESTING = 0.5, 1.5, 2.0  # s
GOAL = 0.1  # mm
RATE_TIME = 10.0  # s simulated to find how fast


def run(quick: bool) -> Section:
    """Measure; the section is of the page about accuracy."""
    random = np.random.default_rng(1)
    arm = load_arm(description_file())
    in_space: Any = load_arm(description_file().with_name('spatial_jamming.yaml'))
    free = load_arm(description_file().with_name('tendon_arm.yaml'))
    file = description_file().with_name('twin.yaml')
    ideal = read_model_errors(file, 'ideal')
    count, more = (3, 1) if quick else (SEQUENCES, IN_SPACE)
    found = []
    for n in range(count):
        angle = float(random.uniform(-pi, pi))
        found.append(_walk(replace(arm, gravity=mounted(angle)), ideal, random))
        progress(f'twin: sequence {n + 1}, mounted at {degrees(angle):.0f} '
                 f'degrees: {", ".join(f"{d * 1e3:.4f}" for d in found[-1].max(axis=0))} mm')
    there = []
    for n in range(more):
        down = random.normal(size=3)
        gravity = tuple((STANDARD_GRAVITY * down / np.linalg.norm(down)).tolist())
        there.append(_walk(replace(in_space, gravity=gravity, payload=n % 2 * PAYLOAD), ideal,
                           random))
        progress(f'twin: sequence {n + 1} in space: '
                 f'{", ".join(f"{d * 1e3:.4f}" for d in there[-1].max(axis=0))} mm')
    rows = [row for name, each in (('planar', found), ('spatial', there))
            for row in _rows(name, np.concatenate(each) * 1e3, ideal)]
    rates = [(f'`{preset}`', *(number(_rate(one, read_model_errors(file, preset)))
                               for one in (arm, in_space, free))) for preset in PRESETS]
    body = '\n\n'.join([
        f'{count} random sequences of {STEPS} steps, each of which bends a segment by up to '
        f'{degrees(ANGLE):.0f}°, with the arm mounted at random angles, and {more} with '
        '`spatial_jamming.yaml` in random directions, every other one with a payload of '
        f'{PAYLOAD:g} kg. ' + machine(),
        table(('arm, stiff segments of the statics', 'largest error of a disc, mm: median',
               'worst', f'steps within {GOAL:g} mm'), rows),
        table(('simulated over processor time, one core', 'planar arm', '`spatial_jamming.yaml`',
               '`tendon_arm.yaml`'), rates)])
    return Section('benchmarks/accuracy.md', 'twin', body)


def _rows(arm: str, distances: Array, ideal: ModelErrors) -> list[tuple[str, ...]]:
    """Return rows of the table for distances (steps, 2), mm."""
    rows: list[tuple[str, ...]] = []
    for stiff, each in zip(('rigid', f'K = {ideal.stiff_ratio:,.0f} as in `ideal`'),
                           distances.T, strict=True):
        name = f'{arm}, {stiff}'
        found = each[np.isfinite(each)]
        if len(found) < len(each):
            name += f', {len(found)} of {len(each)} steps solved'
        rows.append((name, number(float(np.median(found))), number(float(found.max())),
                     f'{np.mean(found <= GOAL):.1%}'))
    return rows


def _walk(arm: Arm, ideal: ModelErrors, random: np.random.Generator) -> Array:
    """Return how far a disc is at most from each statics after each step, (STEPS, 2), m."""
    plant, rigid = Plant(arm, ideal), Statics(arm)
    described: Any = arm
    elastic: Any = Statics(replace(described, segments=tuple(
        replace(s, jam=Jam(ratio=ideal.stiff_ratio)) for s in described.segments)))
    state: Any = rigid.chain.straight()
    same = elastic.chain.straight()
    distances: list[tuple[float, float]] = []
    pulls, stiff = np.zeros(len(arm.tendon_names)), np.ones(len(arm.segments))
    _wait(plant, pulls, stiff, SWITCHING)
    while len(distances) < STEPS:
        segment = int(random.integers(len(arm.segments)))
        soft = only(segment, len(arm.segments))
        try:
            state = _bent(rigid, state, segment, random)
        except StaticsError:  # tendons cannot hold this one there
            continue
        goal = np.where(state.tensions > 0.0, state.pulls, state.pulls - SLACK_PULL)
        same = _followed(elastic, same, goal, soft)
        vacuum = 1.0 - np.array(soft, dtype=float)
        _wait(plant, pulls, vacuum, SWITCHING)
        steps = round(PULLING / TIME_STEP)
        for i in range(steps):
            plant.step(pulls + (i + 1) / steps * (goal - pulls), vacuum)
        pulls = goal
        _wait(plant, pulls, vacuum, RESTING)
        _wait(plant, pulls, stiff, SWITCHING)
        distances.append((_apart(plant.poses, state.poses),
                          _apart(plant.poses, same.poses) if same else nan))
    return np.array(distances)


def _followed(statics: Any, state: Any, pulls: Array, soft: tuple[bool, ...]) -> Any:
    """Return the next state; None where the statics find none, and after that."""
    try:
        return state and statics.solve(state, pulls, soft)
    except StaticsError:
        return None


def _bent(statics: Any, state: Any, segment: int, random: np.random.Generator) -> Any:
    """Return the state in which a segment is bent by up to ANGLE, to any side."""
    if isinstance(statics, Statics):
        return statics.bend(state, segment, float(random.uniform(-ANGLE, ANGLE)))
    angle, direction = random.uniform(0.0, ANGLE), random.uniform(-pi, pi)
    goals = [(nan, nan)] * statics.chain.segments
    goals[segment] = -angle * sin(direction), angle * cos(direction)
    return pulls_for_bending(statics, state, goals, only(segment, statics.chain.segments),
                             pretension=float(random.integers(2)) * PRETENSION).state


def _wait(plant: Plant, pulls: Array, vacuum: Array, duration: float) -> None:
    for _ in range(round(duration / TIME_STEP)):
        plant.step(pulls, vacuum)


def _apart(one: Array, other: Array) -> float:
    """Return the largest distance of discs, m."""
    return float(np.linalg.norm((one - other)[:, :3], axis=1).max())


def _rate(arm: Arm, given: ModelErrors) -> float:
    """Return how many seconds the plant simulates in one of this thread, while it is bent."""
    plant, vacuum = Plant(arm, given), 1.0 - np.array(only(1), dtype=float)
    goal = np.array([0.012, *[-0.02] * (len(arm.tendon_names) - 1)])
    begin, steps = time.thread_time(), round(RATE_TIME / TIME_STEP)
    for i in range(steps):
        plant.step(goal * (i / steps), vacuum)
    return plant.time / (time.thread_time() - begin)
