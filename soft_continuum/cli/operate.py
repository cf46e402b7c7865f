# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What each command does with the arm, and how it says so."""

import argparse
from collections.abc import Callable
from dataclasses import asdict
import json
from math import degrees, isfinite
import sys
from time import sleep
from typing import Any, TYPE_CHECKING

if TYPE_CHECKING:
    from soft_continuum.client.arm import Arm
    from soft_continuum.client.state import ArmState, Pose, Progress

WATCH_PERIOD = 0.5  # s
WIND_DOWN = 60.0  # s that a canceled sequence may take to come to rest
BAR = 24  # characters
UNKNOWN = '?'


class Output:
    """Prints for people or, with ``--json``, one JSON document per line."""

    def __init__(self, command: str, as_json: bool) -> None:
        """``command``: for error messages."""
        self.as_json = as_json
        self._command = command
        self._bar = ''

    def say(self, text: str, **data: Any) -> None:
        """Print ``text``, or ``data`` as JSON."""
        self._end_bar()
        print(json.dumps(_plain(data)) if self.as_json else text, flush=True)

    def done(self, text: str = 'done') -> int:
        """Say that it is done; return the exit status."""
        self.say(text, result='done', message=text)
        return 0

    def fail(self, reason: str) -> None:
        """Say why it is not done."""
        self._end_bar()
        if self.as_json:
            print(json.dumps({'result': 'failed', 'message': reason}), flush=True)
        else:
            print(f'soft_continuum {self._command}: {reason}', file=sys.stderr, flush=True)

    def progress(self, now: 'Progress', before: 'Progress | None') -> None:
        """Show how far a sequence is: a bar on a terminal, else a line per phase."""
        if self.as_json:
            self.say('', **asdict(now))
            return
        segment = f'segment {now.segment}' if now.segment else 'whole arm'
        text = f'{100 * now.fraction:3.0f} %  {now.shape}, {segment}: {now.phase}'
        if sys.stdout.isatty():
            full = round(BAR * now.fraction)
            line = f'[{"#" * full}{"." * (BAR - full)}] {text}'
            print(f'\r{line:<{len(self._bar)}}', end='', flush=True)
            self._bar = line
        elif before is None or (now.shape_index, now.segment, now.phase) != (
                before.shape_index, before.segment, before.phase):
            print(text, flush=True)

    def _end_bar(self) -> None:
        if self._bar:
            print(flush=True)
            self._bar = ''


def shapes(arm: 'Arm', _: argparse.Namespace, output: Output) -> int:
    """List the shape library."""
    library = arm.shapes
    if output.as_json:
        output.say('', shapes=library)
    else:
        for name, values in library.items():
            print(f'{name:<20}{_degrees(values)}')
    return 0


def run(arm: 'Arm', options: argparse.Namespace, output: Output) -> int:
    """Set shapes; the first Ctrl-C cancels and waits for the arm to come to rest."""
    from soft_continuum.client.errors import SequenceError
    sequence = arm.start(*options.shapes, *options.angles, hold=options.hold)
    before: Progress | None = None
    interrupted = False
    try:
        try:
            for now in sequence.updates():
                output.progress(now, before)
                before = now
        except KeyboardInterrupt:
            interrupted = True
            if not output.as_json:
                output.say('canceling; Ctrl-C again leaves at once')
            sequence.cancel()
        result = sequence.result(WIND_DOWN)
        output.say('done', **{'result': 'done', **asdict(result)})
        return 0
    except SequenceError as error:
        if output.as_json:
            output.say('', **{'result': 'failed', **asdict(error.result)})
        else:
            output.fail(str(error))
        return 130 if interrupted else 1


def stiffen(arm: 'Arm', options: argparse.Namespace, output: Output) -> int:
    """Make a segment stiff, or all."""
    arm.stiffen(options.segment)
    return output.done(f'segment {options.segment} is stiff' if options.segment
                       else 'all segments are stiff')


def soften(arm: 'Arm', options: argparse.Namespace, output: Output) -> int:
    """Make a segment soft."""
    arm.soften(options.segment)
    return output.done(f'segment {options.segment} is soft')


