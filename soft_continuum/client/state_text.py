# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""How a state of the arm reads."""

from collections.abc import Sequence
from math import degrees, isfinite

from soft_continuum.client.state import ArmState, Pose

UNKNOWN = '?'


def angles_text(angles: Sequence[float]) -> str:
    """Return bending angles (rad) in degrees."""
    return ' '.join(f'{degrees(angle):+6.1f}' for angle in angles) + ' deg'


def pulls_text(state: ArmState) -> str:
    """Return the pull of every tendon in mm."""
    return UNKNOWN if state.pulls is None else _by_tendon(state, state.pulls, 1e3, '+.2f', 'mm')


def _by_tendon(state: ArmState, values: Sequence[float], scale: float, digits: str, unit: str
               ) -> str:
    return ', '.join(f'{name} {scale * value:{digits}} {unit}'
                     for name, value in zip(state.tendons, values, strict=True))


def _pose_text(pose: Pose | None) -> str:
    return UNKNOWN if pose is None else (
        f'x {pose.x * 1e3:+7.1f} mm, z {pose.z * 1e3:+7.1f} mm, {degrees(pose.angle):+6.1f} deg')


def _stiffness_text(stiff: bool | None) -> str:
    return UNKNOWN if stiff is None else 'stiff' if stiff else 'soft'


def state_line(state: ArmState) -> str:
    """Return a state in one line."""
    return ' | '.join((
        pulls_text(state),
        ' '.join(_stiffness_text(s) for s in state.stiff),
        angles_text(state.bending_angles) if state.bending_angles else UNKNOWN,
        state.node('shape_sequencer').message or UNKNOWN))


def state_page(state: ArmState) -> str:
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
    for n, (seen, error) in enumerate(zip(state.measured_discs, state.disc_errors, strict=True)):
        apart = '' if error is None else f', {error[0] * 1e3:.1f} mm from the model'
        lines.append(f'disc {n}     seen at {_pose_text(seen)}{apart}')
    for node in state.nodes:
        age = '' if node.age is None else f' ({node.age:.1f} s ago)'
        status = (f'{node.level or UNKNOWN}: {node.message}{age}' if node.running
                  else 'does not run')
        lines.append(f'{node.name:<18}{status}')
    return '\n'.join(lines)
