# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``calibrate``: measures steps/mm, signs and zero of the tendons, pump and segments."""

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
import signal
import sys
from typing import Any

from soft_continuum.commissioning import (
    calibrate_camera,
    calibrate_load_cells,
    calibrate_servos,
    calibrate_tendons,
    calibrate_vacuum,
)
from soft_continuum.commissioning.calibrate_tendons import (
    CalibrationError,
    DIRECTIONS,
    Job,
    MAX_MOVE,
    MM,
    PAID_OUT,
    PULLED_IN,
)
from soft_continuum.hardware.protocols import HardwareError, RegulatorDriver
from soft_continuum.lab.analysis.verbs import reserve_outputs, run_verb
from soft_continuum.parameters.arguments import confirm, FOR_ANALYSIS, number_in, Parser
from soft_continuum.parameters.arm import require_jamming
from soft_continuum.parameters.files import write_parameters
from soft_continuum.ros.description import load_rig
from soft_continuum.ros.names import CAMERA, LOAD_CELLS
from soft_continuum.ros.parameter_table import jamming_settings

NAME = 'calibrate'
OF_SENSORS = {CAMERA: calibrate_camera.main, LOAD_CELLS: calibrate_load_cells.main,
              'servos': calibrate_servos.main}
"""Procedures with options of their own."""
WITH_VALUE = ('--output', '--params-file', '--namespace')
APPLIES = {'measured': 'steps', 'distance': 'steps', 'seen': 'signs', 'take_up': 'zero',
           'leak_time': 'vacuum'}
"""The procedure that each option belongs to."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the verb; return the exit status, FAILED if the rig failed."""
    words = sys.argv[1:] if argv is None else argv
    for at, word in enumerate(words):
        if word in OF_SENSORS and words[at - 1] not in WITH_VALUE:  # nothing as with the rest
            return OF_SENSORS[word]([*words[:at], *words[at + 1:]])
    parser = Parser(NAME, 'Measure a rig: scales and signs of the motors, the zero of the '
                    'tendons, pump and segments. Results are written to a parameter file; pass it '
                    'to the nodes after the others.', *FOR_ANALYSIS)
    per_tendon: dict[str, Any] = {'nargs': '+', 'metavar': 'TENDON'}
    parser.add_argument('what', choices=[*PROCEDURES, 'all', *OF_SENSORS],
                        help='what to measure; all: vacuum, signs, steps, zero; '
                        f'{" and ".join(OF_SENSORS)}: see {NAME} {CAMERA} --help')
    parser.add_argument('--yes', action='store_true',
                        help='do not ask: everything is prepared and safe')
    parser.add_argument('--measured', type=number_in(0.01, 1000.0, 'mm'), **per_tendon,
                        help='steps: travel of each tendon in mm, already measured; nothing moves')
    parser.add_argument('--distance', type=number_in(1.0, MM * MAX_MOVE, 'mm'), metavar='MM',
                        help='steps: commanded travel in mm (default: 5)')
    parser.add_argument('--seen', choices=tuple(DIRECTIONS), **per_tendon,
                        help=f'signs: {PULLED_IN} or {PAID_OUT} for each tendon, already '
                        'observed; nothing moves')
    parser.add_argument('--take-up', type=number_in(-10.0, 10.0, 'mm'), **per_tendon,
                        help='zero: pull in each tendon by this many mm instead of jogging')
    parser.add_argument('--leak-time', type=number_in(1.0, 600.0, 's'), metavar='S',
                        help='vacuum: time in s over which the loss is measured (default: 10)')
    for ended in (signal.SIGTERM, signal.SIGHUP):  # a closed terminal must not leave a pump on
        signal.signal(ended, signal.default_int_handler)
    return run_verb(parser, _run, argv)


def _run(options: argparse.Namespace) -> None:
    for option, what in APPLIES.items():
        if getattr(options, option) is not None and options.what not in (what, 'all'):
            raise CalibrationError(
                f'--{option.replace("_", "-")} is for {NAME} {what} and {NAME} all, not for '
                f'{NAME} {options.what}')
    values = load_rig(options.params_file, options.namespace)
    name = f'calibration_{options.what}.yaml' if options.what != 'all' else 'calibration.yaml'
    path = Path(options.output, name)
    job = Job(options, values)
    if options.what != 'zero' or job.drive.zeros:
        path, = reserve_outputs(options.output, [name], options.force)
    procedures = [procedure for name, procedure in PROCEDURES.items()
                  if options.what in (name, 'all') and (job.jamming or name != 'vacuum'
                                                        or options.what == name)]
    for procedure in procedures:
        procedure(job)
        if job.results:  # after each, so that a later failure loses no results
            write_parameters(path, job.results, [f'Measured by {NAME} {options.what}.'])
    if job.results:
        print(f'\nWritten: {path}. Pass it to the nodes as another parameter file, after the '
              'others.')
    if job.failures:
        raise HardwareError('; '.join(job.failures))


def _vacuum(job: Job) -> None:
    """Evacuate, hold and vent one segment after the other."""
    require_jamming(job.values)
    leak_time = job.options.leak_time or 10.0
    settings = jamming_settings(job.values)
    segments = len(job.values['arm.segment_lengths'])
    confirm('One segment after the other is evacuated while all others are vented: the arm '
             'becomes soft. Support it, with all tendons slack. Afterwards a switched pump is off '
             f'and all segments are soft. This takes about {segments * (leak_time + 12):.0f} s. '
             'Ctrl-C stops.', job.options.yes)
    with calibrate_vacuum.opened_jamming(job.values) as jamming:
        if isinstance(jamming, RegulatorDriver):
            job.failures += calibrate_vacuum.regulators(jamming, job.values, settings)
        else:
            failures, results = calibrate_vacuum.segments(
                jamming, segments, settings, job.values['soft_vacuum'], leak_time)
            job.failures += failures
            job.results |= results


PROCEDURES: dict[str, Callable[[Job], None]] = {
    'vacuum': _vacuum, 'signs': calibrate_tendons.signs, 'steps': calibrate_tendons.steps,
    'zero': calibrate_tendons.zero}
