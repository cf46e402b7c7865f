# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``calibrate``: measures steps/mm, signs and zero of the tendons, pump and segments."""

import argparse
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
import signal
import sys
from typing import Any

from soft_continuum.commissioning import (
    calibrate_camera,
    calibrate_load_cells,
    calibrate_servos,
    calibrate_vacuum,
)
from soft_continuum.commissioning.calibration import (
    CalibrationError,
    corrected_scale,
    corrected_steps,
    MARK_TIME,
    MAX_MOVE,
    TendonBench,
)
from soft_continuum.hardware.clock import STEADY
from soft_continuum.hardware.commissioning import Drive
from soft_continuum.hardware.drivers import chosen_families, DriverFamily
from soft_continuum.hardware.grbl.commissioning import DRIVE
from soft_continuum.hardware.protocols import (
    HardwareError,
    JammingDriver,
    RegulatorDriver,
    TendonDriver,
)
from soft_continuum.hardware.tendon_controller import TendonLimits
from soft_continuum.lab.analysis.verbs import reserve_outputs, run_verb
from soft_continuum.parameters.arguments import (
    ask,
    confirm,
    FOR_ANALYSIS,
    number,
    number_in,
    one_of,
    Parser,
)
from soft_continuum.parameters.arm import arm_from_parameters, require_jamming
from soft_continuum.parameters.files import write_parameters
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.parameters.scalars import as_yaml
from soft_continuum.ros.description import load_rig
from soft_continuum.ros.names import CAMERA, LOAD_CELLS
from soft_continuum.ros.parameter_table import jamming_settings

MM = 1e3  # per m
PER_TENDON = 'measured', 'seen', 'take_up'
"""Options with a value for each tendon."""
NAME = 'calibrate'
GUIDE = 'docs/how_to/set_up_a_rig.md'
SIGN_MOVE = 2.0  # mm
MAX_JOG = 2.0  # mm
TAKE_UP = 'dynamixel.take_up_tension'
PULLED_IN, PAID_OUT = 'pulled-in', 'paid-out'
DIRECTIONS = {PULLED_IN: 1.0, PAID_OUT: -1.0}  # sign by what was seen
OF_SENSORS = {CAMERA: calibrate_camera.main, LOAD_CELLS: calibrate_load_cells.main,
              'servos': calibrate_servos.main}
"""Procedures with options of their own."""
WITH_VALUE = ('--output', '--params-file', '--namespace')
APPLIES = {'measured': 'steps', 'distance': 'steps', 'seen': 'signs', 'take_up': 'zero',
           'leak_time': 'vacuum'}
"""The procedure that each option belongs to."""


@dataclass
class Job:
    """
    The options, the parameters corrected so far, the results and the failures.

    names: of the tendons, as they are typed.  family: of the tendon driver.  own_drive: its
    parameters; None where it has none to correct.
    """

    options: argparse.Namespace
    values: dict[str, Any]
    results: dict[str, tuple[float, ...] | float] = field(default_factory=dict)
    failures: list[str] = field(default_factory=list)
    names: tuple[str, ...] = field(init=False)
    family: DriverFamily = field(init=False)
    own_drive: Drive | None = field(init=False)

    def __post_init__(self) -> None:
        """Find these; raises CalibrationError if an option lacks a value, and HardwareError."""
        self.family = chosen_families(self.values)['tendon_driver']
        self.own_drive = self.family.drive
        tendons = arm_from_parameters(self.values).tendon_names
        self.names = tuple(name.removesuffix('_tendon') for name in tendons)
        for option in PER_TENDON:
            given = getattr(self.options, option)
            if given is not None and len(given) != len(self.names):
                raise CalibrationError(
                    f'--{option.replace("_", "-")} has {len(given)} values; needed: one for each '
                    f'of {", ".join(self.names)}')

    @property
    def jamming(self) -> bool:
        """Whether the arm has segments that can be stiffened."""
        return bool(self.values['arm.jamming'])

    def per_tendon(self, name: str) -> tuple[float, ...]:
        """Return a parameter with a value for each tendon; raises CalibrationError."""
        values: tuple[float, ...] = self.values[name]
        if len(values) == 1 and self.drive.shared:
            return values * len(self.names)
        if len(values) != len(self.names):
            raise CalibrationError(f'parameter {name} is {as_yaml(values)}; needed: one value for '
                                   f'each of {", ".join(self.names)}; begin with estimates')
        return values

    @property
    def drive(self) -> Drive:
        """The parameters of the tendon driver; those of grbl where it has none."""
        return self.own_drive or DRIVE

    def one(self, tendon: int, distance: float) -> tuple[float, ...]:
        """Return the distances (m) of all tendons that move only one, by ``distance`` in mm."""
        return tuple(distance / MM if i == tendon else 0.0 for i in range(len(self.names)))


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


