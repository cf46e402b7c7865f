# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Measure a rig: steps/mm, tendon signs, the zero of the tendons, pump and segments."""

import argparse
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
import signal
from statistics import fmean
import sys
from time import monotonic, sleep
from typing import Any

from soft_continuum.analysis.results import claim, text_table
from soft_continuum.commands.common import BAD_INPUT, guarded, new_parser, number_in
from soft_continuum.commands.prompts import ask, confirm, DeclinedError, number, one_of
from soft_continuum.commands.rig import as_list, rig_parameters, write_parameters
from soft_continuum.hardware.calibration import (
    CalibrationError,
    corrected_steps,
    forget_reference,
    judge,
    MARK_TIME,
    MAX_MOVE,
    measure_segment,
    SegmentVacuum,
    TendonBench,
)
from soft_continuum.hardware.drivers import JAMMING_DRIVERS, make_driver, TENDON_DRIVERS
from soft_continuum.hardware.protocols import HardwareError, JammingDriver, TendonDriver
from soft_continuum.hardware.tendon_controller import TendonLimits
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.nodes import jamming_settings

NAME = 'calibrate'
FAILED = 1
MM = 1e3  # per m
SIGN_MOVE = 2.0  # mm
LONGEST_JOG = 2.0  # mm
SIDES = ('right', 'left')
PULLED, LET_OUT = 'pulled', 'let-out'
APPLIES = {'measured': 'steps', 'distance': 'steps', 'seen': 'signs', 'take_up': 'zero',
           'leak_time': 'vacuum'}
"""Which option belongs to which procedure."""


@dataclass
class Job:
    """What is being done: the options, the parameters as corrected so far, and the results."""

    options: argparse.Namespace
    values: dict[str, Any]
    results: dict[str, tuple[float, ...] | float] = field(default_factory=dict)
    bad: list[str] = field(default_factory=list)


def main(argv: list[str] | None = None) -> int:
    """Run the command: 0 done, 1 the rig failed, 2 bad input, 130 interrupted."""
    parser = new_parser(NAME, __doc__ + ' Results are a parameter file to give to the nodes after '
                        'the others.')
    parser.add_argument('what', choices=[*PROCEDURES, 'all'],
                        help='what to measure; all: vacuum, signs, steps, zero')
    parser.add_argument('--yes', action='store_true',
                        help='everything is safe and prepared: ask nothing')
    parser.add_argument('--measured', nargs=2, type=number_in(0.01, 1000.0, 'mm'),
                        metavar=('RIGHT', 'LEFT'),
                        help='steps: travel in mm measured before; nothing moves')
    parser.add_argument('--distance', type=number_in(1.0, MM * MAX_MOVE, 'mm'), metavar='MM',
                        help='steps: commanded travel in mm (default: 5)')
    parser.add_argument('--seen', nargs=2, choices=(PULLED, LET_OUT), metavar=('RIGHT', 'LEFT'),
                        help=f'signs: {PULLED} or {LET_OUT}, seen before; nothing moves')
    parser.add_argument('--take-up', nargs=2, type=number_in(-10.0, 10.0, 'mm'),
                        metavar=('RIGHT', 'LEFT'),
                        help='zero: pull both tendons by this much in mm instead of jogging')
    parser.add_argument('--leak-time', type=number_in(1.0, 600.0, 's'), metavar='S',
                        help='vacuum: how long the loss is watched in s (default: 10)')
    options = parser.parse_args(argv)
    for option, what in APPLIES.items():
        if getattr(options, option) is not None and options.what not in (what, 'all'):
            parser.error(f'--{option.replace("_", "-")} is for {NAME} {what} and {NAME} all, not '
                         f'for {NAME} {options.what}')
    # A terminal that is closed must not leave a pump running either.
    before = {s: signal.signal(s, signal.default_int_handler)
              for s in (signal.SIGTERM, signal.SIGHUP)}
    try:
        return guarded(NAME, _run, options)
    except (HardwareError, DeclinedError) as error:
        print(f'{NAME}: {error}', file=sys.stderr)
        return FAILED
    except CalibrationError as error:
        print(f'{NAME}: {error}', file=sys.stderr)
        return BAD_INPUT
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _run(options: argparse.Namespace) -> None:
    values = rig_parameters(options.params_file)
    name = f'calibration_{options.what}.yaml' if options.what != 'all' else 'calibration.yaml'
    path = Path(options.output, name)
    if options.what != 'zero':
        path, = claim(options.output, [name], options.force)
    job = Job(options, values)
    procedures = PROCEDURES if options.what == 'all' else {options.what: PROCEDURES[options.what]}
    for procedure in procedures.values():
        procedure(job)
        if job.results:  # after each, so that what went well is not lost with what did not
            write_parameters(path, job.results, f'Measured by {NAME} {options.what}.')
    if job.results:
        print(f'\nWritten: {path}. Give it to the nodes as one more parameter file, after the '
              'others.')
    if job.bad:
        raise HardwareError('; '.join(job.bad))


# Tendons


