# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The arm as shape_sequencer observes it, from the topics of the other three nodes."""

from collections.abc import Callable, Mapping
from math import pi
from typing import Any

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import FluidPressure, JointState

from soft_continuum.mechanics.arm import Arm
from soft_continuum.mechanics.chain import Equilibrium, RigidChain
from soft_continuum.ros.age import Age
from soft_continuum.ros.names import JAMMING_VALVES, KINEMATICS, TENDON_ACTUATION
from soft_continuum.ros.qos import EVERY_STATE, SENSOR
from soft_continuum.sequencing.runner import Failure, Observation
from soft_continuum_interfaces.msg import JammingValvesState, TendonActuationState

MAX_JOINT_ANGLE = pi  # rad


class ArmObserver:
    """
    Pulls, stiffness, vacuum, shape, stops and faults of the arm; stale after silence_timeout.

    A device may miss an answer or two: a fault counts once it has lasted for silence_timeout, and
    until then a segment keeps the stiffness that was last known.
    """

    def __init__(self, node: Node, arm: Arm, parameters: Mapping[str, Any],
                 on_tendon_state: Callable[[TendonActuationState], None]) -> None:
        """Subscribe; call ``on_tendon_state`` with every state of tendon_actuation."""
        self.tendons = TendonActuationState()
        self.shape: Equilibrium | None = None
        self.pulls = (0.0,) * len(arm.tendon_names)
        self._arm = arm
        self._chain = RigidChain(arm)
        self._parameters = parameters
        self._on_tendon_state = on_tendon_state
        self._moving = False
        self._stiff: list[bool | None] = [None] * len(arm.segments)
        self._vacuum = [0.0] * len(arm.segments)
        self._faults: dict[str, tuple[str, Age]] = {}  # by node: its fault, and for how long
        self._ages = {f'{TENDON_ACTUATION} (tendon_states)': Age(),
                      f'{JAMMING_VALVES} (segment_N/pressure)': Age(),
                      f'{KINEMATICS} (joint_states)': Age()}
        self._tendon_age, self._jamming_age, self._shape_age = self._ages.values()
        node.create_subscription(JointState, 'tendon_states', self._on_tendons, SENSOR)
        node.create_subscription(JointState, 'joint_states', self._on_shape, SENSOR)
        node.create_subscription(
            TendonActuationState, f'{TENDON_ACTUATION}/state', self._on_tendon_actuation,
            EVERY_STATE)
        node.create_subscription(
            JammingValvesState, f'{JAMMING_VALVES}/state', self._on_jamming_valves, EVERY_STATE)
        for i in range(len(arm.segments)):
            node.create_subscription(
                FluidPressure, f'segment_{i + 1}/pressure',
                lambda message, i=i: self._on_pressure(i, message.fluid_pressure), SENSOR)

    # Messages.

    def _on_tendons(self, message: JointState) -> None:
        positions = dict(zip(message.name, message.position, strict=False))
        if positions.keys() == set(self._arm.tendon_names) and np.isfinite(message.position).all():
            self.pulls = tuple(positions[name] for name in self._arm.tendon_names)
            self._moving = any(message.velocity)
            self._tendon_age.refresh()

    def _on_shape(self, message: JointState) -> None:
        angles = np.array(message.position)
        if len(angles) == self._chain.joints and np.all(np.abs(angles) <= MAX_JOINT_ANGLE):
            self.shape = self._chain.state(angles)
            self._shape_age.refresh()

    def _on_pressure(self, segment: int, pressure: float) -> None:
        self._vacuum[segment] = self._parameters['ambient_pressure'] - pressure
        self._jamming_age.refresh()

    def _on_tendon_actuation(self, state: TendonActuationState) -> None:
        self.tendons = state
        self._note_fault(TENDON_ACTUATION, state.fault)
        self._on_tendon_state(state)

    def _on_jamming_valves(self, state: JammingValvesState) -> None:
        if len(state.stiffness) == len(self._stiff):
            self._stiff = [
                before if now == JammingValvesState.UNKNOWN else now == JammingValvesState.STIFF
                for before, now in zip(self._stiff, state.stiffness, strict=True)]
        faults = [state.fault, *state.segment_faults]
        self._note_fault(JAMMING_VALVES, '; '.join(fault for fault in faults if fault))

    def _note_fault(self, node: str, fault: str) -> None:
        if not fault:
            self._faults.pop(node, None)
            return
        _, age = self._faults.get(node, ('', None))
        if age is None:
            age = Age()
            age.refresh()
        self._faults[node] = fault, age

    # The arm.

    @property
    def all_stiff(self) -> bool:
        """Whether every segment is stiff."""
        return all(self._stiff)

    @property
    def stopped(self) -> str:
        """Why tendon motion is stopped; empty when it is not."""
        if self.tendons.stopped == TendonActuationState.NOT_STOPPED:
            return ''
        return self.tendons.stop_message or 'tendon_actuation is stopped'

    @property
    def fault(self) -> str:
        """Why the arm cannot be operated: a lasting fault or a stale node; empty when it can."""
        timeout = self._parameters['silence_timeout']
        faults = '; '.join(f'{node}: {fault}' for node, (fault, age) in self._faults.items()
                           if age.seconds > timeout)
        if faults:
            return faults
        stale = [name for name, age in self._ages.items() if age.seconds > timeout]
        if None in self._stiff:
            stale.append(f'{JAMMING_VALVES} (~/state)')
        return f'nothing received for {timeout:g} s from {", ".join(stale)}' if stale else ''

    @property
    def interlock(self) -> str:
        """Why no sequence may begin now; empty when one may."""
        if fault := self.fault:
            return fault
        if self.stopped:
            return (f'tendon motion is stopped ({self.stopped}); '
                    'call tendon_actuation/resume first')
        if not self.tendons.referenced:
            return ('the position of the tendons is not referenced; straighten the arm and call '
                    'tendon_actuation/reference first')
        return ''

    def observation(self, motion_failure: Failure | None, fault: str) -> Observation:
        """Return what a Runner needs, with the failures of what it has requested."""
        return Observation(
            pulls=self.pulls, moving=self._moving or self.tendons.moving,
            stiff=tuple(bool(stiff) for stiff in self._stiff), vacuum=tuple(self._vacuum),
            stopped=self.stopped, fault=self.fault or fault, motion_failure=motion_failure)
