# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""State of the arm as reported by jamming_valves and kinematics, and its interlocks."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from sensor_msgs.msg import FluidPressure

from soft_continuum.hardware.tendon_controller import Reason
from soft_continuum.mechanics.chain import Chain, Equilibrium
from soft_continuum.nodes.conflicts import Conflicts
from soft_continuum.ros.conversions import (
    equilibrium_from_ros,
    SHAPE_FIELDS,
    Stiffness,
    stiffness_from_ros,
)
from soft_continuum.ros.entries import EVERY_STATE, SENSOR, subscribe
from soft_continuum.ros.estimates import Model, model_from_ros
from soft_continuum.ros.names import JAMMING_VALVES, KINEMATICS
from soft_continuum.ros.ros_time import Age
from soft_continuum_interfaces.msg import JammingValvesState, KinematicsState

MAX_DISAGREEMENT = 1.0  # s for which kinematics may not know yet what jamming_valves reported
STRAIGHT = 0.02  # rad: largest bending angle of a segment that counts as straight
UNPULLED = 1e-3  # m: largest pull of a tendon that counts as that of a straight arm
NOT_REFERENCED = ('the position of the tendons is not referenced; straighten the arm and call '
                  'tendon_actuation/reference')


@dataclass(frozen=True)
class Interlock:
    """Why the tendons must not move; reason: as in MotionRequest."""

    reason: Reason
    message: str


def bent(shape: Equilibrium | None, jamming: bool) -> str:
    """
    Return the most bent segment as text; empty for a straight arm, or None.

    Empty without jamming: the bend of such an arm under its weight does not affect the zero.
    """
    if shape is None or not jamming:
        return ''
    angles = np.abs(shape.bending_angles)
    most = int(angles.argmax())
    return f'segment {most + 1} was bent by {angles[most]:.3f} rad' * bool(angles[most] > STRAIGHT)


