# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What the verbs on a running arm print: text for people, or JSON."""

from collections.abc import Sequence
from dataclasses import asdict
import json
from math import degrees, isfinite
import sys
from typing import Any, TYPE_CHECKING

from soft_continuum.arguments import DONE, FAILED, Parser

if TYPE_CHECKING:
    from soft_continuum.client.state import ArmState, Pose, Progress

BAR_LENGTH = 24  # characters
UNKNOWN = '?'


class Output:
    """Prints for people or, with ``--json``, one JSON document per line."""

    def __init__(self, parser: Parser, as_json: bool) -> None:
        """parser: reports failures to people."""
        self.as_json = as_json
        self._parser = parser
        self._bar = ''

    def print(self, text: str, **data: Any) -> None:
        """Print ``text``, or ``data`` as JSON."""
        self._end_bar()
        print(json.dumps(_plain(data)) if self.as_json else text, flush=True)

    def done(self, text: str = 'done') -> int:
        """Report success; return the exit status."""
        self.print(text, result='done', message=text)
        return DONE

    def fail(self, reason: object, status: int = FAILED) -> int:
        """Report failure; return the exit status."""
        if self.as_json:
            self.print('', result='failed', message=str(reason))
            return status
        self._end_bar()
        return self._parser.fail(reason, status)

    def progress(self, now: 'Progress', before: 'Progress | None') -> None:
        """Show how far a sequence is: a bar on a terminal, else a line per phase."""
        if self.as_json:
            self.print('', **asdict(now))
            return
        segment = f'segment {now.segment}' if now.segment else 'whole arm'
        text = f'{100 * now.fraction:3.0f} %  {now.shape}, {segment}: {now.phase}'
        if sys.stdout.isatty():
            full = round(BAR_LENGTH * now.fraction)
            line = f'[{"#" * full}{"." * (BAR_LENGTH - full)}] {text}'
            print(f'\r{line:<{len(self._bar)}}', end='', flush=True)
            self._bar = line
        elif before is None or (now.shape_index, now.segment, now.phase) != (
                before.shape_index, before.segment, before.phase):
            print(text, flush=True)

    def _end_bar(self) -> None:
        if self._bar:
            print(flush=True)
            self._bar = ''


def _plain(value: Any) -> Any:
    """Return a value as JSON has it: not a number becomes null."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not isfinite(value) else value


# How a state reads.


def angles_text(angles: Sequence[float]) -> str:
    """Return bending angles (rad) in degrees."""
    return ' '.join(f'{degrees(angle):+6.1f}' for angle in angles) + ' deg'


def pulls_text(state: 'ArmState') -> str:
    """Return the pull of every tendon in mm."""
    return UNKNOWN if state.pulls is None else _by_tendon(state, state.pulls, 1e3, '+.2f', 'mm')


def _by_tendon(state: 'ArmState', values: Sequence[float], scale: float, digits: str, unit: str
               ) -> str:
    return ', '.join(f'{name} {scale * value:{digits}} {unit}'
                     for name, value in zip(state.tendons, values, strict=True))


def _pose_text(pose: 'Pose | None') -> str:
    return UNKNOWN if pose is None else (
        f'x {pose.x * 1e3:+7.1f} mm, z {pose.z * 1e3:+7.1f} mm, {degrees(pose.angle):+6.1f} deg')


def _stiffness_text(stiff: bool | None) -> str:
    return UNKNOWN if stiff is None else 'stiff' if stiff else 'soft'


def state_line(state: 'ArmState') -> str:
    """Return a state in one line."""
    return ' | '.join((
        pulls_text(state),
        ' '.join(_stiffness_text(s) for s in state.stiff),
        angles_text(state.bending_angles) if state.bending_angles else UNKNOWN,
        state.node('shape_sequencer').message or UNKNOWN))


def state_page(state: 'ArmState') -> str:
    """Return a state in full."""
    lines = [f'tendons    {pulls_text(state)}']
    for source, tensions in (('by the model', state.tensions),
                             ('measured', state.measured_tensions)):
        if tensions and all(map(isfinite, tensions)):
            lines.append(f'tensions   {_by_tendon(state, tensions, 1.0, ".1f", "N")} ({source})')
    for i, (stiff, pressure) in enumerate(zip(state.stiff, state.pressures, strict=True)):
        kilopascals = UNKNOWN if pressure is None else f'{pressure * 1e-3:.1f}'
        pose = state.segment_poses[i] if state.segment_poses else None
        lines.append(f'segment {i + 1}  {_stiffness_text(stiff):<6}{kilopascals:>6} kPa  '
                     f'end at {_pose_text(pose)}')
    lines.append(f'tip        {_pose_text(state.tip)}')
    for node in state.nodes:
        age = '' if node.age is None else f' ({node.age:.1f} s ago)'
        status = (f'{node.level or UNKNOWN}: {node.message}{age}' if node.running
                  else 'does not run')
        lines.append(f'{node.name:<18}{status}')
    return '\n'.join(lines)
