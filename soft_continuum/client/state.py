# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The state of the arm for clients, as frozen values in SI units, and its text."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from math import atan2, copysign, degrees, dist, hypot, isfinite, nan
from typing import Any

from soft_continuum.client.estimate import (
    age_text,
    anomaly_text,
    Estimate,
    millimetres,
    parameter_text,
    position_stddev,
)
from soft_continuum.sequencing import AIMS, Phase, Progress
from soft_continuum.text import MAX_NAME, printable

__all__ = ['ArmState', 'NodeReport', 'Pose', 'Progress', 'Reached', 'SequenceResult']

IN_PLANE = 1e-6  # m, or part of a quaternion: rounding error out of the bending plane
UNKNOWN = '?'
MAX_ERROR = 1e3  # rad or m that a shape may be off; also not what is not a number


@dataclass(frozen=True)
class Pose:
    """A pose in ``base_link``: position (x, y, z) in m, orientation (x, y, z, w)."""

    position: tuple[float, float, float]
    orientation: tuple[float, float, float, float]

    @property
    def x(self) -> float:
        """Position along x, m."""
        return self.position[0]

    @property
    def z(self) -> float:
        """Position along z, m."""
        return self.position[2]

    @property
    def angle(self) -> float:
        """Rotation about +y of a pose in the bending plane, rad."""
        return 2.0 * atan2(self.orientation[1], self.orientation[3])

    @property
    def is_planar(self) -> bool:
        """Whether it is in the bending plane of planar arms, or unknown."""
        about_x, _, about_z, _ = self.orientation
        return not max(abs(self.position[1]), abs(about_x), abs(about_z)) > IN_PLANE

    @property
    def tilt(self) -> float:
        """Angle between z of its frame and that of base_link, rad."""
        x, y, z, w = self.orientation
        return 2.0 * atan2(hypot(x, y), hypot(z, w))


def pose_of(message: Any) -> Pose:
    """Return a geometry_msgs/Pose."""
    p, q = message.position, message.orientation
    return Pose((p.x, p.y, p.z), (q.x, q.y, q.z, q.w))


@dataclass(frozen=True)
class NodeReport:
    """
    The status of one node.

    level: 'ok', 'warn' or 'error'; None if none was received.  message and values: its
    ``~/status`` (msg_docs/README.md).  age: s since its last message on any topic, None if there
    was none.  stale: whether that is longer than any regular pause.
    """

    name: str
    running: bool
    level: str | None
    message: str
    values: Mapping[str, str]
    age: float | None
    stale: bool


