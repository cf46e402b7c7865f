# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""How a state of the arm reads."""

from collections.abc import Sequence
from math import degrees, isfinite

from soft_continuum.client.estimate import (
    age_text,
    anomaly_text,
    Estimate,
    millimetres,
    parameter_text,
    position_deviation,
)
from soft_continuum.client.state import ArmState, Pose, Reached

UNKNOWN = '?'


def angles_text(angles: Sequence[float], directions: Sequence[float] = ()) -> str:
    """
    Return bending angles (rad), and directions behind an @, in degrees.

    What is shown as straight is shown without its direction, which is that of its rounding.
    """
    towards = [f'@{degrees(direction):z.1f}' if abs(degrees(angle)) >= 0.05 else ''
               for angle, direction in zip(angles, directions, strict=True)
               ] if directions else [''] * len(angles)
    return ' '.join(f'{degrees(angle):+z6.1f}{direction}' for angle, direction in zip(
        angles, towards, strict=True)) + ' deg'


def pulls_text(state: ArmState) -> str:
    """Return the pull of every tendon in mm."""
    return UNKNOWN if state.pulls is None else _by_tendon(state, state.pulls, 1e3, '+z.2f', 'mm')


def _by_tendon(state: ArmState, values: Sequence[float], scale: float, digits: str, unit: str
               ) -> str:
    return ', '.join(f'{name} {scale * value:{digits}} {unit}' if isfinite(value) else f'{name} ?'
                     for name, value in zip(state.tendons, values, strict=True))


def _pose_text(pose: Pose | None) -> str:
    if pose is None:
        return UNKNOWN
    where = (f'x {pose.x * 1e3:+z7.1f} mm, z {pose.z * 1e3:+z7.1f} mm'
             if isfinite(pose.x) and isfinite(pose.z) else 'position not measured')
    return (f'{where}, {degrees(pose.angle):+z6.1f} deg' if isfinite(pose.angle)
            else f'{where}, angle not measured')


def _model_pose_text(pose: Pose | None) -> str:
    """Return a pose: in the plane of planar arms by x, z and angle."""
    if pose is None or pose.is_planar or not all(map(isfinite, pose.position)):
        return _pose_text(pose)
    x, y, z = (f'{1e3 * part:+z7.1f}' for part in pose.position)
    tilt = (f'{degrees(pose.tilt):6.1f} deg from the z axis' if isfinite(pose.tilt)
            else 'angle not measured')
    return f'x {x} mm, y {y} mm, z {z} mm, {tilt}'


def _stiffness_text(stiff: bool | None) -> str:
    return UNKNOWN if stiff is None else 'stiff' if stiff else 'soft'


def state_line(state: ArmState) -> str:
    """Return a state in one line."""
    estimate = state.estimate
    source = UNKNOWN if estimate is None else 'estimated' if estimate.measured else 'predicted'
    alarms = ', '.join(anomaly.cause for anomaly in estimate.anomalies) if estimate else ''
    return ' | '.join((
        pulls_text(state),
        ' '.join(_stiffness_text(s) for s in state.stiff),
        angles_text(state.bending_angles, state.bending_directions)
        if state.bending_angles else UNKNOWN,
        f'{source}{f", ALARM: {alarms}" if alarms else ""}',
        state.node('shape_sequencer').message or UNKNOWN))