# Tendons


@contextmanager
def _jamming(job: Job) -> Iterator[JammingDriver | RegulatorDriver]:
    driver: JammingDriver | RegulatorDriver = chosen_families(job.values)['jamming_driver'].make(
        job.values, STEADY)
    driver.open()
    try:
        yield driver
    finally:
        driver.close()


@contextmanager
def _bench(job: Job, text: str, sets_zero: bool = False
           ) -> Iterator[tuple[TendonBench, TendonDriver]]:
    """
    Soften segments and open the steppers; afterwards clear a provisional zero.

    For each tendon, the segment below its end is softened.
    """
    # The user takes up slack.
    values, arm = job.values | {TAKE_UP: 0.0}, arm_from_parameters(job.values)
    soft = sorted({end - 1 for end in arm.tendon_ends}) if job.jamming else []
    if soft and values['jamming_driver'] == 'simulated':
        text += (' The valves are simulated (jamming_driver): make sure by hand that a segment '
                 'is soft.')
    vented = ' '.join(f'Segment {segment + 1} is vented and becomes soft.' for segment in soft)
    confirm(f'{vented} {text} Ctrl-C stops.'.lstrip(), job.options.yes)
    tendons: TendonDriver = job.family.make(values, STEADY)
    if tendons.reference_moves:
        raise CalibrationError(
            'the tendons are homed (grbl.homed_pulls), which calibrate does not do: remove '
            f'grbl.homed_pulls from the files and set $22=0 during calibration, see {GUIDE}')
    with _jamming(job) if soft else nullcontext() as jamming:
        bench = TendonBench(
            tendons, jamming, soft,
            TendonLimits(arm.tendon_names, values['pull_limits'], values['speed_limit']),
            values['ambient_pressure'] - values['soft_vacuum'])
        tendons.open()
        provisional = False
        try:
            bench.soften()
            # Tendons need a zero to move: the present position serves meanwhile.
            provisional = not tendons.read().referenced
            if provisional:
                tendons.reference()
            yield bench, tendons
            provisional = provisional and not sets_zero
        finally:
            tendons.close()
            if provisional:
                _clear_zero(job)


def _clear_zero(job: Job) -> None:
    try:
        job.family.clear_zero(job.values)
    except (HardwareError, ParameterError) as error:
        print('The tendon device may still hold a provisional zero: power-cycle it before '
              f'anything else ({error})', file=sys.stderr)


UNHOOK_REQUEST = (
    'The tendons move by up to {:g} mm, one after the other. To avoid strain, unhook them from '
    'the arm, or pay out that much slack by hand.')


def _must_ask(job: Job, why: str, option: str, note: str = '') -> None:
    """Raise CalibrationError if --yes is given although an answer is needed."""
    if job.options.yes:
        raise CalibrationError(
            f'{why}: give {option} {" ".join(job.names).upper()}{note}, or leave out --yes')


def _signs(job: Job) -> None:
    """Find the direction in which each stepper pulls."""
    seen = job.options.seen
    if seen is None:
        _must_ask(job, 'somebody must watch the tendons', '--seen')
        seen = []
        with _bench(job, UNHOOK_REQUEST.format(SIGN_MOVE)) as (bench, _):
            for tendon, name in enumerate(job.names):
                answer = 'again'
                while answer == 'again':
                    print(f'The {name} tendon moves ...', flush=True)
                    bench.move(job.one(tendon, SIGN_MOVE))
                    answer = ask(
                        f'Was the {name} tendon pulled in, or paid out? '
                        f'({PULLED_IN}, {PAID_OUT}, again)',
                        one_of(*DIRECTIONS, 'again'))
                    bench.move(job.one(tendon, -SIGN_MOVE))
                seen.append(answer)
    name = job.drive.signs
    signs = tuple(sign * DIRECTIONS[answer]
                  for sign, answer in zip(job.per_tendon(name), seen, strict=True))
    _take(job, name, signs)