@dataclass(frozen=True, kw_only=True)
class ArmState:
    """
    A snapshot of the arm; None where a value was not received, or is stale.

    tendons: names, in the order of pulls (m), speeds (m/s), tensions (N, from the model, nan where
    not determined) and measured_tensions (N, from load cells or the driver, nan without readings).
    stopped: why nothing moves until a resume, '' when motion is allowed.  emergency_stop: whether
    it is on, so that resuming and switching are refused.  referenced: whether pulls are known
    relative to the straight arm. stiff: of each segment, base first, as confirmed by its pressure.
    pressures: Pa, absolute. set_vacuums: set-point of each segment's regulator, Pa below ambient;
    empty for valves. bending_angles: rad, one per segment; never negative for spatial arms.
    bending_directions: of a spatial arm, rad, one per segment, about +z from +x of the disc below
    it; empty for planar arms.  joint_angles: rad, all joints of the URDF. segment_poses: distal
    end of each segment.  disc_poses: bottom and top of each disc. tip: top of the last disc.
    measured_discs: measured bottom of each disc, empty without measurements; nan where position or
    orientation is not measured.  predicted_disc_poses: as disc_poses, open-loop prediction, while
    the shape is estimated.  estimate: source and accuracy of the shape, estimated parameters, and
    anomalies.  progress: of the running sequence of any client.  last_result: of the last
    sequence.  nodes: those that this arm needs.  sensors: the sensor nodes, if received.
    """

    tendons: tuple[str, ...]
    pulls: tuple[float, ...] | None = None
    speeds: tuple[float, ...] | None = None
    tensions: tuple[float, ...] | None = None
    measured_tensions: tuple[float, ...] | None = None
    stopped: str | None
    emergency_stop: bool | None = None
    referenced: bool | None = None
    stiff: tuple[bool | None, ...]
    pressures: tuple[float | None, ...]
    set_vacuums: tuple[float, ...] = ()
    bending_angles: tuple[float, ...] | None
    bending_directions: tuple[float, ...] = ()
    joint_angles: tuple[float, ...] | None = None
    segment_poses: tuple[Pose, ...] | None = None
    disc_poses: tuple[Pose, ...] | None = None
    tip: Pose | None
    measured_discs: tuple[Pose | None, ...] = ()
    predicted_disc_poses: tuple[Pose, ...] | None = None
    estimate: Estimate | None = None
    progress: Progress | None
    last_result: 'SequenceResult | None'
    nodes: tuple[NodeReport, ...]
    sensors: tuple[NodeReport, ...] = ()

    @property
    def disc_errors(self) -> tuple[tuple[float, float] | None, ...]:
        """
        Distance of each measured disc from the model, m and rad; None if unknown.

        Angles about y, as in the plane, are signed.  nan where position or orientation is not
        measured.
        """
        return tuple(
            None if seen is None or not self.disc_poses or 2 * n >= len(self.disc_poses)
            else _apart(seen, self.disc_poses[2 * n])
            for n, seen in enumerate(self.measured_discs))

    def __str__(self) -> str:
        """Return the full state as text."""
        return state_page(self)

    def _repr_html_(self) -> str:
        """Return HTML for notebooks."""
        return f'<pre>{escape(str(self))}</pre>'

    def node(self, name: str) -> NodeReport:
        """Return the report of one of ``nodes``; raises KeyError for another name."""
        for report in self.nodes:
            if report.name == name:
                return report
        raise KeyError(f'{name}; the nodes are {", ".join(n.name for n in self.nodes)}')


def _apart(one: Pose, other: Pose) -> tuple[float, float]:
    """Return distance and angle between two poses, m and rad; angles about y are signed."""
    x, y, z, w = one.orientation
    a, b, c, d = other.orientation
    about = (d * x - a * w - b * z + c * y, d * y - b * w - c * x + a * z,
             d * z - c * w - a * y + b * x)
    same = x * a + y * b + z * c + w * d
    angle = 2.0 * atan2(hypot(*about), abs(same))
    if about[0] == about[2] == 0.0:
        angle = copysign(angle, about[1] * same)
    return dist(one.position, other.position), angle


def progress_of(report: Any, fraction: float, feedback: Any = None) -> Progress:
    """
    Return the progress from feedback or a state of the sequencer, clipped.

    feedback: has aim, correction and error, unless none was received for this goal.
    """
    try:
        phase = Phase(report.phase)
    except ValueError:
        phase = Phase.PREPARING
    correction, error, aim = 0, None, ''
    if feedback is not None:
        correction, error = feedback.correction, feedback.error
        aim = AIMS[feedback.aim] if feedback.aim < len(AIMS) else ''
    return Progress(report.shape_index, printable(report.shape, MAX_NAME), report.segment, phase,
                    fraction if 0.0 <= fraction <= 1.0 else 0.0,
                    correction,
                    error if error is not None and abs(error) < MAX_ERROR else None, aim)


@dataclass(frozen=True)
class Reached:
    """
    The end state of the last shape of a sequence.

    measured: whether it is measured; otherwise it is predicted from motors and vacuum.
    bending_angles: rad, one per segment.  tip: its pose.  angle_stddevs, tip_covariance: as in
    Estimate.  tip_error: m from the tip to its goal. corrections: of all segments of all shapes.
    bending_directions: rad, one per segment of a spatial arm, else empty.  replans: number of
    times it was planned again.
    """

    measured: bool
    bending_angles: tuple[float, ...]
    tip: Pose
    angle_stddevs: tuple[float, ...]
    tip_covariance: tuple[float, ...]
    tip_error: float
    corrections: int
    bending_directions: tuple[float, ...] = ()
    replans: int = 0

    @property
    def lost(self) -> bool:
        """Whether it is predicted although there were measurements earlier in this sequence."""
        return not self.measured and bool(self.angle_stddevs)


