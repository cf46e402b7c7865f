# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Conversions between the library's arrays and ROS messages."""

import array
from collections.abc import Sequence
from dataclasses import dataclass
from math import pi

from geometry_msgs.msg import Pose, PoseArray, PoseWithCovarianceStamped
import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import Image, JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from soft_continuum.hardware.protocols import Accuracy
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.chain import Chain, Equilibrium
from soft_continuum.mechanics.rotations import in_plane, planar_pose
from soft_continuum.ros.ros_time import duration_to_ros
from soft_continuum.text import plain, printable
from soft_continuum_interfaces.msg import (
    JammingValvesState,
    KinematicsState,
    TendonActuationState,
)

MAX_PULL = 1.0  # m, the most that pull_limits can be
MAX_JOINT_ANGLE = pi  # rad
MAX_TILT = 0.1
"""Tangent of half the largest angle of a disc out of the plane of the arm."""
MAX_QUATERNION_ERROR = 0.01
"""Tolerance of the length of a quaternion."""
MAX_VARIANCE = 1.0
"""Variance, m^2 or rad^2, from which a coordinate counts as not measured."""

SHAPE_FIELDS = 'joint_angles', 'held_angles', 'stiff', 'vacuum'
"""Fields of KinematicsState of which a state of the model is made."""
ACCURACY_RANGES = {'pull_tolerances': (0.0, 0.01), 'tension_stddevs': (1e-3, 1e4),
                   'tension_relative_stddevs': (0.0, 1.0)}
"""Ranges of accuracies from a device: m, N, and relative; as of the parameters they replace."""

MAX_PICTURE_BYTES = 40_000_000
"""Largest image message: 12 megapixels in colour."""
CHANNELS = {'mono8': 1, '8UC1': 1, 'rgb8': 3, 'bgr8': 3, '8UC3': 3, 'rgba8': 4, 'bgra8': 4}
"""Supported encodings of sensor_msgs/Image, and their bytes per pixel."""


def seconds(stamp: object) -> float:
    """Return a builtin_interfaces Time or Duration in s."""
    return float(stamp.sec + stamp.nanosec * 1e-9)  # type: ignore[attr-defined]


def poses_to_ros(poses: Array, message: PoseArray) -> PoseArray:
    """Write poses (k, 7), position in m and quaternion x, y, z, w, into an existing PoseArray."""
    while len(message.poses) < len(poses):
        message.poses.append(Pose())
    for pose, row in zip(message.poses, poses.tolist(), strict=True):
        _write_pose(pose, row)
    return message


def _write_pose(pose: Pose, row: Sequence[float]) -> None:
    p, q = pose.position, pose.orientation
    p.x, p.y, p.z, q.x, q.y, q.z, q.w = row


def pose_from_ros(pose: Pose) -> tuple[float, ...]:
    """Return position x, y, z in m and quaternion x, y, z, w of a pose."""
    p, q = pose.position, pose.orientation
    return p.x, p.y, p.z, q.x, q.y, q.z, q.w


def poses_from_ros(message: PoseArray) -> Array:
    """Return the poses (k, 7) of a PoseArray: position in m and quaternion x, y, z, w."""
    return np.array([pose_from_ros(pose) for pose in message.poses]).reshape(-1, 7)


def tracked_pose_to_ros(pose: Array, covariance: Array) -> PoseWithCovarianceStamped:
    """Return a pose (7,) and its covariance (6, 6), in m and rad, without header."""
    message = PoseWithCovarianceStamped()
    _write_pose(message.pose.pose, pose.tolist())
    message.pose.covariance = covariance.ravel()
    return message


def measured_pose_from_ros(message: PoseWithCovarianceStamped, axes: NDArray[np.bool_],
                           frame: str = '') -> tuple[Array, Array]:
    """
    Return a measured pose (7,) and its covariance (6, 6), in m and rad.

    axes: as pose_axes of the arm; other coordinates are ignored.  frame: required frame.  A
    coordinate with a variance of MAX_VARIANCE or more is not measured.  Raises ValueError for
    another frame, for numbers that are not finite, an invalid quaternion or covariance, and an
    orientation out of the plane of a planar arm.
    """
    pose = np.array(pose_from_ros(message.pose.pose))
    covariance = np.reshape(message.pose.covariance, (6, 6))[np.ix_(axes, axes)]
    place, quaternion = pose[:3][axes[:3]], pose[3:]
    if not all(np.isfinite(numbers).all() for numbers in (place, quaternion, covariance)):
        raise ValueError('a pose with numbers that are not finite')
    if axes.all():
        length = float(np.linalg.norm(pose[3:]))
        if not abs(length - 1.0) < MAX_QUATERNION_ERROR:
            raise ValueError(f'a quaternion of length {length:.3g}, not 1')
        _check_measured(message, frame, covariance)
        pose[3:] /= length
        return pose, (covariance + covariance.T) / 2.0
    about_x, about_y, about_z, w = pose[3:]
    if not np.hypot(about_x, about_z) < MAX_TILT * np.hypot(about_y, w):
        raise ValueError('an orientation that is not about y; is z of its frame along the arm?')
    _check_measured(message, frame, covariance)
    return in_plane(planar_pose(pose), covariance)


