# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Faults of the simulated rig: which cause is named, how soon, and what is named without any."""

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from benchmarks.fault_runs import (
    closed_loop,
    DEVIATIONS,
    displacement,
    Fault,
    LEAST_ANGLE,
    NOISE,
    PERIOD,
    Run,
    simulate,
    SyntheticCamera,
)
from benchmarks.lab import Description
from benchmarks.tables import machine, number, Section, table
from benchmarks.timing import progress
from soft_continuum.estimation.anomalies import Anomaly, Cause
from soft_continuum.estimation.measuring import ActuatorState, DiscMeasurement
from soft_continuum.estimation.shape import ArmShape
from soft_continuum.mechanics import StaticsError
from soft_continuum.mechanics.arm import Arm
from soft_continuum.sim.twin.model_errors import ModelErrors, read_model_errors
from soft_continuum.user_files import description_file

RUNS, OPEN, CLOSED = 20, 60, 120  # of each fault; sequences without one; goals of a closed loop
FIRST_SEED = 300  # the watch was tuned on some of those before
SHAPES = 6  # of a sequence without a fault
PICTURES, DELAY = 5, 0.1  # periods from one picture to the next; s
UNSEEN = 1e-3  # m: a fault that moves every disc by less cannot be noticed
EARLY = 0.5  # s: a cause that is named earlier than that before the fault is a false alarm
RIGHT = {
    Fault.SLIP: (Cause.TENDON_SLIPPED,), Fault.STEPS: (Cause.STEPS_LOST,),
    Fault.SLIP_MOVING: (Cause.STEPS_LOST,), Fault.NOT_STIFF: (Cause.NOT_STIFF,),
    Fault.NOT_SOFT: (Cause.NOT_SOFT,), Fault.LOAD: (Cause.LOAD,),
    Fault.SENSOR: (Cause.SENSOR_MOVED,), Fault.CAMERA: (Cause.CAMERA_MOVED,)}
HEAD = ('fault', 'correct cause', 's until named: median', 'worst', 'named more later')


@dataclass(frozen=True)
class Outcome:
    """
    What was named in a run.

    first: after the fault; None for nothing.  delay: s from the fault until then.  later, false:
    how many causes were named after the first, and without a fault.  watched: s without a fault.
    unseen: whether no name is right, and the fault moved no disc by UNSEEN.
    """

    first: Cause | None
    delay: float
    later: int
    false: int
    watched: float
    unseen: bool = False


def observe(arm: Arm, run: Run) -> list[Anomaly]:
    """Return what is named in a run, seen by a camera with a delay, with errors and noise."""
    camera = SyntheticCamera(np.random.default_rng(run.seed), arm)
    shape, before = ArmShape(arm, 5e-4), run.pulls[0]
    sliding = np.zeros(len(before), dtype=int)
    pictures: list[tuple[float, np.ndarray]] = []
    found: dict[Anomaly, None] = {}
    for k, (time, pulls, soft) in enumerate(zip(run.times, run.pulls, run.soft, strict=True)):
        change, before = pulls - before, pulls
        sliding = np.where(np.abs(change) > 1e-9, np.sign(change), sliding).astype(int)
        try:
            shape.follow(ActuatorState(time, pulls, tuple(not one for one in soft.tolist()), None,
                                       tuple(sliding.tolist())))
        except StaticsError as error:
            progress(f'faults: {error}')
        if k % PICTURES == 0:
            pictures.append((time, camera(run.poses[k])))
        while pictures and pictures[0][0] < time - DELAY:
            stamp, poses = pictures.pop(0)
            shape.measure(stamp, [DiscMeasurement(n, pose, camera.covariance)
                                  for n, pose in enumerate(poses)])
        found.update(dict.fromkeys(shape.anomalies))
    return list(found)


def judge(run: Run, named: list[Anomaly]) -> Outcome:
    """Return what became of a run."""
    begin = min(run.moment - EARLY, float(run.times[-1]))
    after = [one for one in named if one.time >= begin]
    delay = max(0.0, after[0].time + DELAY - run.moment) if after else np.inf
    return Outcome(after[0].cause if after else None, delay, max(0, len(after) - 1),
                   len(named) - len(after), begin - float(run.times[0]))


