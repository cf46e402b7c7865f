# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The twin on topics: its sensors and camera, as on a rig, and its ground truth."""

from abc import abstractmethod
from typing import Self, TYPE_CHECKING

from geometry_msgs.msg import PoseArray
import numpy as np
from sensor_msgs.msg import CameraInfo, Image, Imu, JointState

from soft_continuum.client.connection import Connection
from soft_continuum.ros.conversions import grey_message, poses_from_ros, poses_to_ros, seconds
from soft_continuum.ros.entries import SENSOR, STREAM, subscribe_unguarded
from soft_continuum.ros.names import CAMERA, LOAD_CELLS, TWIN

if TYPE_CHECKING:  # a process has one of the two: the rig, or a camera
    from soft_continuum.sim.twin.camera import TwinCamera
    from soft_continuum.sim.twin.rig import TwinRig

PERIOD = 0.02  # s
DISC_POSES = 'twin/disc_poses'
FRAME = 'simulated_{}'


class Publisher:
    """Publishes on a node of its own while this context manager is open."""

    def __init__(self, name: str, namespace: str) -> None:
        """Make a node; raises ClientError for a namespace that ROS does not take."""
        self._connection = Connection(name, namespace)
        self._node = self._connection.node

    def __enter__(self) -> Self:
        """Begin to publish."""
        self._connection.requests.start(self._begin()).result()
        return self

    def __exit__(self, *_: object) -> None:
        """End."""
        self._connection.close()

    @abstractmethod
    async def _begin(self) -> None:
        """Create publishers and timers, on the thread that spins the node."""


class GroundTruth(Publisher):
    """
    Publishes the joints, tendons and discs of a twin while this context manager is open.

    For tests and benchmarks: no node of the suite subscribes to it.
    """

    def __init__(self, rig: 'TwinRig', namespace: str = '') -> None:
        """Make the node ``twin``; raises ClientError for a namespace that ROS does not take."""
        super().__init__(TWIN, namespace)
        self._rig = rig
        self._names = rig.plant.joint_names

    async def _begin(self) -> None:
        node = self._node
        self._joints = node.create_publisher(JointState, 'twin/joint_states', STREAM)
        self._tendons = node.create_publisher(JointState, 'twin/tendon_states', STREAM)
        self._discs = node.create_publisher(PoseArray, DISC_POSES, STREAM)
        node.create_timer(PERIOD, self._publish)

    def _publish(self) -> None:
        with self._rig.lock:
            plant = self._rig.plant
            angles, poses, tensions = plant.joint_angles, plant.poses, plant.tensions
        stamp = self._node.get_clock().now().to_msg()
        joints = JointState(name=self._names, position=angles.tolist())
        tendons = JointState(name=list(self._rig.plant.arm.tendon_names),
                             effort=tensions.tolist())
        discs = poses_to_ros(poses, PoseArray())
        joints.header.stamp = tendons.header.stamp = discs.header.stamp = stamp
        discs.header.frame_id = 'base_link'
        self._joints.publish(joints)
        self._tendons.publish(tendons)
        self._discs.publish(discs)


class SensorTopics(Publisher):
    """
    Publishes load_cells (JointState, effort in N) and disc_N/imu (Imu), N from 0 at the base.

    The frame of an IMU is that of its disc in the URDF; the base disc's is base_link.
    """

    def __init__(self, rig: 'TwinRig', namespace: str = '') -> None:
        """Make the node ``twin_sensors``; raises ClientError, as Publisher does."""
        super().__init__('twin_sensors', namespace)
        self._rig = rig
        given, prefix = rig.plant.model_errors, namespace.strip('/')
        self._tensions = JointState(name=list(rig.plant.arm.tendon_names))
        self._messages = []
        for n in range(len(rig.plant.arm.discs)):
            message = Imu()
            message.header.frame_id = f'{prefix}/' * bool(prefix) + (
                f'disc_{n}' if n else 'base_link')
            message.orientation_covariance[0] = -1.0  # there is none
            message.angular_velocity_covariance = _covariance(given.gyro_noise, given.gyro_bias)
            message.linear_acceleration_covariance = _covariance(
                given.accelerometer_noise, given.accelerometer_bias)
            self._messages.append(message)

    async def _begin(self) -> None:
        node = self._node
        self._load_cells = node.create_publisher(JointState, LOAD_CELLS, STREAM)
        self._imus = [node.create_publisher(Imu, f'disc_{n}/imu', STREAM)
                      for n in range(len(self._messages))]
        node.create_timer(PERIOD, self._publish)

    def _publish(self) -> None:
        with self._rig.lock:
            tensions, motions = self._rig.sensors.tensions(), self._rig.sensors.motions()
        stamp = self._node.get_clock().now().to_msg()
        self._tensions.header.stamp, self._tensions.effort = stamp, tensions.tolist()
        self._load_cells.publish(self._tensions)
        for imu, message, motion in zip(self._imus, self._messages, motions.tolist(), strict=True):
            message.header.stamp = stamp
            turning, force = message.angular_velocity, message.linear_acceleration
            turning.x, turning.y, turning.z, force.x, force.y, force.z = motion
            imu.publish(message)


class Pictures(Publisher):
    """
    Publishes images, drawn from twin/disc_poses, and the calibration of a camera.

    In a separate process: drawing takes most of a core.
    """

    def __init__(self, camera: 'TwinCamera', rate: float, namespace: str = '',
                 name: str = CAMERA) -> None:
        """
        Make the node twin_NAME, which publishes NAME/image_raw and NAME/camera_info.

        rate: Hz.  Raises ClientError, as Publisher does.
        """
        super().__init__(f'{TWIN}_{name}', namespace)
        self._camera, self._rate, self._name = camera, rate, name
        self._discs: PoseArray | None = None

    async def _begin(self) -> None:
        node = self._node
        self._images = node.create_publisher(Image, f'{self._name}/image_raw', STREAM)
        self._infos = node.create_publisher(CameraInfo, f'{self._name}/camera_info', STREAM)
        subscribe_unguarded(node, PoseArray, DISC_POSES, self._on_discs, SENSOR)
        node.create_timer(1.0 / self._rate, self._publish)

    def _on_discs(self, message: PoseArray) -> None:
        self._discs = message

    def _publish(self) -> None:
        if self._discs is None:
            return
        message, self._discs = self._discs, None
        image = grey_message(self._camera.picture(
            poses_from_ros(message)[::2], seconds(message.header.stamp)))
        lens = self._camera.lens
        info = CameraInfo(width=lens.size[0], height=lens.size[1], distortion_model='plumb_bob',
                          d=lens.distortion.tolist(), k=lens.matrix.ravel())
        info.p = lens.projection.ravel()
        info.r = np.eye(3).ravel()
        for item in (image, info):
            item.header.stamp, item.header.frame_id = (
                message.header.stamp, FRAME.format(self._name))
        self._infos.publish(info)
        self._images.publish(image)


def _covariance(noise: float, bias: float) -> list[float]:
    """Return a covariance, (9,), of values that have both standard deviations."""
    covariance: list[float] = ((noise**2 + bias**2) * np.eye(3)).ravel().tolist()
    return covariance