def state_page(state: ArmState) -> str:
    """Return a state in full."""
    lines = [f'tendons    {pulls_text(state)}']
    for source, tensions in (('by the model', state.tensions),
                             ('measured', state.measured_tensions)):
        if tensions and (source == 'measured' or all(map(isfinite, tensions))):
            lines.append(f'tensions   {_by_tendon(state, tensions, 1.0, "z.1f", "N")} ({source})')
    poses = state.segment_poses or (None,) * len(state.stiff)
    for i, pose in enumerate(poses):
        jam = ''
        if i < len(state.stiff):  # of an arm without jamming nothing is switched
            pressure = state.pressures[i]
            kilopascals = UNKNOWN if pressure is None else f'{pressure * 1e-3:.1f}'
            jam = f'{_stiffness_text(state.stiff[i]):<6}{kilopascals:>6} kPa  '
        lines.append(f'segment {i + 1}  {jam}end at {_model_pose_text(pose)}')
    lines.append(f'tip        {_model_pose_text(state.tip)}')
    for n, (seen, error) in enumerate(zip(state.measured_discs, state.disc_errors, strict=True)):
        apart = ('' if error is None else f', {error[0] * 1e3:.1f} mm from the model'
                 if isfinite(error[0]) else f', {degrees(error[1]):+.1f} deg from the model')
        lines.append(f'disc {n}     seen at {_model_pose_text(seen)}{apart}')
    lines += estimate_lines(state.estimate)
    for node in (*state.nodes, *state.sensors):
        age = '' if node.age is None else f' ({node.age:.1f} s ago)'
        status = (f'{node.level or UNKNOWN}: {node.message}{age}' if node.running
                  else 'does not run')
        lines.append(f'{node.name:<18}{status}')
    return '\n'.join(lines)


def source_text(estimate: Estimate) -> str:
    """Return where the shape comes from, in one line."""
    age = age_text(estimate.age)
    if not estimate.measured:
        return f'predicted by the model; {age}'
    parts = [] if estimate.age is None else [age]
    if estimate.tip_deviation is not None:
        parts.append(f'tip +-{millimetres(estimate.tip_deviation)} mm')
    if estimate.angle_deviations and all(map(isfinite, estimate.angle_deviations)):
        parts.append(f'angles +-{degrees(max(estimate.angle_deviations)):.1f} deg')
    source = 'measured tensions' if estimate.age is None else 'measurements'
    return '; '.join(filter(None, (f'estimated from {source}', ', '.join(parts))))


def estimate_lines(estimate: Estimate | None) -> list[str]:
    """Return what measurements say of the arm; no line for what there is nothing to say of."""
    if estimate is None:
        return []
    lines = [f'shape      {source_text(estimate)}']
    if estimate.measured and estimate.predicted_tip_error is not None:
        lines.append(f'prediction has the tip {millimetres(estimate.predicted_tip_error)} mm '
                     'from there')
    for parameter in estimate.parameters:
        if parameter.determined or parameter.problem:
            text = parameter_text(parameter)
            known = '' if parameter.determined else ', not determined'
            problem = f'; not plausible: {parameter.problem}' if parameter.problem else ''
            lines.append(f'learned    {text.label}: {text.amount()}{known}{problem}')
    return lines + [f'ALARM      {anomaly_text(anomaly)}' for anomaly in estimate.anomalies]


def reached_text(reached: Reached) -> str:
    """Return where a sequence ended, and how that is known, in one line."""
    error = f'tip {millimetres(reached.tip_error)} mm from its aim'
    directions = reached.bending_directions
    angles = angles_text(reached.bending_angles, directions)
    again = f', planned again {reached.replans} times' if reached.replans else ''
    if not reached.measured:
        return ('predicted: nothing was measured; '
                + (f'angles{angles}'.replace('  ', ' ')
                   if not isfinite(reached.tip_error)
                   else f'{error} by the model') + again)
    deviation = position_deviation(reached.tip_covariance)
    within = '' if deviation is None else f', +-{millimetres(deviation)} mm'
    many = 'correction' if reached.corrections == 1 else 'corrections'
    return (f'reached: {error} (measured{within}), angles{angles}, {reached.corrections} {many}'
            .replace('  ', ' ') + again)


def error_text(error: float, aim: str) -> str:
    """Return the error of a shape that is being set, in the unit of its aim ('': not known)."""
    if aim == 'tip':
        return f'{millimetres(error)} mm'
    return f'{degrees(error):.2f} deg' if aim else f'{error:.2g} m or rad'
