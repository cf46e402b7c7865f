# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The state of the arm as a client sees it, as frozen values in SI units."""

from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from math import atan2, copysign, dist, hypot
from typing import Any

from soft_continuum.client.estimate import Estimate
from soft_continuum.sequencing.progress import AIMS, Phase, Progress
from soft_continuum.text import MAX_NAME, printable

__all__ = ['ArmState', 'NodeReport', 'Pose', 'Progress', 'Reached', 'SequenceResult']

IN_PLANE = 1e-6  # m, or part of a quaternion: what rounding takes out of the bending plane
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
        """Whether it is in the bending plane of planar arms, or not known."""
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
    ``~/status``, for people (msg_docs/README.md).  age: s since its last message on any topic,
    None if there was none.  stale: whether that is longer than the nodes ever pause.
    """

    name: str
    running: bool
    level: str | None
    message: str
    values: Mapping[str, str]
    age: float | None
    stale: bool


@dataclass(frozen=True)
class ArmState:
    """
    The arm at one moment; None where a value was not received, or is stale.

    tendons: names, in the order of pulls (m), speeds (m/s), tensions (N, by the model, nan where
    nothing determines them) and measured_tensions (N, of load cells or a driver that measures, nan
    of a silent cell).  stopped:
    why nothing moves before a resume, '' when motion is allowed.  emergency_stop: whether it is
    on, so that resuming and switching are refused.  referenced: whether pulls are known relative
    to the straight arm.
    stiff: of each segment, base first, as confirmed by its pressure.  pressures: Pa, absolute.
    set_vacuums: what the regulator of each segment is set to, Pa below ambient; empty of valves.
    bending_angles: rad, one per segment; of a spatial arm never negative.  bending_directions: of
    a spatial arm, rad, one per segment: towards where it leans, about +z from +x of the disc below
    it; empty of a planar one.  joint_angles: rad, all joints of the URDF.
    segment_poses: distal end of each segment.  disc_poses: bottom and top of each disc.  tip: top
    of the last disc.  measured_discs: bottom of each disc as a sensor sees it, empty while none
    does; nan where the sensor measures no position, or no orientation.  predicted_disc_poses: as
    disc_poses, where the model alone has them, while the shape is estimated.  estimate: whether
    the shape is measured, how well it is known, what was learned, and what is wrong.  progress: of
    the sequence that runs, whoever started it.  last_result: of the one that ended last.  nodes:
    those that this arm needs.  sensors: the nodes that look at the arm, as far as they were heard.
    """

    tendons: tuple[str, ...]
    pulls: tuple[float, ...] | None
    speeds: tuple[float, ...] | None
    tensions: tuple[float, ...] | None
    measured_tensions: tuple[float, ...] | None
    stopped: str | None
    emergency_stop: bool | None
    referenced: bool | None
    stiff: tuple[bool | None, ...]
    pressures: tuple[float | None, ...]
    bending_angles: tuple[float, ...] | None
    joint_angles: tuple[float, ...] | None
    segment_poses: tuple[Pose, ...] | None
    disc_poses: tuple[Pose, ...] | None
    tip: Pose | None
    progress: Progress | None
    last_result: 'SequenceResult | None'
    nodes: tuple[NodeReport, ...]
    measured_discs: tuple[Pose | None, ...] = ()
    sensors: tuple[NodeReport, ...] = ()
    predicted_disc_poses: tuple[Pose, ...] | None = None
    estimate: Estimate | None = None
    bending_directions: tuple[float, ...] = ()
    set_vacuums: tuple[float, ...] = ()

    @property
    def disc_errors(self) -> tuple[tuple[float, float] | None, ...]:
        """
        How far each disc is seen from where the model has it, m and rad; None if unknown.

        The angle has a sign where it is about y, as in the plane.  nan where the position, or the
        orientation, is not measured.
        """
        return tuple(
            None if seen is None or not self.disc_poses or 2 * n >= len(self.disc_poses)
            else _apart(seen, self.disc_poses[2 * n])
            for n, seen in enumerate(self.measured_discs))

    def __str__(self) -> str:
        """Return the state in full, for people."""
        from soft_continuum.client.state_text import state_page
        return state_page(self)

    def _repr_html_(self) -> str:
        """Return what a notebook shows."""
        return f'<pre>{escape(str(self))}</pre>'

    def node(self, name: str) -> NodeReport:
        """Return the report of one of ``nodes``; raises KeyError for another name."""
        for report in self.nodes:
            if report.name == name:
                return report
        raise KeyError(f'{name}; the nodes are {", ".join(n.name for n in self.nodes)}')


def _apart(one: Pose, other: Pose) -> tuple[float, float]:
    """Return distance and angle between two poses, m and rad; about y alone it has a sign."""
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
    Return the progress that a feedback or a state of the sequencer reports, within bounds.

    feedback: has aim, correction and error, unless there was none of this goal.
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
    Where the last shape of a sequence ended.

    measured: whether measurements say so; else it is what the model has of motors and vacuum.
    bending_angles: rad, one per segment.  tip: its pose.  angle_deviations, tip_covariance: as of
    an Estimate.  tip_error: m from where the aim has the tip.  corrections: of all segments of all
    shapes.  bending_directions: rad, one per segment of a spatial arm, else empty.  replans: plans
    that were made again on the way.
    """

    measured: bool
    bending_angles: tuple[float, ...]
    tip: Pose
    angle_deviations: tuple[float, ...]
    tip_covariance: tuple[float, ...]
    tip_error: float
    corrections: int
    bending_directions: tuple[float, ...] = ()
    replans: int = 0


@dataclass(frozen=True)
class SequenceResult:
    """
    How a sequence ended.

    outcome: name of the error_code, SUCCESSFUL or another one of msg_docs/shape_sequencer.md.
    message: what went wrong; on success what the last shape lacks, or empty.  reached: where the
    last shape ended, None where that was not reported.
    """

    outcome: str
    message: str
    shapes_completed: int
    reached: Reached | None = None
