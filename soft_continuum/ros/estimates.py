# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The estimate of kinematics as a message, and the model that other nodes build from it."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, log
from typing import TYPE_CHECKING

import numpy as np

from soft_continuum.estimation.unknowns import arm_with, first_values, indices_of, limited, Prior
from soft_continuum.mechanics.arm import Arm, ArmError, Array
from soft_continuum.mechanics.chain import Chain
from soft_continuum.mechanics.laws import LawError
from soft_continuum.mechanics.rotations import levers
from soft_continuum.ros.ros_time import stamp_of
from soft_continuum_interfaces.msg import Anomaly as AnomalyMessage
from soft_continuum_interfaces.msg import EstimatedParameter, KinematicsState

if TYPE_CHECKING:  # those who only read an estimate need not load it: 0.4 s
    from soft_continuum.estimation.anomalies import Anomaly
    from soft_continuum.estimation.estimator import Estimator

PLAUSIBLE_FACTORS = (0.4, 2.5)  # stiffness over the described one
PLAUSIBLE_OFFSET = 0.005  # m
RATIO = 'stiff_ratio_'


@dataclass(frozen=True, eq=False)
class Model:
    """
    The arm as other nodes plan and predict with it.

    chain: of the arm as it is described, or estimated.  offsets: (tendons,) m by which each tendon
    is pulled in beyond its motor position.  offset_stddevs: (tendons,) m.
    """

    chain: Chain
    offsets: Array
    offset_stddevs: Array


def parameter_names(arm: Arm) -> tuple[str, ...]:
    """
    Return the published names of estimated parameters of an arm.

    Those of K, which begin with RATIO, are not published without jamming.
    """
    numbers = range(1, len(arm.segments) + 1)
    return (*(f'stiffness_factor_{n}' for n in numbers), *(f'{RATIO}{n}' for n in numbers),
            *(f'offset_{name}' for name in arm.tendon_names), 'payload')


def estimate_to_ros(estimator: 'Estimator', covariances: Array,
                    parameters: Sequence[EstimatedParameter], message: KinematicsState) -> None:
    """
    Write an estimate into a message.

    covariances: (discs, 6, 6) of the discs' poses, base first.  parameters: of
    parameters_to_ros.
    """
    from soft_continuum.estimation.measuring import angle_stddevs
    state = estimator.state
    message.source = KinematicsState.ESTIMATED
    if estimator.measured is not None:
        message.measured = stamp_of(estimator.measured)
    message.angle_stddevs = angle_stddevs(state, covariances).tolist()
    to_tip = levers(state.poses[-1, :3] - state.poses[-2, :3])
    message.tip_covariance = (to_tip @ covariances[-1] @ to_tip.T).ravel().tolist()
    message.parameters = parameters


def parameters_to_ros(estimator: 'Estimator', jamming: bool = True) -> list[EstimatedParameter]:
    """Return the estimated parameters of the arm; without jamming there is no K."""
    where = estimator.layout.parameters
    rows = zip(parameter_names(estimator.arm), estimator.values[where],
               estimator.stddevs()[where], estimator.determined(), strict=True)
    found = []
    for name, value, stddev, determined in rows:
        if name.startswith(RATIO) and not jamming:
            continue
        if name.startswith('stiff'):  # of their logarithms
            value = exp(value)
            stddev *= value
        found.append(EstimatedParameter(
            name=name, value=float(value), stddev=float(stddev), determined=bool(determined),
            problem=_problem(name, float(value))))
    return found


def anomaly_to_ros(anomaly: 'Anomaly') -> AnomalyMessage:
    """Return an anomaly as a message."""
    return AnomalyMessage(
        stamp=stamp_of(anomaly.time), cause=getattr(AnomalyMessage, anomaly.cause.name),
        segment=anomaly.segment, disc=anomaly.disc, tendon=anomaly.tendon, size=anomaly.size,
        message=anomaly.message)


def _problem(name: str, value: float) -> str:
    """Return why a value is not plausible; empty when it is."""
    low, high = PLAUSIBLE_FACTORS
    if name.startswith('stiffness_factor') and not low < value < high:
        return (f'{value:.2f} times the described stiffness; plausible: {low:g} to {high:g}; is '
                'the segment the described one, and do its tendons run freely?')
    if name.startswith('offset') and abs(value) > PLAUSIBLE_OFFSET:
        return (f'{value * 1e3:.1f} mm; plausible: up to {PLAUSIBLE_OFFSET * 1e3:g} mm; did the '
                'tendon slip, or was the arm not straight when it was referenced?')
    return ''


def model_from_ros(parameters: Sequence[EstimatedParameter], arm: Arm) -> Model:
    """
    Return the model of a described arm with published parameters.

    Without parameters, or with invalid ones or those of another arm, it is the described arm.
    """
    described = Model(Chain(arm), *np.zeros((2, len(arm.tendons))))
    found = {one.name: one for one in parameters}
    names = parameter_names(arm)
    if set(names) - set(found) not in (set(), {n for n in names if n.startswith(RATIO)}) or (
            set(found) - set(names)) or not all(
            np.isfinite(one.value) and np.isfinite(one.stddev) for one in parameters):
        return described
    layout = indices_of(arm)
    values = first_values(arm, layout, Prior())
    for place, name in enumerate(names, layout.parameters.start):
        if name in found:
            value = found[name].value
            values[place] = log(max(value, 1e-9)) if name.startswith('stiff') else value
    values = limited(values, layout)
    try:
        estimated = arm_with(arm, layout, values)
    except (ArmError, LawError):  # such as a spring stiffer than what is measured of its jam
        return described
    return Model(Chain(estimated), values[layout.offset],
                 np.array([found[f'offset_{name}'].stddev for name in arm.tendon_names]))