def watched(arm: Arm, given: ModelErrors, one: Run) -> Outcome:
    """Return what becomes of a run of an arm with these differences."""
    named = observe(arm, one)
    progress(f'faults: {one.fault.value}, seed {one.seed}, {one.detail}: ' + (
        ', '.join(f'{a.cause.name} at {a.time:.1f} s' for a in named) or 'nothing named'))
    found = judge(one, named)
    if one.fault is Fault.NONE or found.first in RIGHT[one.fault]:
        return found
    away = displacement(arm, given, one)
    progress(f'faults: it moved a disc by {away * 1e3:.1f} mm')
    return replace(found, unseen=away < UNSEEN)


def simulated(arm: Arm, given: ModelErrors, faults: int, sequences: int, shapes: int
              ) -> tuple[dict[Fault, list[Outcome]], list[Outcome]]:
    """Return what becomes of so many runs of each fault, and of sequences of shapes without."""
    def each(fault: Fault, count: int, shapes: int = 1) -> list[Outcome]:
        return [watched(arm, given, simulate(arm, given, fault, seed, shapes))
                for seed in range(FIRST_SEED, FIRST_SEED + count)]

    return ({fault: each(fault, faults) for fault in RIGHT},
            each(Fault.NONE, sequences, shapes))


def row(fault: Fault, outcomes: list[Outcome]) -> tuple[str, ...]:
    """Return the runs of a fault as a row under HEAD."""
    delays = [one.delay for one in outcomes if one.first in RIGHT[fault]]
    return (fault.value, f'{len(delays)} of {len(outcomes)}',
            number(float(np.median(delays or [np.nan])), 2), number(max(delays or [np.nan]), 2),
            str(sum(one.later for one in outcomes)))


def total(broken: dict[Fault, list[Outcome]]) -> str:
    """Return how many causes were correct, and what the others were."""
    others = Counter('nothing' if one.first is None else f'`{one.first.name}`'
                     for fault, each in broken.items() for one in each
                     if one.first not in RIGHT[fault])
    runs = sum(broken.values(), [])
    right = len(runs) - others.total()
    text = ', '.join(f'{count} {name}' for name, count in others.most_common()) or 'none'
    unseen = sum(one.unseen for one in runs)
    return (f'Correct: {right} of {len(runs)} ({100.0 * right / len(runs):.1f} %). Named for the '
            f'others: {text}.'
            + f' {unseen} of these moved no disc by {UNSEEN * 1e3:g} mm.' * bool(unseen))


def alarms(**watched: list[Outcome]) -> str:
    """Return what was named without a fault; the name of an argument says when."""
    every = sum(watched.values(), [])
    hours, false = sum(one.watched for one in every) / 3600.0, sum(one.false for one in every)
    most = float(chi2.ppf(0.95, 2 * false + 2)) / 2.0 / hours
    parts = ', '.join(f'{sum(one.watched for one in each) / 60.0:.0f} {name.replace("_", " ")}'
                      for name, each in watched.items())
    return (f'Without a fault, {false} cause{"s" * (false != 1)} named in {hours * 60.0:.0f} min '
            f'({parts}): {number(false / hours, 2)} per hour, at most {number(most, 2)} (95 %).')


def run(quick: bool) -> Section:
    """Measure; the section is of the page about estimation."""
    description = Description.read()
    arm = description.arm
    typical = read_model_errors(description_file().with_name('twin.yaml'), 'typical')

    broken, sequences = simulated(arm, typical, *((1, 1, 1) if quick else (RUNS, OPEN, SHAPES)))
    closed = [watched(arm, typical, closed_loop(description, typical, seed))
              for seed in range(FIRST_SEED, FIRST_SEED + (1 if quick else CLOSED))]
    body = '\n\n'.join([
        'Simulated: random shapes of rigs `typical`, each run with a fault of random size at a '
        f'random time. {1.0 / (PICTURES * PERIOD):.0f} images per second, {DELAY:g} s late, show '
        f'all discs and the base, with constant errors of {DEVIATIONS[0] * 1e3:g} mm and '
        f'{np.degrees(DEVIATIONS[3]):.1f}° and noise of {NOISE:.0%} of them. Segments that leak '
        f'or keep their vacuum bend by at least {np.degrees(LEAST_ANGLE):.0f}°. Seeds were not '
        'used for tuning. A cause is correct for any disc or segment. ' + machine(),
        table(HEAD, [row(fault, outcomes) for fault, outcomes in broken.items()]), total(broken),
        alarms(in_open_loop=sequences, in_closed_loop=closed,
               before_faults=sum(broken.values(), []))])
    return Section('benchmarks/estimation.md', 'faults', body)
