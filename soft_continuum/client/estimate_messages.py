# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Estimate and Anomaly from the messages of kinematics."""

from soft_continuum.client.estimate import Anomaly, Estimate, LearnedParameter
from soft_continuum.ros.conversions import seconds
from soft_continuum.text import MAX_ITEMS, MAX_NAME, printable
from soft_continuum_interfaces.msg import Anomaly as AnomalyMessage
from soft_continuum_interfaces.msg import KinematicsState

CAUSES = {getattr(AnomalyMessage, name): name.lower().replace('_', ' ') for name in (
    'UNKNOWN', 'TENDON_SLIPPED', 'STEPS_LOST', 'NOT_STIFF', 'NOT_SOFT', 'LOAD', 'SENSOR_MOVED',
    'CAMERA_MOVED')}


def estimate_of(message: KinematicsState, received: float, predicted_tip_error: float | None
                ) -> Estimate:
    """
    Return the Estimate in kinematics/state.

    received: s since the message came.  predicted_tip_error: m, None if unknown.
    """
    measured = seconds(message.measured)
    return Estimate(
        message.source == KinematicsState.ESTIMATED,
        max(0.0, seconds(message.stamp) - measured) + received if measured > 0.0 else None,
        tuple(message.angle_stddevs[:MAX_ITEMS]), tuple(message.tip_covariance[:36]),
        predicted_tip_error,
        tuple(LearnedParameter(printable(p.name, MAX_NAME), float(p.value), float(p.stddev),
                               bool(p.determined), printable(p.problem))
              for p in message.parameters[:MAX_ITEMS]),
        tuple(map(anomaly_of, message.anomalies[:MAX_ITEMS])))


def anomaly_of(message: AnomalyMessage) -> Anomaly:
    """Return the Anomaly from its message."""
    return Anomaly(CAUSES.get(message.cause, CAUSES[AnomalyMessage.UNKNOWN]), message.segment,
                   message.disc, printable(message.tendon, MAX_NAME), float(message.size),
                   printable(message.message))