@dataclass(frozen=True)
class SequenceResult:
    """
    The result of a sequence.

    outcome: name of the error_code, SUCCESSFUL or another one of msg_docs/shape_sequencer.md.
    message: the problem; on success the shortfall of the last shape, or empty.  reached: the end
    state of the last shape, None if not reported.
    """

    outcome: str
    message: str
    shapes_completed: int
    reached: Reached | None = None


# Texts.


def angles_text(angles: Sequence[float], directions: Sequence[float] = ()) -> str:
    """
    Return bending angles (rad), and directions behind an @, in degrees.

    Straight segments are shown without direction, which would be rounding noise.
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
    source = UNKNOWN if estimate is None else 'estimated' if estimate.fresh else 'predicted'
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
        if i < len(state.stiff):  # without jamming nothing is switched
            pressure = state.pressures[i]
            kilopascals = UNKNOWN if pressure is None else f'{pressure * 1e-3:.1f}'
            jam = f'{_stiffness_text(state.stiff[i]):<6}{kilopascals:>6} kPa  '
        lines.append(f'segment {i + 1}  {jam}end at {_model_pose_text(pose)}')
    lines.append(f'tip        {_model_pose_text(state.tip)}')
    for n, (seen, error) in enumerate(zip(state.measured_discs, state.disc_errors, strict=True)):
        away, turned = (nan, nan) if error is None else error
        apart = (f', {away * 1e3:.1f} mm from the model' if isfinite(away) else
                 f', {degrees(turned):+.1f} deg from the model' if isfinite(turned) else '')
        lines.append(f'disc {n}     seen at {_model_pose_text(seen)}{apart}')
    lines += estimate_lines(state.estimate)
    for node in (*state.nodes, *state.sensors):
        age = '' if node.age is None else f' ({node.age:.1f} s ago)'
        status = (f'{node.level or UNKNOWN}: {node.message}{age}' if node.running
                  else 'does not run')
        lines.append(f'{node.name:<18}{status}')
    return '\n'.join(lines)


def source_text(estimate: Estimate) -> str:
    """Return the source of the shape in one line."""
    age = age_text(estimate.age)
    if not estimate.measured:
        return f'predicted by the model; {age}'
    parts = [] if estimate.age is None else [age]
    if estimate.tip_stddev is not None:
        parts.append(f'tip +-{millimetres(estimate.tip_stddev)} mm')
    if estimate.angle_stddevs and all(map(isfinite, estimate.angle_stddevs)):
        parts.append(f'angles +-{degrees(max(estimate.angle_stddevs)):.1f} deg')
    source = 'measured tensions' if estimate.age is None else 'measurements'
    return '; '.join(filter(None, (
        f'estimated from {source}' if estimate.fresh else 'predicted since it was last measured',
        ', '.join(parts))))


def estimate_lines(estimate: Estimate | None) -> list[str]:
    """Return the lines of an estimate; parts without content have no line."""
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
    """Return the end state of a sequence, and its source, in one line."""
    error = f'tip {millimetres(reached.tip_error)} mm from its aim'
    directions = reached.bending_directions
    angles = angles_text(reached.bending_angles, directions)
    again = f', planned again {reached.replans} times' if reached.replans else ''
    stddev = position_stddev(reached.tip_covariance)
    within = '' if stddev is None else f', +-{millimetres(stddev)} mm'
    if reached.lost:
        return (f'predicted since measurements ended: {error} (by the model{within}), angles'
                f'{angles}'.replace('  ', ' ') + again)
    if not reached.measured:
        return ('predicted: nothing was measured; '
                + (f'angles{angles}'.replace('  ', ' ')
                   if not isfinite(reached.tip_error)
                   else f'{error} by the model') + again)
    many = 'correction' if reached.corrections == 1 else 'corrections'
    return (f'reached: {error} (measured{within}), angles{angles}, {reached.corrections} {many}'
            .replace('  ', ' ') + again)


def progress_text(now: Progress) -> str:
    """Return what a sequence does with which segment, and the measured error of the shape."""
    text = f'{f"segment {now.segment}" if now.segment else "whole arm"}: {now.phase}'
    if now.correction:
        text += f', correction {now.correction}'
    if now.error is None:
        return text
    error = (f'{millimetres(now.error)} mm' if now.aim == 'tip' else
             f'{degrees(now.error):.2f} deg' if now.aim else f'{now.error:.2g} m or rad')
    return f'{text}, {error} off, measured'