def jog(arm: 'Arm', options: argparse.Namespace, output: Output) -> int:
    """Move the tendons."""
    arm.jog(right=options.right * 1e-3, left=options.left * 1e-3)
    return output.done(f'pulls: {_millimetres(arm.state)}')


def status(arm: 'Arm', _: argparse.Namespace, output: Output) -> int:
    """Show all that is known."""
    state = arm.state
    output.say(_page(state), **asdict(state))
    return 0


def watch(arm: 'Arm', _: argparse.Namespace, output: Output) -> int:
    """Show a line twice per second, until Ctrl-C."""
    try:
        while True:
            state = arm.state
            output.say(_line(state), **asdict(state))
            sleep(WATCH_PERIOD)
    except KeyboardInterrupt:
        return 0


def completion(arm: 'Arm', _: argparse.Namespace, __: Output) -> int:
    """Print the names of the shapes, for the completion script."""
    print('\n'.join(arm.shapes))
    return 0


def _trigger(name: str) -> Callable[['Arm', argparse.Namespace, Output], int]:
    def call(arm: 'Arm', _: argparse.Namespace, output: Output) -> int:
        return output.done(getattr(arm, name)())
    return call


COMMANDS: dict[str, Callable[['Arm', argparse.Namespace, Output], int]] = {
    'shapes': shapes, 'run': run, 'stiffen': stiffen, 'soften': soften, 'jog': jog,
    'status': status, 'watch': watch, 'completion': completion,
    **{name: _trigger(name) for name in ('stop', 'resume', 'reference', 'reset')},
}


# How a state reads.

def _plain(value: Any) -> Any:
    """Return a value as JSON has it: not a number becomes null."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not isfinite(value) else value


def _degrees(values: 'tuple[float, ...]') -> str:
    return ' '.join(f'{degrees(v):+6.1f}' for v in values) + ' deg'


def _millimetres(state: 'ArmState') -> str:
    """Return the pulls of all tendons."""
    return UNKNOWN if state.pulls is None else ', '.join(
        f'{name} {pull * 1e3:+.2f} mm'
        for name, pull in zip(state.tendons, state.pulls, strict=True))


def _place(pose: 'Pose | None') -> str:
    return UNKNOWN if pose is None else (
        f'x {pose.x * 1e3:+7.1f} mm, z {pose.z * 1e3:+7.1f} mm, {degrees(pose.angle):+6.1f} deg')


def _stiffness(stiff: bool | None) -> str:
    return UNKNOWN if stiff is None else 'stiff' if stiff else 'soft'


def _line(state: 'ArmState') -> str:
    """Return a state in a line."""
    return ' | '.join((
        _millimetres(state),
        ' '.join(_stiffness(s) for s in state.stiff),
        _degrees(state.bending_angles) if state.bending_angles else UNKNOWN,
        state.node('shape_sequencer').message or UNKNOWN))


def _page(state: 'ArmState') -> str:
    """Return a state in full."""
    lines = [f'tendons    {_millimetres(state)}']
    for label, tensions in (('by the model', state.tensions),
                            ('measured', state.measured_tensions)):
        if tensions and all(map(isfinite, tensions)):
            each = ', '.join(f'{name} {tension:.1f} N'
                             for name, tension in zip(state.tendons, tensions, strict=True))
            lines.append(f'tensions   {each} ({label})')
    for i, (stiff, pressure) in enumerate(zip(state.stiff, state.pressures, strict=True)):
        kilopascals = UNKNOWN if pressure is None else f'{pressure * 1e-3:.1f}'
        pose = state.segment_poses[i] if state.segment_poses else None
        lines.append(f'segment {i + 1}  {_stiffness(stiff):<6}{kilopascals:>6} kPa  '
                     f'end at {_place(pose)}')
    lines.append(f'tip        {_place(state.tip)}')
    for node in state.nodes:
        age = '' if node.age is None else f' ({node.age:.1f} s ago)'
        said = f'{node.level or UNKNOWN}: {node.message}{age}' if node.running else 'does not run'
        lines.append(f'{node.name:<18}{said}')
    return '\n'.join(lines)