def _check_measured(message: PoseWithCovarianceStamped, frame: str, covariance: Array) -> None:
    """Raise ValueError for another frame or an invalid covariance."""
    if frame and message.header.frame_id != frame:
        raise ValueError(f'poses in {plain(message.header.frame_id)!r}; needed: {frame!r}')
    known = np.diag(covariance) < MAX_VARIANCE
    measured = ((covariance + covariance.T) / 2.0)[np.ix_(known, known)]
    if known.any() and np.linalg.eigvalsh(measured)[0] <= 0.0:
        raise ValueError('a covariance that is not positive definite')


def pulls_from_ros(message: JointState, tendons: Sequence[str]) -> Array:
    """
    Return the pulls (tendons,) m of tendon_states.

    Raises ValueError when one is missing, not a finite number or beyond MAX_PULL.
    """
    positions = dict(zip(message.name, message.position, strict=False))
    missing = [name for name in tendons if name not in positions]
    if missing:
        raise ValueError(f'tendon_states without position of {", ".join(missing)}')
    pulls = np.array([positions[name] for name in tendons])
    if not np.all(np.abs(pulls) <= MAX_PULL):
        raise ValueError(f'tendon_states with pulls of {", ".join(f"{p:g}" for p in pulls)} m; '
                         f'possible: finite numbers up to {MAX_PULL:g} m')
    return pulls


def accuracy_to_ros(accuracy: Accuracy, state: TendonActuationState) -> None:
    """Write the accuracy of a device into the state of tendon_actuation."""
    for name in ACCURACY_RANGES:
        setattr(state, name, getattr(accuracy, name))


def accuracy_from_ros(state: TendonActuationState, tendons: Sequence[str]) -> Accuracy:
    """
    Return the accuracy of the device of tendon_actuation, one value per tendon.

    Raises ValueError for lists that are neither empty nor have one valid number per tendon.
    """
    for name, (low, high) in ACCURACY_RANGES.items():
        values = getattr(state, name)
        if values and not (tuple(state.tendons) == tuple(tendons) and len(values) == len(tendons)
                           and all(low <= value <= high for value in values)):
            raise ValueError(f'{name} of tendon_actuation/state are not used; needed: for each '
                             f'of {", ".join(tendons)} a number from {low:g} to {high:g}, or none')
    return Accuracy(*(tuple(getattr(state, name)) for name in ACCURACY_RANGES))


@dataclass(frozen=True)
class Stiffness:
    """
    Reports of jamming_valves on every segment; None if unknown.

    confirmed: stiff, by its pressure.  setpoints: vacuum that its regulator is set to, Pa below
    ambient; of valves empty.
    """

    confirmed: tuple[bool | None, ...]
    setpoints: tuple[float, ...] = ()

    def jammed(self, elastic: Sequence[bool]) -> tuple[bool | None, ...]:
        """
        Return the segments with a jam in the model, with any part of the full vacuum.

        elastic: segments whose description has a law for the jam.  A regulator that is set to any
        vacuum jams them; all others jam once they are confirmed stiff.
        """
        if not self.setpoints:
            return self.confirmed
        return tuple(
            setpoint > 0.0 if law and stiff is not None else stiff for stiff, setpoint, law
            in zip(self.confirmed, self.setpoints, elastic, strict=True))


def stiffness_from_ros(state: JammingValvesState, before: Stiffness) -> Stiffness:
    """
    Return the stiffness of segments; unknown ones stay as they were ``before``.

    A message about another number of segments changes nothing.
    """
    if (len(state.stiffness) != len(before.confirmed)
            or len(state.vacuums) not in (0, len(before.confirmed))):
        return before
    return Stiffness(
        tuple(was if now == JammingValvesState.UNKNOWN else now == JammingValvesState.STIFF
              for was, now in zip(before.confirmed, state.stiffness, strict=True)),
        tuple(state.vacuums) if state.connected else before.setpoints)


