# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of closed-loop sequences."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from soft_continuum.parameters.parameter import Parameter
from soft_continuum.sequencing.loop_settings import LoopSettings, ON_ANOMALY

DEAD_BAND = 5e-5  # m
LOCK_IN_DEVIATION = 0.006  # rad
LOOP_PARAMETERS = (
    Parameter('closed_loop', True, 'correct every segment by measurements, as long as there are '
              'any', read_only=False),
    Parameter('loop.settling_time', LoopSettings.settling_time, 'time after a motion, or a change '
              'of stiffness, until the arm rests', 0.0, 60.0, read_only=False, unit='s'),
    Parameter('loop.measuring_time', LoopSettings.measuring_time,
              'time for which the arm is measured then', 0.0, 60.0, read_only=False, unit='s'),
    Parameter('loop.sensor_timeout', LoopSettings.sensor_timeout,
              'time without a measurement after which there is none', 0.1, 60.0, read_only=False,
              unit='s'),
    Parameter('loop.max_corrections', LoopSettings.max_corrections,
              'corrections of one segment before it is stiffened', 0, 20, read_only=False),
    Parameter('loop.max_passes', LoopSettings.max_passes, 'how often a shape is gone through: '
              'later segments, and more passes, make up for what stiffening shifted', 1, 10,
              read_only=False),
    Parameter('loop.abort_when_lost', LoopSettings.abort_when_lost, 'end the sequence when '
              'measurements stop in the middle of it; otherwise it goes on as predicted',
              read_only=False),
    Parameter('loop.on_anomaly', LoopSettings.on_anomaly, 'what a sequence does when kinematics '
              'reports that something is wrong with the arm: go on, abort, or pause, at rest, '
              'until this parameter is changed or the goal canceled', choices=ON_ANOMALY,
              read_only=False),
    Parameter('loop.tip_tolerance', LoopSettings.tip_tolerance, 'distance of the tip, when that '
              'is the aim, from where it should be or was when it was first held, beyond which '
              'the status warns', 1e-4, 1.0, read_only=False, unit='m'),
    Parameter('loop.angle_tolerance', LoopSettings.angle_tolerance, 'the same of bending angles',
              1e-3, 1.0, read_only=False, unit='rad'),
    Parameter('loop.correct_drift', LoopSettings.correct_drift, 'set segments again when a shape '
              'drifts by more than that while it is held', read_only=False),
    Parameter('loop.release_limit', LoopSettings.release_limit, 'a segment that carries so much '
              'that softening it would move the tip farther is never softened to correct a drift',
              0.0, 1.0, read_only=False, unit='m'),
    Parameter('loop.dead_band', DEAD_BAND, 'a correction that moves no tendon by more is not '
              'sent: friction does not let it through', 0.0, 0.01, read_only=False, unit='m'),
    Parameter('loop.lock_in_deviation', LOCK_IN_DEVIATION,
              'standard deviation of the angle by which a segment bends when it is stiffened: '
              'what setting it again cannot better', 0.0, 0.2, read_only=False, unit='rad'),
)


def loop_from_parameters(parameters: Mapping[str, Any]) -> LoopSettings:
    """Return the settings that parameters ``loop.*`` ask for."""
    return LoopSettings(**{
        field.name: parameters[f'loop.{field.name}'] for field in fields(LoopSettings)})
