# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Where the simulated arm in space ends up that is set to random shapes, open and closed loop."""

from dataclasses import replace

import numpy as np

from benchmarks.closed import closed_loop
from benchmarks.contenders import Contender, open_loop
from benchmarks.lab import CAMERA, Description, NOTHING, TWO_CAMERAS
from benchmarks.loop import ANGLE, judged, line, random_goal, Result
from benchmarks.tables import machine, Section, table
from benchmarks.timing import progress
from soft_continuum.sim.twin.model_errors import read_model_errors
from soft_continuum.user_files import description_file

ARM = 'spatial_jamming.yaml'
PRESET = 'severe'
SEEDS = 12
CONTENDERS: dict[str, tuple[Contender, str]] = {
    'open loop': (open_loop, NOTHING),
    'closed loop, one camera': (closed_loop, CAMERA),
    'closed loop, two cameras': (closed_loop, TWO_CAMERAS)}


def run(quick: bool) -> Section:
    """Measure; the section is of the page about the closed loop."""
    description = Description.read(description_file().with_name(ARM))
    given = read_model_errors(description_file().with_name('twin.yaml'), PRESET)
    seeds = range(1 if quick else SEEDS)
    results: dict[str, list[Result]] = {name: [] for name in CONTENDERS}
    for seed in seeds:
        goal = random_goal(description, seed)
        for name, (contender, sensor) in CONTENDERS.items():
            results[name].append(judged(
                description, replace(given, seed=seed), goal, contender, sensor))
            progress(f'spatial_loop: seed {seed}, {name}: {line(results[name][-1])}')
    body = '\n\n'.join([
        f'Simulated: rigs of `config/{ARM}`, preset `{PRESET}`, each with its own random errors '
        f'and a random shape of up to {np.degrees(ANGLE):.0f}° per segment in any direction. Aim '
        'on the tip, after a tare. The second camera is 60° from the first. ' + machine(),
        table(('error of the tip, mm', 'rigs', 'median', 'worst'), [
            _row(name, each) for name, each in results.items()])])
    return Section('benchmarks/closed_loop.md', 'spatial_loop', body)


def _row(name: str, results: list[Result]) -> tuple[str, ...]:
    tips = 1e3 * np.array([one.tip_error for one in results])
    return name, str(len(tips)), f'{np.median(tips):.2f}', f'{tips.max():.2f}'
