# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``calibrate load_cells``: zero and scale of load cells that publish on the topic load_cells."""

import argparse
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TYPE_CHECKING

import numpy as np

from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.lab.analysis.verbs import described_arm, reserve_outputs, run_verb, text_table
from soft_continuum.mechanics.arm import STANDARD_GRAVITY
from soft_continuum.parameters.arguments import (
    ask,
    confirm,
    FOR_ANALYSIS,
    number,
    number_in,
    Parser,
)
from soft_continuum.parameters.files import write_parameters
from soft_continuum.ros.names import LOAD_CELLS

if TYPE_CHECKING:
    from soft_continuum.client.requests import Requests

NAME = 'calibrate load_cells'
FILE = 'calibration_load_cells.yaml'
DURATION = 2.0  # s that the cells are read
MIN_SAMPLES = 5
MAX_SAMPLES = 100_000
MASSES = 0.001, 100.0  # kg
MIN_SIGNAL = 10.0  # standard deviations by which a load has to be seen


@dataclass(frozen=True)
class Shown:
    """Reading of a load cell in its own unit: mean and standard deviation."""

    mean: float
    stddev: float


def main(argv: Sequence[str] | None = None) -> int:
    """Calibrate; return the exit status."""
    parser = Parser(NAME, 'Measure the readings of the load cells on the topic load_cells without '
                    f'tension and with a known mass. Moves nothing. Writes {FILE}; pass it to the '
                    'nodes after the other parameter files.',
                    '--namespace', '--timeout', *FOR_ANALYSIS)
    parser.add_argument('--mass', type=number_in(*MASSES, 'kg'), metavar='KG',
                        help='mass hung on each tendon in turn (default: ask)')
    parser.add_argument('--zero-only', action='store_true',
                        help='the cells show N: measure their zeros only')
    parser.add_argument('--yes', action='store_true',
                        help='with --zero-only: do not ask, the tendons are slack')
    given = parser.parse_args(argv)
    if given.yes and not given.zero_only:
        parser.error('--yes needs --zero-only: otherwise a mass has to be hung up in between')
    if given.mass and given.zero_only:
        parser.error('--mass or --zero-only, not both')
    return run_verb(parser, _run, argv)


def _run(options: argparse.Namespace) -> None:
    from soft_continuum.client.connection import Connection
    tendons = described_arm(options)[1].tendon_names
    path, = reserve_outputs(options.output, [FILE], options.force)
    connection = Connection('calibrate', options.namespace, options.timeout)
    try:
        requests = connection.requests
        confirm('Take all tension off the tendons: unhook them from the arm, or pay them out.',
                options.yes and options.zero_only)
        slack = _read(requests, tendons)
        scales = dict.fromkeys(tendons, 1.0)
        for tendon in () if options.zero_only else tendons:
            scales[tendon] = _scale(requests, tendon, slack[tendon], options.mass)
    finally:
        connection.close()
    print('\n' + text_table(
        ('', 'zero', 'noise', 'scale'),
        [(name, f'{slack[name].mean:.6g}', f'{slack[name].stddev:.2g}', f'{scale:.6g}')
         for name, scale in scales.items()]))
    write_parameters(path, {
        'load_cells.enabled': True,
        'load_cells.zeros': tuple(slack[name].mean for name in tendons),
        'load_cells.scales': tuple(scales.values())}, [f'Measured by {NAME}.'])
    print(f'\nWritten: {path}. Pass it to the nodes as another parameter file, after the others.')


def _scale(requests: 'Requests', tendon: str, slack: Shown, mass: float | None) -> float:
    """Return N per unit of a cell, from a mass that the user hangs on its tendon."""
    confirm(f'Hang {"a known mass" if mass is None else f"{mass:g} kg"} on {tendon}, at rest.',
            yes=False)
    if mass is None:
        mass = ask('Which mass, in kg?', lambda text: number(text, *MASSES, 'kg'))
    loaded = _read(requests, (tendon,))[tendon]
    change = loaded.mean - slack.mean
    if abs(change) <= MIN_SIGNAL * max(loaded.stddev, slack.stddev):
        raise HardwareError(
            f'the load cell of {tendon} shows {loaded.mean:g} with {mass:g} kg and '
            f'{slack.mean:g} without; is it the cell of this tendon, does the mass hang freely?')
    return mass * STANDARD_GRAVITY / change


def _read(requests: 'Requests', tendons: Sequence[str]) -> dict[str, Shown]:
    """Return the readings of some tendons' cells; raises NoAnswerError, HardwareError."""
    from soft_continuum.client import NoAnswerError
    samples = requests.start(_listen(requests, tendons)).result()
    if few := [tendon for tendon in tendons if len(samples[tendon]) < MIN_SAMPLES]:
        raise NoAnswerError(
            f'fewer than {MIN_SAMPLES} readings of {", ".join(few)} on the topic {LOAD_CELLS} '
            f'within {DURATION:g} s; its node has to publish sensor_msgs/JointState with the '
            f'names {", ".join(tendons)} and their efforts')
    shown = {}
    for tendon in tendons:
        values = samples[tendon]
        shown[tendon] = Shown(float(np.mean(values)), float(np.std(values)))
        if not abs(shown[tendon].mean) < 1e9:  # also not a number
            raise HardwareError(f'the load cell of {tendon} shows {shown[tendon].mean}; check its '
                                'wires and its amplifier')
    return shown


async def _listen(requests: 'Requests', tendons: Sequence[str]) -> dict[str, list[float]]:
    """Collect messages on load_cells once they arrive; on the thread of the node."""
    from sensor_msgs.msg import JointState

    from soft_continuum.client.tasks import until
    from soft_continuum.ros.entries import SENSOR, subscribe_unguarded
    samples: dict[str, list[float]] = defaultdict(list)
    subscription = subscribe_unguarded(
        requests.node, JointState, LOAD_CELLS, partial(_take, samples, tendons), SENSOR)
    await until(lambda: all(map(samples.get, tendons)), requests.timeout)
    samples.clear()
    await until(lambda: False, DURATION)
    requests.node.destroy_subscription(subscription)
    return samples


def _take(samples: dict[str, list[float]], tendons: Sequence[str], message: Any) -> None:
    for name, effort in zip(message.name, message.effort, strict=False):
        if name in tendons and len(samples[name]) < MAX_SAMPLES:
            samples[name].append(effort)
