# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of every node: a new one is an entry of NODE_PARAMETERS, and its use."""

from collections.abc import Mapping
from dataclasses import fields
from math import pi, radians
from typing import Any

from soft_continuum.estimation.settings import ESTIMATION_PARAMETERS
from soft_continuum.hardware.drivers import (
    driver_names,
    driver_parameters,
    JAMMING_DRIVERS,
    TENDON_DRIVERS,
)
from soft_continuum.hardware.jamming_controller import JammingSettings
from soft_continuum.parameters.arm import ARM_PARAMETERS
from soft_continuum.parameters.parameter import FRAME_NAME, Parameter, ParameterError
from soft_continuum.parameters.shapes import SHAPE_NAMES
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
from soft_continuum.sequencing.settings import LOOP_PARAMETERS, REACH_PARAMETERS

AUTOSTART = Parameter('autostart', True, 'configure and activate the node when it starts')
FRAME = Parameter(
    'frame_id', 'base_link', 'frame of the bottom centre of the base disc, z along the arm; '
    'left/base_link: every frame of the arm begins with left/, as it does in the namespace left '
    'where no other is given', form=FRAME_NAME)
AMBIENT = Parameter(
    'ambient_pressure', 101325.0, 'absolute ambient pressure', 1e4, 2e5, unit='Pa')
STALE_AFTER = Parameter(
    'stale_timeout', 0.5, 'age at which the last message of another node is stale', 0.1, 10.0,
    read_only=False, unit='s')
PULL_LIMITS = Parameter(
    'pull_limits', (-0.06, 0.06), 'smallest and largest tendon pull; negative: paid out',
    -1.0, 1.0, is_range=True, unit='m')
TENSION_LIMIT = Parameter(
    'tension_limit', 60.0, 'largest tendon tension that the model may predict', 0.1, 1e4,
    read_only=False, unit='N')
CO_CONTRACTION_LIMIT = Parameter(
    'co_contraction_limit', 5.0,
    'largest tension that the model may predict in opposing tendons at once', 0.01, 1e4,
    read_only=False, unit='N')
SPEED = Parameter(
    'tendon_speed', 0.015, 'largest tendon speed of a planned motion', 1e-4, 1.0,
    read_only=False, unit='m/s')
ACCELERATION = Parameter(
    'tendon_acceleration', 0.1, 'largest tendon acceleration of a planned motion', 1e-3, 10.0,
    read_only=False, unit='m/s^2')
ANTAGONIST_SLACK = Parameter(
    'antagonist_slack', 0.0005, 'slack left in the tendon that does not bend the soft segment',
    0.0, 0.05, read_only=False, unit='m')
SOFT_VACUUM = Parameter(
    'soft_vacuum', 10e3, 'vacuum below ambient up to which a segment is soft', 100.0, 101e3,
    unit='Pa')
FULL_VACUUM = Parameter(
    'full_vacuum', 80e3, 'vacuum below ambient at which jams that are not rigid have the '
    'stiffness and the yield moment of the description, and which regulators hold in a segment '
    'that is to be stiff', 1e3, 101e3, unit='Pa')
VACUUM_TOLERANCE = Parameter(
    'vacuum_tolerance', 3e3, 'distance of a vacuum from the set-point of its regulator at which '
    'it has followed', 100.0, 2e4, unit='Pa')

JOYSTICK_AXES = {'x': (0, -1.0), 'y': (1, 1.0), 'z': (4, 1.0)}
"""Number, and what one full deflection counts: joy_node counts left as positive."""
JOYSTICK_BUTTONS = {
    'enable': (4, 'button that has to be held for anything to move'),
    'emergency_stop': (1, 'button that turns the emergency stop on'),
    'reset': (7, 'button that turns the emergency stop off; pressed again, it resumes'),
    'mode': (6, 'button that changes between bending a segment and moving the tip'),
    'next_segment': (5, 'button that chooses the next segment'),
    'soften': (0, 'button that softens the chosen segment, and stiffens the others'),
    'stiffen': (2, 'button that stiffens the chosen segment'),
}
"""Number, as joy_node counts the buttons of an Xbox pad, and meaning of every button."""
NEEDED_BUTTONS = ('enable', 'emergency_stop')