@contextmanager
def _jamming(job: Job) -> Iterator[JammingDriver]:
    driver: JammingDriver = make_driver(
        JAMMING_DRIVERS, job.values['jamming_driver'], job.values, monotonic)
    driver.open()
    try:
        yield driver
    finally:
        driver.close()


@contextmanager
def _bench(job: Job, text: str, sets_zero: bool = False
           ) -> Iterator[tuple[TendonBench, TendonDriver]]:
    """Soften the last segment and open the steppers; afterwards leave no zero that is none."""
    values = job.values
    segments = len(values['arm.segment_lengths'])
    if values['jamming_driver'] == 'simulated':
        text += (' The valves are simulated (jamming_driver): make sure by hand that a segment '
                 'is soft.')
    confirm(f'Segment {segments} is vented and becomes soft. {text} Ctrl-C stops.',
            job.options.yes)
    tendons: TendonDriver = make_driver(
        TENDON_DRIVERS, values['tendon_driver'], values, monotonic)
    if tendons.reference_moves:
        raise CalibrationError(
            'the tendons are homed (grbl.homed_pulls), which calibrate does not do: take '
            'grbl.homed_pulls out of the files and set $22=0 for as long as this takes, as '
            'docs/rig.md says')
    with _jamming(job) as jamming:
        bench = TendonBench(
            tendons, jamming, segments - 1,
            TendonLimits(arm_from_parameters(values).tendon_names, values['pull_limits'],
                         values['speed_limit']),
            values['ambient_pressure'] - values['soft_vacuum'])
        tendons.open()
        provisional = False
        try:
            bench.soften()
            # To be moved, tendons need a zero: the present position, for as long as this takes.
            provisional = not tendons.read().referenced
            if provisional:
                tendons.reference()
            yield bench, tendons
            provisional = provisional and not sets_zero
        finally:
            tendons.close()
            if provisional:
                _forget_zero(values)


def _forget_zero(values: Mapping[str, Any]) -> None:
    if values['tendon_driver'] != 'grbl':
        return
    try:
        forget_reference(values['grbl.port'], values['grbl.baud_rate'])
    except HardwareError as error:
        print(f'{NAME}: the controller may still hold a zero that is none: power-cycle it before '
              f'anything else ({error})', file=sys.stderr)


def _pair(side: int, distance: float) -> tuple[float, float]:
    """Return distances (m) that move one tendon only, by ``distance`` in mm."""
    return (distance / MM, 0.0) if side == 0 else (0.0, distance / MM)


UNHOOKED = ('The tendons move by up to {:g} mm, one after the other, and nothing may be strained: '
            'unhook both from the arm, or let out that much slack by hand.')


def _signs(job: Job) -> None:
    """Find out in which direction each stepper pulls."""
    seen = job.options.seen
    if seen is None:
        if job.options.yes:
            raise CalibrationError('the signs must be seen: give --seen RIGHT LEFT, or leave out '
                                   '--yes')
        seen = []
        with _bench(job, UNHOOKED.format(SIGN_MOVE)) as (bench, _):
            for side, name in enumerate(SIDES):
                answer = 'again'
                while answer == 'again':
                    print(f'The {name} tendon moves ...', flush=True)
                    bench.move(_pair(side, SIGN_MOVE))
                    answer = ask(
                        f'Was the {name} tendon pulled, or let out? (pulled, let-out, again)',
                        one_of({a: a for a in (PULLED, LET_OUT, 'again')}))
                    bench.move(_pair(side, -SIGN_MOVE))
                seen.append(answer)
    signs = tuple(sign if answer == PULLED else -sign
                  for sign, answer in zip(job.values['grbl.signs'], seen, strict=True))
    _take(job, 'grbl.signs', signs)


def _steps(job: Job) -> None:
    """Compare commanded with measured travel."""
    distance = job.options.distance or 5.0
    travels = job.options.measured
    if travels is None:
        if job.options.yes:
            raise CalibrationError('travel must be measured: give --measured RIGHT LEFT, or leave '
                                   'out --yes')
        travels = []
        with _bench(job, f'{UNHOOKED.format(distance)} Have a caliper or ruler ready and a mark '
                    'on each tendon.') as (bench, _):
            for side, name in enumerate(SIDES):
                confirm(f'The {name} tendon: note where its mark is.', job.options.yes)
                print(f'The {name} tendon is pulled by {distance:g} mm ...', flush=True)
                bench.move(_pair(side, distance))
                travels.append(ask(
                    f'By how many mm was the {name} tendon really pulled?',
                    lambda text: _travel(text, distance)))
                bench.move(_pair(side, -distance))
    before = job.values['grbl.steps_per_mm']
    steps = tuple(corrected_steps(old, distance / MM, travel / MM)
                  for old, travel in zip(before, travels, strict=True))
    _take(job, 'grbl.steps_per_mm', steps)
    if job.values['tendon_driver'] == 'grbl' and steps != tuple(before):
        _forget_zero(job.values)
        print(f'Type these lines in a terminal on {job.values["grbl.port"]} (docs/rig.md); the '
              f'zero must then be set again:\n$100={steps[0]:.3f}\n$101={steps[1]:.3f}')
        if job.options.what == 'all':
            confirm('The lines were typed, and that terminal is closed.', job.options.yes)


