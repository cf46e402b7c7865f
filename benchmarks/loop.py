# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Where the simulated arm ends up when it is set to random shapes, with and without sensors."""

from dataclasses import dataclass, replace
from math import pi
import time

import cv2
import numpy as np

from benchmarks.closed import closed_loop, on_angles
from benchmarks.contenders import (
    Contender,
    Goal,
    ITERATIONS,
    open_loop,
    open_loop_told,
    Outcome,
    pi_on_angles,
    TOLERANCE,
)
from benchmarks.lab import CAMERA, Description, Lab, LabError
from benchmarks.tables import machine, number, Section, table
from benchmarks.timing import progress
from soft_continuum.estimation.sensing.tare import SensorError
from soft_continuum.mechanics import StaticsError
from soft_continuum.mechanics.directions import bending_vectors
from soft_continuum.planning.planner import Planner
from soft_continuum.planning.plans import PlanError, Shape
from soft_continuum.planning.shape_plans import plans_to
from soft_continuum.sim.twin.model_errors import ModelErrors, read_model_errors
from soft_continuum.user_files import description_file

PRESETS = ('typical', 'severe')
SEEDS = 30
ANGLE = 0.6  # rad, largest bending angle of a goal
HOLDING = 2.0  # s until the arm is judged
CONTENDERS: dict[str, Contender] = {
    'open loop': open_loop,
    'open loop, true stiffness, masses and K': open_loop_told,
    'PI on each angle': pi_on_angles,
    'closed loop on the angles': on_angles,
    'closed loop on the tip': closed_loop,
}
HEAD = ('method', 'error of the tip, mm: median', '95 %', 'worst',
        'largest error of an angle, degrees: median', '95 %', 'worst', 'time, s: median')


@dataclass(frozen=True)
class Result:
    """
    One run of one contender, judged by the truth of the plant.

    tip_error: m, distance to the goal's tip.  angle_error: rad, largest of all segments.
    duration: simulated, s.  largest_tension: N.  spent: processor time, s.
    """

    tip_error: float
    angle_error: float
    outcome: Outcome
    duration: float
    largest_tension: float
    violations: tuple[str, ...]
    spent: float


def run(quick: bool) -> Section:
    """Measure; the section is of the page about the closed loop."""
    cv2.setNumThreads(1)
    description = Description.read()
    seeds, parts, every = range(2 if quick else SEEDS), list[str](), list[Result]()
    for preset in PRESETS:
        given = read_model_errors(description_file().with_name('twin.yaml'), preset)
        results: dict[str, list[Result]] = {name: [] for name in CONTENDERS}
        for seed in seeds:
            goal = random_goal(description, seed)
            for name, contender in CONTENDERS.items():
                results[name].append(
                    judged(description, replace(given, seed=seed), goal, contender))
                progress(f'loop: {preset}, seed {seed}, {name}: {line(results[name][-1])}')
        every += sum(results.values(), [])
        parts.append(table((f'`{preset}`: {HEAD[0]}', *HEAD[1:]), [
            row(name, each) for name, each in results.items()]))
    exceeded, failed = sum(bool(r.violations) for r in every), sum(
        bool(r.outcome.failed) for r in every)
    body = '\n\n'.join([
        f'Simulated: {len(seeds)} rigs of each preset, each with its own random errors and a '
        f'random shape of up to {np.degrees(ANGLE):.0f}° per segment. Errors are relative to the '
        'true shape. PI uses no model, drives each soft segment to within '
        f'{np.degrees(TOLERANCE):g}°, and fails after {ITERATIONS} iterations. The closed loop '
        'uses the default parameters. The camera is tared. Of all runs '
        f'{exceeded or "none"} exceeded `pull_limits`, `speed_limit` or `tension_limit`, and '
        f'{failed or "none"} failed. {machine()}', *parts])
    return Section('benchmarks/closed_loop.md', 'loop', body)


def random_goal(description: Description, seed: int) -> Goal:
    """Return a shape that the described arm can be set to, and where its tip then is."""
    arm, count = description.arm, len(description.arm.segments)
    random = np.random.default_rng([seed, 14 if arm.planar else 15])
    planner = Planner(arm, description.settings)
    while True:
        angles = tuple(random.uniform(-ANGLE if arm.planar else 0.0, ANGLE, count).tolist())
        directions = () if arm.planar else tuple(random.uniform(-pi, pi, count).tolist())
        try:
            plan, = plans_to(planner, [Shape('goal', angles, 0.0, directions)])
        except PlanError:
            continue
        return Goal(angles, tuple(plan.state.backbone[-1].tolist()), directions)


def judged(description: Description, given: ModelErrors, goal: Goal, contender: Contender,
           sensor: str = CAMERA, tared: bool = True) -> Result:
    """Let a contender set a goal on a rig of its own, stiffen what it left soft, and judge."""
    return judged_in(Lab(description, given, sensor, tared), goal, contender)


def judged_in(lab: Lab, goal: Goal, contender: Contender) -> Result:
    """Let a contender set a goal in a lab, stiffen what it left soft, and judge."""
    begin, start = time.process_time(), lab.time
    try:
        outcome = contender(lab, goal, lab.description.arm)
    except (LabError, PlanError, SensorError, StaticsError) as error:
        outcome = Outcome((0,) * len(goal.angles), f'{type(error).__name__}: {error}')
    duration = lab.time - start
    for segment, stiff in enumerate(lab.stiff):
        if not stiff:
            lab.switch(segment, True)
    lab.wait(HOLDING)
    return Result(
        float(np.linalg.norm(lab.tip[:3] - goal.tip)), _angle_error(lab, goal),
        outcome, duration, lab.largest_tension, tuple(lab.violations),
        time.process_time() - begin)


def _angle_error(lab: Lab, goal: Goal) -> float:
    """Return how far the worst segment really is off, rad."""
    away = lab.bending - bending_vectors(lab.description.arm, goal.angles, goal.directions)
    return float(np.linalg.norm(away, axis=1).max())


def line(result: Result) -> str:
    """Return a result for the screen."""
    more = ' '.join(['', result.outcome.failed, *result.violations]).rstrip()
    return (f'tip {result.tip_error * 1e3:.2f} mm, angles {np.degrees(result.angle_error):.2f} '
            f'degrees, corrections {result.outcome.corrections}, {result.duration:.0f} s, '
            f'{result.largest_tension:.0f} N, {result.spent:.1f} s of processor time{more}')


def row(name: str, results: list[Result]) -> tuple[str, ...]:
    """Return the results of a contender as a row under HEAD."""
    tips = np.array([r.tip_error for r in results]) * 1e3
    angles = np.degrees([r.angle_error for r in results])
    spread = [number(float(value)) for errors in (tips, angles) for value in (
        np.median(errors), np.quantile(errors, 0.95), errors.max())]
    return (name, *spread, f'{np.median([r.duration for r in results]):.0f}')
