# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of every node.  Add a new one to NODE_PARAMETERS."""

from collections.abc import Mapping
from dataclasses import fields
from math import pi, radians
from typing import Any

from soft_continuum.estimation.sensing.imus import ImuSettings
from soft_continuum.estimation.unknowns import ESTIMATION_PARAMETERS
from soft_continuum.hardware.drivers import (
    driver_parameters,
    families,
    JAMMING_DRIVERS,
    TENDON_DRIVERS,
)
from soft_continuum.hardware.jamming_controller import JammingSettings
from soft_continuum.parameters.arm import ARM_PARAMETERS
from soft_continuum.parameters.parameter import FRAME_NAME, Parameter, setting_parameters
from soft_continuum.parameters.shapes import SHAPE_NAMES
from soft_continuum.planning.settings import (
    LOOP_PARAMETERS,
    MotionLimits,
    REACH_PARAMETERS,
    RunnerSettings,
)
from soft_continuum.ros.names import (
    CAMERA,
    DISC_SENSORS,
    JAMMING_VALVES,
    KINEMATICS,
    RECORDER,
    SERVO,
    SHAPE_SEQUENCER,
    TELEOP,
    TENDON_ACTUATION,
)

AUTOSTART = Parameter('autostart', True, 'configure and activate the node when it starts')
FRAME = Parameter(
    'frame_id', 'base_link', 'frame at the bottom centre of the base disc, z along the arm; its '
    'prefix applies to all frames of the arm; by default the prefix is the namespace, as in '
    'left/base_link', form=FRAME_NAME)
AMBIENT = Parameter(
    'ambient_pressure', JammingSettings.ambient_pressure, 'absolute ambient pressure', 1e4, 2e5,
    unit='Pa')
STALE_AFTER = Parameter(
    'stale_timeout', 0.5, 'age at which a message from another node is stale', 0.1, 10.0,
    read_only=False, unit='s')
PULL_LIMITS = Parameter(
    'pull_limits', MotionLimits.pull_limits,
    'smallest and largest tendon pull; negative: paid out', -1.0, 1.0, is_range=True, unit='m')
TENSION_LIMIT = Parameter(
    'tension_limit', MotionLimits.tension_limit,
    'largest tendon tension that the model may predict', 0.1, 1e4, read_only=False, unit='N')
CO_CONTRACTION_LIMIT = Parameter(
    'co_contraction_limit', 5.0,
    'maximum predicted tension that opposing tendons may carry at once', 0.01, 1e4,
    read_only=False, unit='N')
SPEED = Parameter(
    'tendon_speed', MotionLimits.speed, 'maximum tendon speed of planned motions', 1e-4, 1.0,
    read_only=False, unit='m/s')
ACCELERATION = Parameter(
    'tendon_acceleration', MotionLimits.acceleration, 'maximum tendon acceleration of planned '
    'motions', 1e-3, 10.0, read_only=False, unit='m/s^2')
ANTAGONIST_SLACK = Parameter(
    'antagonist_slack', MotionLimits.antagonist_slack,
    'slack left in tendons that do not carry the arm',
    0.0, 0.05, read_only=False, unit='m')
SOFT_VACUUM = Parameter(
    'soft_vacuum', RunnerSettings.soft_vacuum,
    'vacuum below ambient up to which a segment counts as soft', 100.0, 101e3, unit='Pa')
FULL_VACUUM = Parameter(
    'full_vacuum', JammingSettings.full_vacuum, 'vacuum below ambient at which the described '
    'stiffness and yield moment of jams that are not rigid apply; regulators hold it in stiff '
    'segments', 1e3, 101e3, unit='Pa')
VACUUM_TOLERANCE = Parameter(
    'vacuum_tolerance', JammingSettings.vacuum_tolerance, 'deviation from the set-point of a '
    'regulator within which the vacuum counts as reached', 100.0, 2e4, unit='Pa')

JOYSTICK_AXES = {'x': (0, -1.0), 'y': (1, 1.0), 'z': (4, 1.0)}
"""Axis number and scale: joy_node counts left as positive."""
JOYSTICK_BUTTONS = {
    'enable': (4, 'enable button: the arm moves only while it is held'),
    'emergency_stop': (1, 'button that triggers the emergency stop'),
    'reset': (7, 'button that resets the emergency stop; a second press resumes'),
    'mode': (6, 'button that switches between bending a segment and moving the tip'),
    'next_segment': (5, 'button that selects the next segment'),
    'soften': (0, 'button that softens the selected segment and stiffens the others'),
    'stiffen': (2, 'button that stiffens the selected segment'),
}
"""Meaning of every button, with its number in joy_node for an Xbox controller."""
NEEDED_BUTTONS = ('enable', 'emergency_stop')