def _travel(text: str, distance: float) -> float:
    travel = number(text, 0.01, 1000.0, 'mm')
    corrected_steps(1.0, distance / MM, travel / MM)
    return travel


def _take(job: Job, name: str, values: tuple[float, ...]) -> None:
    """Keep a result for the stepper controller, if the rig has one."""
    print(f'{name}: {as_list(values)} (right, left); it was {as_list(job.values[name])}')
    job.values[name] = values
    if job.values['tendon_driver'] == 'grbl':
        job.results[name] = values
    else:
        print(f'This is for a grbl controller and is not kept: tendon_driver is '
              f'{job.values["tendon_driver"]}.')


def _zero(job: Job) -> None:
    """Take up the slack of both tendons; then the straight arm is zero."""
    take_up = job.options.take_up
    if take_up is None and job.options.yes:
        raise CalibrationError('how much slack there is must be seen: give --take-up RIGHT LEFT '
                               '(0 0: both tendons are just taut), or leave out --yes')
    with _bench(job, 'The arm is straight and both tendons are hooked in, slack or just taut.',
                sets_zero=True) as (bench, tendons):
        if take_up is None:
            _jog(bench)
            confirm('Both tendons are just taut, and the arm is straight.', job.options.yes)
        else:
            bench.move((take_up[0] / MM, take_up[1] / MM))
        tendons.reference()
        sleep(MARK_TIME)
    print('The straight arm is zero.')
    tendons.open()  # as the node will
    try:
        kept = tendons.read().referenced
    finally:
        tendons.close()
    if kept:
        print('The controller keeps it: start the nodes.')
    else:
        print('The controller does not keep it, because opening its port resets it (docs/rig.md): '
              'start the nodes, and with the arm straight and both tendons just taut call '
              '/tendon_actuation/reference.')


def _jog(bench: TendonBench) -> None:
    print(f'Type r or l (right or left tendon) and by how many mm to pull, up to {LONGEST_JOG:g}; '
          'negative lets out.\nSuch as: r 0.5   l -0.2   Type done when both are just taut.')
    while True:
        motion = ask('r MM, l MM, or done:', _motion)
        if motion is None:
            return
        try:
            reading = bench.move(motion)
        except CalibrationError as error:
            print(error, flush=True)
            continue
        right, left = (MM * pull for pull in reading.pulls)
        print(f'right {right:.2f} mm, left {left:.2f} mm', flush=True)


def _motion(text: str) -> tuple[float, float] | None:
    """Return the distances (m) that a typed line asks for; None for the end."""
    if text == 'done':
        return None
    side, _, distance = text.partition(' ')
    if side not in ('r', 'l'):
        raise CalibrationError(f'{text!r} was typed; allowed: r MM, l MM, done')
    return _pair('rl'.index(side), number(distance, -LONGEST_JOG, LONGEST_JOG, 'mm'))


# Vacuum


def _vacuum(job: Job) -> None:
    """Evacuate, hold and vent one segment after the other."""
    leak_time = job.options.leak_time or 10.0
    settings = jamming_settings(job.values)
    segments = len(job.values['arm.segment_lengths'])
    confirm('One segment after the other is evacuated while all others are vented: the arm '
             'becomes soft. Support it, and let both tendons be slack. Afterwards the pump rests '
             f'and all segments are soft. This takes about {segments * (leak_time + 12):.0f} s. '
             'Ctrl-C stops.', job.options.yes)
    results: list[SegmentVacuum] = []
    with _jamming(job) as jamming:
        for segment in range(segments):
            print(f'segment {segment + 1} ...', flush=True)
            results.append(measure_segment(
                jamming, segment, segments, settings, job.values['soft_vacuum'], leak_time))
    problems = [judge(result, settings) for result in results]
    print(text_table(
        ['segment', 'to stiff s', 'reaches kPa', 'evacuates s', 'loses Pa/s', 'vents s', 'is'],
        [[str(r.segment + 1), *map(_cell, (r.time_to_stiff, r.ultimate_vacuum / 1e3,
                                           r.evacuation_time, r.leak_rate, r.venting_time)),
          'not good' if problem else 'good']
         for r, problem in zip(results, problems, strict=True)]))
    print('evacuates, vents: time constants.')
    for result, problem in zip(results, problems, strict=True):
        for text in problem:
            print(f'segment {result.segment + 1}: {text}')
    stiff = [r for r in results if isfinite(r.time_to_stiff)]
    job.bad += [f'segment {r.segment + 1} does not become stiff' for r in results
                if r not in stiff]
    if not stiff:
        return
    for name in ('ultimate_vacuum', 'evacuation_time', 'venting_time', 'leak_rate'):
        # The simulation has one number for all segments.
        job.results[f'simulated_jamming.{name}'] = fmean(getattr(r, name) for r in stiff)


def _cell(value: float) -> str:
    return f'{value:.4g}' if isfinite(value) else '-'


PROCEDURES: dict[str, Callable[[Job], None]] = {
    'vacuum': _vacuum, 'signs': _signs, 'steps': _steps, 'zero': _zero}


if __name__ == '__main__':
    sys.exit(main())