NODE_PARAMETERS: dict[str, tuple[Parameter, ...]] = {
    TENDON_ACTUATION: (
        *ARM_PARAMETERS, AUTOSTART, PULL_LIMITS, TENSION_LIMIT, CO_CONTRACTION_LIMIT, STALE_AFTER,
        Parameter('tendon_driver', 'simulated', 'driver of the motors',
                  choices=driver_names(TENDON_DRIVERS)),
        Parameter('tendon_rate', 50.0, 'rate of control, and of tendon_states in motion',
                  5.0, 500.0, unit='Hz'),
        Parameter('speed_limit', 0.03, 'largest tendon speed', 1e-4, 1.0, unit='m/s'),
        Parameter('acceleration_limit', 0.3, 'largest tendon acceleration', 1e-3, 100.0,
                  unit='m/s^2'),
        Parameter('load_cells.enabled', False, 'measure tension by the topic load_cells, also '
                  'where the driver does; without its numbers nothing moves'),
        Parameter('load_cells.zeros', (0.0, 0.0), 'what each load cell shows without tension',
                  -1e9, 1e9),
        Parameter('load_cells.scales', (1.0, 1.0), 'tension over what each load cell shows '
                  'beyond its zero, N over its unit', -1e9, 1e9),
        *driver_parameters(TENDON_DRIVERS),
    ),
    JAMMING_VALVES: (
        *ARM_PARAMETERS, AUTOSTART, AMBIENT,
        Parameter('jamming_driver', 'simulated', 'driver of pump, valves and pressure sensors',
                  choices=driver_names(JAMMING_DRIVERS)),
        Parameter('jamming_rate', 20.0, 'rate of control and of the pressures', 5.0, 100.0,
                  unit='Hz'),
        Parameter('stiff_vacuum', 50e3, 'vacuum below ambient from which a segment is stiff',
                  1e3, 101e3, unit='Pa'),
        Parameter('release_vacuum', 40e3,
                  'vacuum below ambient under which a segment is no longer stiff', 1e3, 101e3,
                  unit='Pa'),
        Parameter('pump_start_vacuum', 60e3,
                  'the pump starts when an evacuated segment has less vacuum', 1e3, 101e3,
                  unit='Pa'),
        Parameter('pump_stop_vacuum', 80e3,
                  'the pump stops when every evacuated segment has more vacuum', 1e3, 101e3,
                  unit='Pa'),
        FULL_VACUUM, VACUUM_TOLERANCE, *driver_parameters(JAMMING_DRIVERS),
    ),
    KINEMATICS: (
        *ARM_PARAMETERS, FRAME, TENSION_LIMIT, AMBIENT,
        FULL_VACUUM, VACUUM_TOLERANCE,
        Parameter('straight_tolerance', 0.0005,
                  'largest pull at which ~/reset accepts a stiff arm as straight, and by which '
                  'the tendons may be too short for a stiff arm', 0.0, 0.1, unit='m'),
        Parameter('tension_tolerance', 5.0, 'difference between a measured tension and that of '
                  'the model that is reported when it lasts; more where the device tells that it '
                  'knows tensions less: three deviations', 0.1, 1e4, read_only=False, unit='N'),
        *ESTIMATION_PARAMETERS,
    ),
    CAMERA: (
        *ARM_PARAMETERS, FRAME,
        Parameter('camera.source', '', 'path of a video device or file, or of a folder of '
                  'pictures; empty: the topics ~/image_raw and ~/camera_info'),
        Parameter('camera.calibration', '', 'YAML file with the calibration of the lens, as '
                  'camera drivers of ROS keep it; empty: from ~/camera_info'),
        Parameter('camera.rate', 15.0, 'pictures that are looked at per second, at most',
                  0.1, 200.0, unit='Hz'),
        Parameter('tags.disc_size', 0.024, 'edge of the black square of the tags of the discs',
                  0.002, 1.0, unit='m'),
        Parameter('tags.fixed_size', 0.06, 'the same of the fixed tags', 0.002, 1.0, unit='m'),
        Parameter('tags.fixed_positions', (-0.3, -0.02, 0.3, -0.02, 0.3, 0.4, -0.3, 0.4),
                  'of a planar arm, x and z of the centre of each fixed tag, in the order of '
                  'their numbers from 100 on', -10.0, 10.0, unit='m'),
        Parameter('tags.faces', 6, 'tags around every disc of a spatial arm', 3, 24),
        Parameter('tags.fixed_poses', (
            -0.22, 0.3, 0.0, -pi / 2, 0.22, 0.3, 0.0, -pi / 2,
            0.22, 0.3, 0.3, -pi / 2, -0.22, 0.3, 0.3, -pi / 2,
            0.3, 0.22, 0.0, pi, 0.3, -0.22, 0.0, pi, 0.3, -0.22, 0.3, pi, 0.3, 0.22, 0.3, pi),
            'the same of a spatial arm: x, y, z (m) of the centre, and the direction that the tag '
            'looks, rad about z from x', -10.0, 10.0),
        Parameter('tags.depth', 0.03, 'by how much the tags of the discs are nearer to the camera '
                  'than the fixed ones, of a planar arm', -0.5, 0.5, unit='m'),
        Parameter('tags.stddev', 0.0003, 'standard deviation of where the tags are stuck on '
                  'the discs, or of a spatial arm on their rings', 0.0, 0.05, unit='m'),
        Parameter('tags.ring_stddev', 0.0003, 'standard deviation of where the rings of tags '
                  'sit on the discs of a spatial arm', 0.0, 0.05, unit='m'),
        Parameter('tags.offsets', (0.0,), 'x, z (m) and angle (rad) of each disc in the pose that '
                  'its tag tells, base first, as ~/tare prints them, of a planar arm; 0.0 '
                  'alone: the tags are where they should be', -1.0, 1.0),
        Parameter('tags.reference_corners', (0.0,), 'of a spatial arm, what the camera saw of it '
                  'when it was straight, as ~/tare prints it: number and corners (px, without the '
                  'distortion of the lens) of each tag; 0.0 alone: the tags are where they should '
                  'be', -1e4, 1e5),
        Parameter('tags.fixed_stddev', 0.0005, 'standard deviation of where the fixed tags are',
                  0.0, 0.05, unit='m'),
        Parameter('tags.depth_stddev', 0.001, 'standard deviation of tags.depth', 0.0, 0.05,
                  unit='m'),
    ),
    DISC_SENSORS: (
        *ARM_PARAMETERS, FRAME,
        Parameter('disc_sensors.rate', 50.0, 'measured poses that are published per second, at '
                  'most, of each disc and sensor', 1.0, 1000.0, unit='Hz'),
        Parameter('tracker.frame_id', '', 'frame in which the tracker measures; empty: frame_id',
                  form=FRAME_NAME),
        Parameter('tracker.base_pose', (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0),
                  'where base_link is in that frame: x, y, z (m), quaternion x, y, z, w',
                  -1000.0, 1000.0),
        Parameter('tracker.position_stddev', 0.0005,
                  'standard deviation of the positions of the tracker', 1e-6, 0.1, unit='m'),
        Parameter('tracker.angle_stddev', 0.005,
                  'standard deviation of the orientations of the tracker', 1e-6, 0.25, unit='rad'),
        Parameter('tracker.offsets', (0.0,), 'where each disc is in what is followed of it, base '
                  'first: x, y, z (m), quaternion x, y, z, w, as ~/tare prints them; 0.0 alone: '
                  'the disc itself is followed', -1000.0, 1000.0),
        Parameter('imu.axes', ('+x', '+y', '+z'), 'axes of the IMU that point along x, y and z '
                  'of the disc, such as +x, -z, +y; three for all discs or for each'),
        Parameter('imu.mounting_angles', (0.0,), 'angle that each IMU measures in the straight '
                  'arm, base first, as ~/tare prints them; one counts for all', -pi, pi,
                  unit='rad'),
        Parameter('imu.mounting_turns', (0.0,), 'of a spatial arm, how each IMU is turned on its '
                  'disc, base first: rotation vectors x, y, z, as ~/tare prints them; 0.0 alone: '
                  'not at all', -pi, pi, unit='rad'),
        Parameter('imu.stddev', 0.01, 'standard deviation of what an IMU is off all the time: '
                  'how it is mounted, and the offset of its accelerometer', 1e-6, 0.5, unit='rad'),
        Parameter('imu.acceleration_stddev', 0.05, 'standard deviation of one acceleration, '
                  'where the IMU does not tell', 1e-6, 10.0, unit='m/s^2'),
        Parameter('imu.rate_stddev', 0.003, 'standard deviation of one rate, where the IMU '
                  'does not tell', 1e-7, 1.0, unit='rad/s'),
        Parameter('imu.bias_stddev', 0.05, 'standard deviation of the bias of the gyroscope '
                  'when it is switched on', 1e-7, 10.0, unit='rad/s'),
        Parameter('imu.motion_acceleration', 1.0, 'standard deviation of the acceleration of a '
                  'disc that moves', 1e-3, 100.0, unit='m/s^2'),
    ),
    RECORDER: (
        Parameter('recorder.directory', 'recordings', 'where files are written, made when it is '
                  'not there'),
        Parameter('recorder.pictures', False, 'record the pictures of cameras too: tens of MB '
                  'per second', read_only=False),
    ),
    SERVO: (
        *ARM_PARAMETERS, FRAME, PULL_LIMITS, TENSION_LIMIT, STALE_AFTER, AMBIENT, SPEED,
        ACCELERATION, ANTAGONIST_SLACK, SOFT_VACUUM,
        Parameter('servo.rate', 25.0, 'rate of the motion that is sent', 20.0, 100.0, unit='Hz'),
        Parameter('servo.segment', 0, 'segment that follows, of an arm without jamming, 1 at the '
                  'base; 0: the last', 0, 100, read_only=False),
        Parameter('servo.horizon', 0.35, 'time after which the tendons rest when nothing more is '
                  'sent', 0.3, 2.0, read_only=False, unit='s'),
        Parameter('servo.integral_time', 0.5, 'time constant of the correction by what is '
                  'measured', 0.1, 60.0, read_only=False, unit='s'),
        Parameter('servo.response_time', 0.06, 'time by which the arm is later than its motion '
                  'was planned', 0.0, 1.0, read_only=False, unit='s'),
        Parameter('servo.extrapolation', 0.15, 'time for which a target is assumed to go on as it '
                  'moved', 0.0, 1.0, read_only=False, unit='s'),
        Parameter('servo.friction_band', 5e-5, 'pull that the friction of the tendons does not '
                  'let through: a smaller correction is not sent', 0.0, 0.01, read_only=False,
                  unit='m'),
        Parameter('servo.target_timeout', 0.5, 'age at which a target is no longer followed',
                  0.1, 10.0, read_only=False, unit='s'),
        Parameter('servo.measurement_timeout', 0.5, 'age from which a measurement corrects '
                  'nothing any more', 0.1, 10.0, read_only=False, unit='s'),
    ),
    TELEOP: (
        Parameter('teleop.bending_speed', 0.3, 'bending of the segment per second at full '
                  'deflection', 0.01, 3.0, read_only=False, unit='rad/s'),
        Parameter('teleop.tip_speed', 0.03, 'speed of the tip at full deflection', 0.001, 1.0,
                  read_only=False, unit='m/s'),
        Parameter('teleop.timeout', 0.25, 'age of the last message of the joystick at which '
                  'motion ends', 0.05, 2.0, unit='s'),
        Parameter('teleop.unchanged_timeout', 5.0, 'time after which motion ends because nothing '
                  'changes in the messages', 1.0, 60.0, unit='s'),
        *(Parameter(f'teleop.{axis}_axis', number, f'number of the axis that moves along {axis}; '
                    '-1: none', -1, 100) for axis, (number, _) in JOYSTICK_AXES.items()),
        *(Parameter(f'teleop.{axis}_scale', scale, f'part of full speed at 1 of the {axis} axis; '
                    'negative: the other way', -1.0, 1.0)
          for axis, (_, scale) in JOYSTICK_AXES.items()),
        *(Parameter(f'teleop.{name}_button', number,
                    meaning if name in NEEDED_BUTTONS else f'{meaning}; -1: none',
                    0 if name in NEEDED_BUTTONS else -1, 100)
          for name, (number, meaning) in JOYSTICK_BUTTONS.items()),
        Parameter('teleop.dead_zone', 0.15, 'deflection up to which a stick is at rest', 0.0, 0.9),
    ),
    SHAPE_SEQUENCER: (
        *ARM_PARAMETERS, SHAPE_NAMES, FRAME, PULL_LIMITS, TENSION_LIMIT, STALE_AFTER, AMBIENT,
        SPEED, ACCELERATION, ANTAGONIST_SLACK,
        Parameter('angle_step', radians(2.0), 'bending angle between two planned points',
                  radians(0.1), radians(30.0), unit='rad'),
        Parameter('angle_tolerance', radians(0.1),
                  'a segment this close to its bending angle is not set again',
                  0.0, radians(10.0), read_only=False, unit='rad'),
        SOFT_VACUUM, FULL_VACUUM, VACUUM_TOLERANCE,
        Parameter('jamming_timeout', 10.0, 'longest wait for a segment to become soft or stiff',
                  0.1, 600.0, read_only=False, unit='s'),
        Parameter('settle_timeout', 5.0, 'longest wait for the tendons to arrive after a motion',
                  0.1, 600.0, read_only=False, unit='s'),
        Parameter('settle_tolerance', 2e-5,
                  'largest distance of an arrived tendon from its planned pull; more where its '
                  'device tells that it comes no nearer',
                  1e-7, 0.01, read_only=False, unit='m'),
        Parameter('obstacles.file', '', 'YAML file with the obstacles around the arm, as '
                  'config/obstacles_example.yaml; empty: none, until the topic obstacles has '
                  'some'),
        *LOOP_PARAMETERS, *REACH_PARAMETERS,
    ),
}

DESCRIBED = tuple(name for name, table in NODE_PARAMETERS.items()
                  if set(ARM_PARAMETERS) <= set(table))
"""The nodes that are given the description of the arm."""
ALL_PARAMETERS = tuple({p.name: p for table in NODE_PARAMETERS.values() for p in table}.values())


def default_frame(namespace: str) -> str:
    """Return the frame_id of an arm: with its namespace, two arms share one TF tree."""
    return '/'.join(filter(None, [namespace.strip('/'), str(FRAME.default)]))


def jamming_settings(values: Mapping[str, Any]) -> JammingSettings:
    """Return the thresholds of jamming_valves; raises ParameterError when out of order."""
    try:
        return JammingSettings(**{f.name: values[f.name] for f in fields(JammingSettings)})
    except ValueError as error:
        raise ParameterError(str(error)) from None