NODE_PARAMETERS: dict[str, tuple[Parameter, ...]] = {
    TENDON_ACTUATION: (
        *ARM_PARAMETERS, AUTOSTART, PULL_LIMITS, TENSION_LIMIT, CO_CONTRACTION_LIMIT, STALE_AFTER,
        Parameter('tendon_driver', 'simulated', 'driver of the motors',
                  choices=tuple(families(TENDON_DRIVERS))),
        Parameter('tendon_rate', 50.0, 'control rate, and publishing rate of tendon_states during '
                  'motion',
                  5.0, 500.0, unit='Hz'),
        Parameter('speed_limit', 0.03, 'maximum tendon speed', 1e-4, 1.0, unit='m/s'),
        Parameter('acceleration_limit', 0.3, 'maximum tendon acceleration', 1e-3, 100.0,
                  unit='m/s^2'),
        Parameter('load_cells.enabled', False, 'measure tensions with the load cells on the topic '
                  'load_cells, even if the driver measures them too; nothing moves without these '
                  'readings'),
        Parameter('load_cells.zeros', (0.0, 0.0), 'reading of each load cell without tension',
                  -1e9, 1e9),
        Parameter('load_cells.scales', (1.0, 1.0), 'scale of each load cell: N per unit of its '
                  'reading above zero', -1e9, 1e9),
        *driver_parameters(TENDON_DRIVERS),
    ),
    JAMMING_VALVES: (
        *ARM_PARAMETERS, AUTOSTART, AMBIENT,
        Parameter('jamming_driver', 'simulated', 'driver of pump, valves and pressure sensors',
                  choices=tuple(families(JAMMING_DRIVERS))),
        Parameter('jamming_rate', 20.0, 'control rate, and publishing rate of the pressures',
                  5.0, 100.0,
                  unit='Hz'),
        *(Parameter(name, getattr(JammingSettings, name), text, 1e3, 101e3, unit='Pa')
          for name, text in (
              ('stiff_vacuum', 'vacuum below ambient from which a segment counts as stiff'),
              ('release_vacuum',
               'vacuum below ambient below which a segment no longer counts as stiff'),
              ('pump_start_vacuum',
               'vacuum below ambient: the pump starts when an evacuated segment has less'),
              ('pump_stop_vacuum',
               'vacuum below ambient: the pump stops when every evacuated segment has more'))),
        FULL_VACUUM, VACUUM_TOLERANCE, *driver_parameters(JAMMING_DRIVERS),
    ),
    KINEMATICS: (
        *ARM_PARAMETERS, FRAME, TENSION_LIMIT, AMBIENT,
        FULL_VACUUM, VACUUM_TOLERANCE,
        Parameter('straight_tolerance', 0.0005,
                  'largest pull at which ~/reset accepts a stiff arm as straight; also the '
                  'tolerated shortening of the tendons of a stiff arm', 0.0, 0.1, unit='m'),
        Parameter('tension_tolerance', 5.0, 'lasting difference between measured and predicted '
                  'tension that is reported; at least three of the standard deviations that the '
                  'device reports', 0.1, 1e4, read_only=False, unit='N'),
        *ESTIMATION_PARAMETERS,
    ),
    CAMERA: (
        *ARM_PARAMETERS, FRAME,
        Parameter('camera.source', '', 'path of a video device, a video file or a folder of '
                  'images; empty: the topics ~/image_raw and ~/camera_info'),
        Parameter('camera.calibration', '', 'YAML file with the camera calibration, in the format '
                  'of ROS camera drivers; empty: from ~/camera_info'),
        Parameter('camera.rate', 15.0, 'maximum rate at which images are processed',
                  0.1, 200.0, unit='Hz'),
        Parameter('tags.disc_size', 0.024, 'edge length of the black square of the disc tags',
                  0.002, 1.0, unit='m'),
        Parameter('tags.fixed_size', 0.06, 'edge length of the black square of the fixed tags',
                  0.002, 1.0, unit='m'),
        Parameter('tags.fixed_positions', (-0.3, -0.02, 0.3, -0.02, 0.3, 0.4, -0.3, 0.4),
                  'planar arm: x and z of the centre of each fixed tag, in the order of their IDs '
                  'from 100', -10.0, 10.0, unit='m'),
        Parameter('tags.faces', 6, 'spatial arm: number of tags around each disc', 3, 24),
        Parameter('tags.fixed_poses', (
            -0.22, 0.3, 0.0, -pi / 2, 0.22, 0.3, 0.0, -pi / 2,
            0.22, 0.3, 0.3, -pi / 2, -0.22, 0.3, 0.3, -pi / 2,
            0.3, 0.22, 0.0, pi, 0.3, -0.22, 0.0, pi, 0.3, -0.22, 0.3, pi, 0.3, 0.22, 0.3, pi),
            'spatial arm: x, y, z (m) of the centre of each fixed tag, and the direction it '
            'faces, rad about z from x', -10.0, 10.0),
        Parameter('tags.depth', 0.03, 'planar arm: distance of the disc tags in front of the '
                  'fixed tags, towards the camera', -0.5, 0.5, unit='m'),
        Parameter('tags.stddev', 0.0003, 'standard deviation of the tag positions on the discs, '
                  'or on the tag rings of a spatial arm', 0.0, 0.05, unit='m'),
        Parameter('tags.ring_stddev', 0.0003, 'spatial arm: standard deviation of the positions '
                  'of the tag rings on the discs', 0.0, 0.05, unit='m'),
        Parameter('tags.offsets', (0.0,), 'planar arm: x, z (m) and angle (rad) of each disc in '
                  'the frame of its tag, base first, as ~/tare prints them; 0.0 alone: no offsets',
                  -1.0, 1.0),
        Parameter('tags.reference_corners', (0.0,), 'spatial arm: ID and corners (px, '
                  'undistorted) of each tag seen when the arm was straight, as ~/tare prints '
                  'them; 0.0 alone: no offsets', -1e4, 1e5),
        Parameter('tags.fixed_stddev', 0.0005, 'standard deviation of the positions of the fixed '
                  'tags',
                  0.0, 0.05, unit='m'),
        Parameter('tags.depth_stddev', 0.001, 'standard deviation of tags.depth', 0.0, 0.05,
                  unit='m'),
    ),
    DISC_SENSORS: (
        *ARM_PARAMETERS, FRAME,
        Parameter('disc_sensors.rate', 50.0, 'maximum publishing rate of the measured poses, for '
                  'each disc and sensor', 1.0, 1000.0, unit='Hz'),
        Parameter('tracker.frame_id', '', "frame of the tracker's measurements; empty: frame_id",
                  form=FRAME_NAME),
        Parameter('tracker.base_pose', (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0),
                  'pose of base_link in that frame: x, y, z (m), quaternion x, y, z, w',
                  -1000.0, 1000.0),
        Parameter('tracker.position_stddev', 0.0005,
                  "standard deviation of the tracker's positions", 1e-6, 0.1, unit='m'),
        Parameter('tracker.angle_stddev', 0.005,
                  "standard deviation of the tracker's orientations", 1e-6, 0.25, unit='rad'),
        Parameter('tracker.offsets', (0.0,), 'pose of each disc in its tracked frame, base first: '
                  'x, y, z (m), quaternion x, y, z, w, as ~/tare prints them; 0.0 alone: the '
                  'discs themselves are tracked', -1000.0, 1000.0),
        Parameter('imu.axes', ('+x', '+y', '+z'), 'IMU axes that point along x, y and z of the '
                  'disc, such as +x, -z, +y; three for all discs, or three for each'),
        Parameter('imu.mounting_angles', (0.0,), 'angle that each IMU measures on the straight '
                  'arm, base first, as ~/tare prints them; a single value applies to all', -pi, pi,
                  unit='rad'),
        Parameter('imu.mounting_turns', (0.0,), 'spatial arm: rotation of each IMU relative to '
                  'its disc, base first: rotation vectors x, y, z, as ~/tare prints them; 0.0 '
                  'alone: none', -pi, pi, unit='rad'),
        *setting_parameters(ImuSettings, 'imu'),
    ),
    RECORDER: (
        Parameter('recorder.directory', 'recordings', 'directory of the recordings; created if '
                  'missing'),
        Parameter('recorder.pictures', False, 'also record camera images: tens of MB per second',
                  read_only=False),
    ),
    SERVO: (
        *ARM_PARAMETERS, FRAME, PULL_LIMITS, TENSION_LIMIT, STALE_AFTER, AMBIENT, SPEED,
        ACCELERATION, ANTAGONIST_SLACK, SOFT_VACUUM,
        Parameter('servo.rate', 25.0, 'rate of the commands', 20.0, 100.0, unit='Hz'),
        Parameter('servo.segment', 0, 'arm without jamming: number of the segment that follows '
                  'the target, 1 at the base; 0: the last', 0, 100, read_only=False),
        Parameter('servo.horizon', 0.35, 'time after which the tendons are at rest once commands '
                  'stop', 0.3, 2.0, read_only=False, unit='s'),
        Parameter('servo.integral_time', 0.5, 'time constant of the correction from measurements',
                  0.1, 60.0, read_only=False, unit='s'),
        Parameter('servo.response_time', 0.06, 'delay of the arm behind its planned motion',
                  0.0, 1.0, read_only=False, unit='s'),
        Parameter('servo.extrapolation', 0.15, 'time over which the motion of a target is '
                  'extrapolated', 0.0, 1.0, read_only=False, unit='s'),
        Parameter('servo.friction_band', 5e-5, 'pull that tendon friction absorbs: smaller '
                  'corrections are not sent', 0.0, 0.01, read_only=False,
                  unit='m'),
        Parameter('servo.target_timeout', 0.5, 'age at which a target is stale and no longer '
                  'followed',
                  0.1, 10.0, read_only=False, unit='s'),
        Parameter('servo.measurement_timeout', 0.5, 'age at which a measurement is stale and no '
                  'longer used for corrections', 0.1, 10.0, read_only=False, unit='s'),
    ),
    TELEOP: (
        Parameter('teleop.bending_speed', 0.3, 'bending speed of the segment at full deflection',
                  0.01, 3.0, read_only=False, unit='rad/s'),
        Parameter('teleop.tip_speed', 0.03, 'speed of the tip at full deflection', 0.001, 1.0,
                  read_only=False, unit='m/s'),
        Parameter('teleop.timeout', 0.25, 'age of the last joystick message at which motion stops',
                  0.05, 2.0, unit='s'),
        Parameter('teleop.unchanged_timeout', 5.0, 'time without any change in the joystick '
                  'messages after which motion stops', 1.0, 60.0, unit='s'),
        *(Parameter(f'teleop.{axis}_axis', number, f'number of the axis that moves along {axis}; '
                    '-1: none', -1, 100) for axis, (number, _) in JOYSTICK_AXES.items()),
        *(Parameter(f'teleop.{axis}_scale', scale, f'fraction of full speed at 1 of the {axis} '
                    'axis; negative: reversed', -1.0, 1.0)
          for axis, (_, scale) in JOYSTICK_AXES.items()),
        *(Parameter(f'teleop.{name}_button', number,
                    meaning if name in NEEDED_BUTTONS else f'{meaning}; -1: none',
                    0 if name in NEEDED_BUTTONS else -1, 100)
          for name, (number, meaning) in JOYSTICK_BUTTONS.items()),
        Parameter('teleop.dead_zone', 0.15, 'deflection below which a stick counts as centred',
                  0.0, 0.9),
    ),
    SHAPE_SEQUENCER: (
        *ARM_PARAMETERS, SHAPE_NAMES, FRAME, PULL_LIMITS, TENSION_LIMIT, STALE_AFTER, AMBIENT,
        SPEED, ACCELERATION, ANTAGONIST_SLACK,
        Parameter('angle_step', radians(2.0), 'step in bending angle between planned points',
                  radians(0.1), radians(30.0), unit='rad'),
        Parameter('angle_tolerance', radians(0.1),
                  'deviation from its bending angle up to which a segment is not set again',
                  0.0, radians(10.0), read_only=False, unit='rad'),
        SOFT_VACUUM, FULL_VACUUM, VACUUM_TOLERANCE,
        Parameter('jamming_timeout', 10.0, 'maximum wait for a segment to become soft or stiff',
                  0.1, 600.0, read_only=False, unit='s'),
        Parameter('settle_timeout', 5.0, 'maximum wait for the tendons to arrive after a motion',
                  0.1, 600.0, read_only=False, unit='s'),
        Parameter('settle_tolerance', 2e-5,
                  'deviation from its planned pull within which a tendon has arrived; larger if '
                  'its device reports a lower positioning accuracy',
                  1e-7, 0.01, read_only=False, unit='m'),
        Parameter('obstacles.file', '', 'YAML file with the obstacles around the arm, such as '
                  'config/obstacles_example.yaml; empty: none until they are received on the '
                  'topic obstacles'),
        *LOOP_PARAMETERS, *REACH_PARAMETERS,
    ),
}

DESCRIBED = tuple(name for name, table in NODE_PARAMETERS.items()
                  if set(ARM_PARAMETERS) <= set(table))
"""The nodes that read the description of the arm."""
ALL_PARAMETERS = tuple({p.name: p for table in NODE_PARAMETERS.values() for p in table}.values())


def default_frame(namespace: str) -> str:
    """Return the frame_id of an arm: its namespace lets two arms share one TF tree."""
    return '/'.join(filter(None, [namespace.strip('/'), str(FRAME.default)]))


def jamming_settings(values: Mapping[str, Any]) -> JammingSettings:
    """Return the thresholds of jamming_valves; raises ParameterError when out of order."""
    return JammingSettings(**{field.name: values[field.name] for field in fields(JammingSettings)})