def _steps(job: Job) -> None:
    """Compare commanded with measured travel."""
    distance = job.options.distance or 5.0
    travels = job.options.measured
    if travels is None:
        _must_ask(job, 'travel must be measured', '--measured')
        travels = []
        with _bench(job, f'{UNHOOK_REQUEST.format(distance)} Have a caliper or ruler ready and '
                    'a mark on each tendon.') as (bench, _):
            for tendon, name in enumerate(job.names):
                confirm(f'The {name} tendon: note where its mark is.', job.options.yes)
                print(f'The {name} tendon is pulled in by {distance:g} mm ...', flush=True)
                bench.move(job.one(tendon, distance))
                travels.append(ask(
                    f'By how many mm was the {name} tendon really pulled in?',
                    lambda text: _travel(text, distance)))
                bench.move(job.one(tendon, -distance))
    name = job.drive.scale
    before = job.per_tendon(name)
    scales = tuple(corrected_scale(job.drive, old, distance / MM, travel / MM)
                   for old, travel in zip(before, travels, strict=True))
    _take(job, name, scales)
    if job.own_drive and job.drive.scale_moves_zero and scales != tuple(before):
        _clear_zero(job)
        print('The scale has changed: the zero must be set again.')


def _travel(text: str, distance: float) -> float:
    travel = number(text, 0.01, 1000.0, 'mm')
    corrected_steps(1.0, distance / MM, travel / MM)
    return travel


def _take(job: Job, name: str, values: tuple[float, ...]) -> None:
    """Keep a result if the rig uses the driver it belongs to."""
    print(f'{name}: {as_yaml(values)} ({", ".join(job.names)}); it was '
          f'{as_yaml(job.values[name])}')
    job.values[name] = values
    if job.own_drive:
        job.results[name] = values
    else:
        print(f'This is not kept: tendon_driver is {job.values["tendon_driver"]}.')


def _zero(job: Job) -> None:
    """Take up the slack of all tendons, then set the zero at the straight arm."""
    take_up = job.options.take_up
    if take_up is None:
        _must_ask(job, 'somebody must look at the slack', '--take-up', ' (0: just taut)')
    with _bench(job, 'The arm is straight and all tendons are hooked in, slack or just taut.',
                sets_zero=True) as (bench, tendons):
        if take_up is None:
            _jog(bench, job)
            confirm('All tendons are just taut, and the arm is straight.', job.options.yes)
        else:
            bench.move(tuple(distance / MM for distance in take_up))
        tendons.reference()
        STEADY.sleep(MARK_TIME)
    print('The straight arm is zero.')
    if parameter := job.drive.zeros:
        _take(job, parameter, tuple(tendons.zeros))  # type: ignore[attr-defined]
        print('If the joints keep their position when switched off, set '
              f'{parameter.partition(".")[0]}.absolute: true; the arm is then referenced at every '
              'start. Otherwise start the nodes and, with the arm straight and all tendons just '
              'taut, type soft_continuum reference.')
        return
    tendons.open()  # as the node will
    try:
        kept = tendons.read().referenced
    finally:
        tendons.close()
    print('The controller keeps it: start the nodes.' if kept else
          f'The controller does not keep it, because opening its port resets it ({GUIDE}): start '
          'the nodes and, with the arm straight and all tendons just taut, type soft_continuum '
          'reference.')


def _jog(bench: TendonBench, job: Job) -> None:
    names = job.names
    print(f'Type a tendon ({", ".join(names)}, or its first letters) and how many mm to pull it '
          f'in, up to {MAX_JOG:g}; negative pays out.\nFor example: {names[0]} 0.5. Type done '
          'when all are just taut.')
    while True:
        distances = ask('TENDON MM, or done:', partial(_jog_distances, job))
        if distances is None:
            return
        try:
            reading = bench.move(distances)
        except CalibrationError as error:
            print(error, flush=True)
            continue
        print(', '.join(f'{name} {MM * pull:.2f} mm'
                        for name, pull in zip(names, reading.pulls, strict=True)), flush=True)


def _jog_distances(job: Job, text: str) -> tuple[float, ...] | None:
    """Return the distances (m) of a typed line; None for the end."""
    if text == 'done':
        return None
    tendon, _, distance = text.partition(' ')
    found = [i for i, name in enumerate(job.names) if name == tendon] or [
        i for i, name in enumerate(job.names) if tendon and name.startswith(tendon)]
    if len(found) != 1:
        raise CalibrationError(
            f'{text!r} was typed; allowed: {" MM, ".join(job.names)} MM, done')
    return job.one(found[0], number(distance, -MAX_JOG, MAX_JOG, 'mm'))


# Vacuum


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
    with _jamming(job) as jamming:
        if isinstance(jamming, RegulatorDriver):
            job.failures += calibrate_vacuum.regulators(jamming, job.values, settings)
        else:
            failures, results = calibrate_vacuum.segments(
                jamming, segments, settings, job.values['soft_vacuum'], leak_time)
            job.failures += failures
            job.results |= results


PROCEDURES: dict[str, Callable[[Job], None]] = {
    'vacuum': _vacuum, 'signs': _signs, 'steps': _steps, 'zero': _zero}
