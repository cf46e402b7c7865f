# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of every node."""

from collections.abc import Mapping
from dataclasses import fields
from math import radians
from typing import Any

from soft_continuum.hardware.drivers import (
    driver_names,
    driver_parameters,
    JAMMING_DRIVERS,
    TENDON_DRIVERS,
)
from soft_continuum.hardware.jamming_controller import JammingSettings
from soft_continuum.parameters.arm import ARM_PARAMETERS
from soft_continuum.parameters.parameter import Parameter, ParameterError
from soft_continuum.parameters.shapes import SHAPE_PARAMETERS

AUTOSTART = Parameter(
    'autostart', True, 'configure and activate the node by itself when it starts')
FRAME = Parameter(
    'frame_id', 'base_link', 'frame of the bottom centre of the base disc, z along the arm')
AMBIENT = Parameter('ambient_pressure', 101325.0, 'absolute ambient pressure, Pa', 1e4, 2e5)
SILENCE = Parameter(
    'silence_timeout', 0.5, 'age at which the state of another node counts as lost, s', 0.1, 10.0)
PULL_LIMITS = Parameter(
    'pull_limits', (-0.06, 0.06), 'smallest and largest tendon pull, m; negative is let out',
    -1.0, 1.0, is_range=True)
TENSION_LIMIT = Parameter(
    'tension_limit', 60.0, 'largest tendon tension that the model may predict, N', 0.1, 1e4,
    read_only=False)
CO_CONTRACTION_LIMIT = Parameter(
    'co_contraction_limit', 5.0,
    'largest tension that the model may predict in both tendons at once, N', 0.01, 1e4,
    read_only=False)

NODE_PARAMETERS: dict[str, tuple[Parameter, ...]] = {
    'tendon_actuation': (
        *ARM_PARAMETERS, AUTOSTART, PULL_LIMITS, TENSION_LIMIT, CO_CONTRACTION_LIMIT, SILENCE,
        Parameter('tendon_driver', 'simulated', 'driver of the steppers',
                  choices=driver_names(TENDON_DRIVERS)),
        Parameter('tendon_rate', 50.0, 'rate of control and of tendon_states, Hz', 5.0, 500.0),
        Parameter('speed_limit', 0.03, 'largest tendon speed, m/s', 1e-4, 1.0),
        Parameter('acceleration_limit', 0.3, 'largest tendon acceleration, m/s^2', 1e-3, 100.0),
        *driver_parameters(TENDON_DRIVERS),
    ),
    'jamming_valves': (
        *ARM_PARAMETERS, AUTOSTART, AMBIENT,
        Parameter('jamming_driver', 'simulated', 'driver of pump, valves and pressure sensors',
                  choices=driver_names(JAMMING_DRIVERS)),
        Parameter('jamming_rate', 20.0, 'rate of control and of the pressures, Hz', 5.0, 100.0),
        Parameter('stiff_vacuum', 50e3, 'vacuum below ambient from which a segment is stiff, Pa',
                  1e3, 101e3),
        Parameter('release_vacuum', 40e3,
                  'vacuum below ambient under which a segment is no longer stiff, Pa', 1e3, 101e3),
        Parameter('pump_start_vacuum', 60e3,
                  'the pump starts when an evacuated segment has less vacuum, Pa', 1e3, 101e3),
        Parameter('pump_stop_vacuum', 80e3,
                  'the pump rests when every evacuated segment has more vacuum, Pa', 1e3, 101e3),
        *driver_parameters(JAMMING_DRIVERS),
    ),
    'kinematics': (
        *ARM_PARAMETERS, FRAME, TENSION_LIMIT,
        Parameter('straight_tolerance', 0.0005,
                  'largest pull at which ~/reset takes a stiff arm to be straight, and by which '
                  'the tendons may be too short for a stiff arm, m',
                  0.0, 0.1),
    ),
    'shape_sequencer': (
        *ARM_PARAMETERS, *SHAPE_PARAMETERS, FRAME, PULL_LIMITS, TENSION_LIMIT, SILENCE,
        AMBIENT,
        Parameter('tendon_speed', 0.015, 'largest tendon speed of a planned motion, m/s',
                  1e-4, 1.0, read_only=False),
        Parameter('tendon_acceleration', 0.1, 'largest tendon acceleration of a plan, m/s^2',
                  1e-3, 10.0, read_only=False),
        Parameter('antagonist_slack', 0.0005,
                  'slack left in the tendon that does not carry the soft segment, m', 0.0, 0.05,
                  read_only=False),
        Parameter('angle_step', radians(2.0), 'bending angle between two planned points, rad',
                  radians(0.1), radians(30.0)),
        Parameter('angle_tolerance', radians(0.1),
                  'a segment this close to its bending angle is not set again, rad',
                  0.0, radians(10.0), read_only=False),
        Parameter('soft_vacuum', 10e3, 'vacuum below ambient up to which a segment is soft, Pa',
                  100.0, 101e3),
        Parameter('jamming_timeout', 10.0, 'longest wait for a segment to become soft or stiff, s',
                  0.1, 600.0, read_only=False),
        Parameter('settle_timeout', 5.0, 'longest wait for tendons to arrive after a motion, s',
                  0.1, 600.0, read_only=False),
        Parameter('settle_tolerance', 2e-5, 'distance from a planned pull that counts as there, m',
                  1e-7, 0.01, read_only=False),
    ),
}

ALL_PARAMETERS = tuple({p.name: p for table in NODE_PARAMETERS.values() for p in table}.values())


def jamming_settings(values: Mapping[str, Any]) -> JammingSettings:
    """Return the thresholds of jamming_valves; raises ParameterError when out of order."""
    try:
        return JammingSettings(**{f.name: values[f.name] for f in fields(JammingSettings)})
    except ValueError as error:
        raise ParameterError(str(error)) from None