class ReportedArm:
    """
    Stiffness, vacuum and shape of the arm as jamming_valves and kinematics report them.

    A device may miss a reply: until its pressures are stale, a segment keeps its last known
    stiffness.  The ROS thread writes, any thread reads: every value is replaced as a whole.
    """

    def __init__(self, node: Any, chain: Chain, parameters: Mapping[str, Any]) -> None:
        """Subscribe for ``node``; parameters: with arm.jamming and stale_timeout, s."""
        self.chain, self.parameters = chain, parameters
        self._jamming: bool = parameters['arm.jamming']
        self._elastic = [not segment.jam.rigid for segment in chain.arm.segments]
        self.stiffness = Stiffness((None if self._jamming else False,) * chain.segments)
        self.conflicts = Conflicts(node, chain.segments)
        self.pressures = [float('nan')] * chain.segments
        self._reported: tuple[Equilibrium, KinematicsState] | None = None
        self.jamming_age, self.shape_age = Age(), Age()
        self._agreed = Age.now()  # since kinematics had the segments stiff that jamming_valves has
        subscribe(node, KinematicsState, f'{KINEMATICS}/state', self._on_shape, SENSOR)
        if self._jamming:
            subscribe(node, JammingValvesState, f'{JAMMING_VALVES}/state',
                      self._on_jamming_valves, EVERY_STATE)
        for i in range(chain.segments if self._jamming else 0):
            subscribe(node, FluidPressure, f'segment_{i + 1}/pressure',
                      partial(self._on_pressure, i), SENSOR)

    def _on_jamming_valves(self, state: JammingValvesState) -> None:
        self.stiffness = stiffness_from_ros(state, self.stiffness)

    def _on_pressure(self, segment: int, message: FluidPressure) -> None:
        self.pressures[segment] = message.fluid_pressure
        self.jamming_age.refresh()

    def _on_shape(self, message: KinematicsState) -> None:
        last = self._reported
        # At rest the same shape comes again, which need not be computed again.
        same = last is not None and all(getattr(message, name) == getattr(last[1], name)
                                        for name in SHAPE_FIELDS)
        shape = last[0] if last is not None and same else equilibrium_from_ros(message, self.chain)
        if shape is not None:
            self._reported = shape, message
            self.shape_age.refresh()
            if self.agreed:
                self._agreed.refresh()

    def clear_shape(self) -> None:
        """Wait for another shape: the reported one is no longer valid."""
        self.shape_age.clear()

    @property
    def last_bent(self) -> str:
        """Last known bend of the arm as text; empty for straight."""
        return '' if self._reported is None else bent(self._reported[0], self._jamming)

    @property
    def agreed(self) -> bool:
        """Whether kinematics and jamming_valves report the same jammed segments."""
        return not self._jamming or tuple(self.kinematics.stiff) == self.jammed(self.stiffness)

    @property
    def stiff(self) -> tuple[bool | None, ...]:
        """Which segments are confirmed stiff."""
        return self.stiffness.confirmed

    def jammed(self, stiffness: Stiffness) -> tuple[bool | None, ...]:
        """Return in which segments the model has a jam, whatever its vacuum."""
        return stiffness.jammed(self._elastic)

    @property
    def timeout(self) -> float:
        """Age at which reports are stale, s."""
        return float(self.parameters['stale_timeout'])

    @property
    def _known(self) -> tuple[Equilibrium, KinematicsState] | None:
        reported = self._reported
        return None if self.shape_age.seconds > self.timeout else reported

    @property
    def shape(self) -> Equilibrium | None:
        """The present state of the model; None if unknown."""
        known = self._known
        return None if known is None else known[0]

    @property
    def shape_and_model(self) -> tuple[Equilibrium, Model] | None:
        """
        The present state of the estimated arm, and that arm; None if unknown.

        The arm is built from the estimate: for plans, not for every message.
        """
        known = self._known
        if known is None:
            return None
        shape, message = known
        model = model_from_ros(message.parameters, self.chain.arm)
        return replace(shape, chain=model.chain), model

    @property
    def kinematics(self) -> KinematicsState:
        """Last status of kinematics on the shape; empty before the first."""
        return KinematicsState() if self._reported is None else self._reported[1]

    @property
    def _stiffness_known(self) -> bool:
        return not self._jamming or (
            None not in self.stiff and self.jamming_age.seconds <= self.timeout)

    def motion_interlock(self) -> Interlock | None:
        """Return why the arm must not be moved now, None if it may."""
        if problem := self.conflicts.problem:
            return Interlock(Reason.CONFLICT, problem)
        if not self._stiffness_known:
            return Interlock(
                Reason.STIFFNESS_UNKNOWN,
                'it is not known which segments are soft: nothing received from jamming_valves '
                f'for {self.timeout:g} s')
        if not self._jamming and any(self.kinematics.stiff):
            return Interlock(
                Reason.STIFFNESS_UNKNOWN, 'arm.jamming is false here, but kinematics reports '
                'stiff segments: start all nodes with one description')
        if all(self.stiff):
            return Interlock(
                Reason.ALL_STIFF, 'every segment is stiff; soften one first '
                '(jamming_valves/segment_N/set_stiff)')
        if self.shape is None:
            return Interlock(
                Reason.SHAPE_UNKNOWN,
                'the shape of the arm is not known, so no tension can be predicted: no '
                f'shape received from kinematics for {self.timeout:g} s')
        if self._agreed.seconds > max(self.timeout, MAX_DISAGREEMENT):
            return Interlock(
                Reason.STIFFNESS_UNKNOWN, 'kinematics has other segments stiff than '
                'jamming_valves reports: start all nodes with one description (is arm.jamming the '
                'same for all?)')
        return None

    def homing_interlock(self) -> Interlock | None:
        """Return why the tendons must not be homed now, None if they may."""
        if problem := self.conflicts.problem:
            return Interlock(Reason.CONFLICT, problem)
        if not self._jamming:
            return Interlock(
                Reason.HOMING, 'homing pays out the tendons, and nothing else holds an arm '
                'without jamming: set the zero by hand (grbl.homed_pulls: [0.0])')
        if not self._stiffness_known:
            return Interlock(
                Reason.STIFFNESS_UNKNOWN, 'it is not known whether the arm is stiff: '
                f'nothing received from jamming_valves for {self.timeout:g} s')
        if not all(self.stiff):
            return Interlock(
                Reason.STIFFNESS_CHANGED,
                'homing pays out the tendons: stiffen every segment')
        if problem := bent(self.shape, self._jamming):
            return Interlock(
                Reason.HOMING, 'homing ends where the straight arm has its tendons just taut, '
                f'but {problem}: straighten the arm, and call kinematics/reset if kinematics is '
                'wrong')
        return None