def equilibrium_to_ros(state: Equilibrium) -> KinematicsState:
    """Return a state of the model as a message without stamp."""
    return KinematicsState(
        joint_angles=state.coordinates.tolist(), held_angles=state.held_coordinates.tolist(),
        stiff=list(state.stiff), vacuum=list(state.vacuum or [1.0] * len(state.stiff)))


def equilibrium_from_ros(message: KinematicsState, chain: Chain) -> Equilibrium | None:
    """Return the state of the model in a message, None if it does not fit this arm."""
    angles, held = np.array(message.joint_angles), np.array(message.held_angles)
    vacuum = np.array(message.vacuum)
    if (len(angles) != chain.coordinate_count or len(held) != chain.coordinate_count
            or not np.all(np.abs([angles, held]) <= MAX_JOINT_ANGLE)
            or len(message.stiff) != chain.segments or len(vacuum) != chain.segments
            or not np.all((vacuum >= 0.0) & (vacuum <= 1.0))):
        return None
    return chain.state_of(angles, held, message.stiff, vacuum.tolist())


def trajectory_to_ros(times: Sequence[float] | Array, pulls: Sequence[Sequence[float]] | Array,
                      tendons: Sequence[str]) -> JointTrajectory:
    """Return times (k,) s and pulls (k, tendons) m as a JointTrajectory without stamp and id."""
    return JointTrajectory(joint_names=list(tendons), points=[
        JointTrajectoryPoint(positions=[float(pull) for pull in positions],
                             time_from_start=duration_to_ros(float(time)))
        for time, positions in zip(times, pulls, strict=True)])


def trajectory_from_ros(message: JointTrajectory, tendons: Sequence[str]) -> tuple[Array, Array]:
    """
    Return times (k,) s from the start, and pulls (k, tendons) m in the order of ``tendons``.

    Raises ValueError when the joint names or the numbers of a point are not those of the tendons.
    Velocities, accelerations and efforts are ignored, but must be empty or finite.
    """
    names = list(message.joint_names)
    if sorted(names) != sorted(tendons):
        raise ValueError(f'joint_names are {plain(str(names))}; needed: {list(tendons)}')
    for number, point in enumerate(message.points, start=1):
        if len(point.positions) != len(tendons):
            raise ValueError(
                f'point {number} has {len(point.positions)} positions; needed: one for each of '
                f'{names}')
        for what in ('velocities', 'accelerations', 'effort'):
            values = getattr(point, what)
            if len(values) not in (0, len(tendons)) or not np.all(np.isfinite(values)):
                raise ValueError(f'point {number} has {len(values)} values in {what}, of which '
                                 f'{np.count_nonzero(~np.isfinite(values))} are no finite '
                                 f'numbers; needed: none, or a number for each of {names}')
    order = [names.index(name) for name in tendons]
    times = np.array([seconds(p.time_from_start) for p in message.points])
    pulls = np.array([[p.positions[i] for i in order] for p in message.points], dtype=float)
    return times, pulls


def grey_picture(message: Image) -> NDArray[np.uint8]:
    """Return an image (height, width) in grey; raises ValueError for an unsupported one."""
    if message.encoding not in CHANNELS:
        raise ValueError(f'images of encoding {printable(message.encoding, 40)!r} are not '
                         f'supported; supported: {", ".join(CHANNELS)}')
    channels, row = CHANNELS[message.encoding], message.step
    if (message.width * message.height == 0 or row < message.width * channels
            or len(message.data) < row * message.height):
        raise ValueError(f'an image of {message.width} x {message.height} px with '
                         f'{len(message.data)} bytes in rows of {row}')
    data = np.frombuffer(message.data, dtype=np.uint8)[:row * message.height]
    pixels = data.reshape(message.height, row)[:, :message.width * channels]
    if channels == 1:
        return np.ascontiguousarray(pixels)
    # Green, which most of the light is, and of which the sensor has most pixels.
    return np.ascontiguousarray(pixels.reshape(message.height, message.width, channels)[..., 1])


def grey_message(picture: NDArray[np.uint8]) -> Image:
    """Return a grey image (height, width) as a message without header."""
    message = Image(height=picture.shape[0], width=picture.shape[1], encoding='mono8',
                    step=picture.shape[1])
    message.data = array.array('B', picture.tobytes())
    return message
