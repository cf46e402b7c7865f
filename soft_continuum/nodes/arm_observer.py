# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The arm as shape_sequencer and servo observe it, from the topics of the other three nodes."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from math import inf, isfinite
from typing import Any

from sensor_msgs.msg import JointState

from soft_continuum.hardware.clock import STEADY
from soft_continuum.mechanics.arm import Arm
from soft_continuum.mechanics.chain import Chain, Equilibrium
from soft_continuum.nodes.reported_arm import NOT_REFERENCED, ReportedArm
from soft_continuum.nodes.suite_node import HEARTBEAT_PERIOD
from soft_continuum.ros.conversions import accuracy_from_ros, pulls_from_ros
from soft_continuum.ros.entries import EVERY_STATE, SENSOR, subscribe
from soft_continuum.ros.names import JAMMING_VALVES, KINEMATICS, TENDON_ACTUATION
from soft_continuum.ros.ros_time import Age, RosTime
from soft_continuum.sequencing.runner import Failure, Observation
from soft_continuum.text import plain
from soft_continuum_interfaces.msg import (
    JammingValvesState,
    KinematicsState,
    TendonActuationState,
)

# What the nodes report, by node and topic.
POSITIONS = f'{TENDON_ACTUATION} (tendon_states)'
SHAPES = f'{KINEMATICS} (~/state)'
PRESSURES = f'{JAMMING_VALVES} (segment_N/pressure)'
REPORTED = {POSITIONS: 'position', SHAPES: 'shape', PRESSURES: 'pressure'}
VACUUM_ROUNDING = 1.0  # Pa
COMPUTING = 4.0
"""
Factor of stale_timeout for kinematics while no tendon moves: when a segment of a spatial arm
becomes soft, some solves take 0.3 s each, more on a busy computer.
"""


@dataclass(frozen=True)
class TimedShape:
    """A shape of the arm, its time, and the time of the last measurement, s (steady) or None."""

    shape: Equilibrium
    time: float
    measured_time: float | None


class ArmObserver(ReportedArm):
    """
    Adds pulls, stops and faults to stiffness, vacuum and shape; stale after stale_timeout.

    A fault counts once it has lasted for stale_timeout.  estimate: with the last shape.
    """

    def __init__(self, node: Any, arm: Arm, parameters: Mapping[str, Any],
                 on_tendon_state: Callable[[TendonActuationState], None]) -> None:
        """Subscribe; call ``on_tendon_state`` with every state of tendon_actuation."""
        self._faults: dict[str, tuple[str, Age]] = {}  # by node: its fault, and for how long
        self.estimate: TimedShape | None = None
        super().__init__(node, Chain(arm), parameters)
        self.tendons = TendonActuationState()
        self.pulls = (0.0,) * len(arm.tendon_names)
        self._names, self._unmeasured = arm.tendon_names, ''
        self._pull_tolerances: tuple[float, ...] = ()  # m
        self._on_tendon_state = on_tendon_state
        self._moving, self.tendons_heard = False, False
        self._tendon_age = Age()
        self._ros_time = RosTime(node.get_clock())
        self._ages = {POSITIONS: self._tendon_age, SHAPES: self.shape_age}
        if self._jamming:
            self._ages[PRESSURES] = self.jamming_age
        subscribe(node, JointState, 'tendon_states', self._on_tendons, SENSOR)
        subscribe(node, TendonActuationState, f'{TENDON_ACTUATION}/state',
                  self._on_tendon_actuation, EVERY_STATE)

    # Messages.

    def _on_tendons(self, message: JointState) -> None:
        try:
            pulls = pulls_from_ros(message, self._names)
        except ValueError:  # kinematics reports it; without others they are stale soon
            return
        self.pulls = tuple(pulls.tolist())
        self._moving = any(message.velocity)
        self._unmeasured = ', '.join(
            plain(name) for name, effort in zip(message.name, message.effort, strict=False)
            if not isfinite(effort))
        self._tendon_age.refresh()

    def _on_tendon_actuation(self, state: TendonActuationState) -> None:
        self.tendons, self.tendons_heard = state, True
        with suppress(ValueError):  # kinematics reports it; what was told before still counts
            self._pull_tolerances = accuracy_from_ros(state, self._names).pull_tolerances
        lost = state.connected and not state.referenced
        if lost:
            self.clear_shape()
            self._tendon_age.clear()
            self._moving = False  # the state tells: no pulls follow that would
        self._note_fault(TENDON_ACTUATION, state.fault or NOT_REFERENCED * lost)
        self._on_tendon_state(state)

    def _on_shape(self, message: KinematicsState) -> None:
        before = self._reported
        super()._on_shape(message)
        if self._reported is None or self._reported is before:
            return
        now = STEADY()
        time, measured = self._ros_time.steady(message.stamp), self.measured
        self.estimate = TimedShape(self._reported[0], now if time is None else min(time, now),
                                   None if measured is None else min(measured, now))

    def _on_jamming_valves(self, state: JammingValvesState) -> None:
        super()._on_jamming_valves(state)
        faults = [state.fault, *state.segment_faults]
        self._note_fault(JAMMING_VALVES, '; '.join(fault for fault in faults if fault))

    def _note_fault(self, node: str, fault: str) -> None:
        _, age = self._faults.get(node, ('', Age.now()))
        if fault:
            self._faults[node] = fault, age
        else:
            self._faults.pop(node, None)

    # The arm.

    @property
    def all_stiff(self) -> bool:
        """Whether every segment is stiff; always true without jamming."""
        return not self._jamming or all(self.stiff)

    @property
    def regulators(self) -> bool:
        """Whether regulators hold the vacuum of each segment, in place of valves."""
        return bool(self.stiffness.setpoints)

    @property
    def moves(self) -> bool:
        """Whether a tendon moves, or may still move to its set-point."""
        return self._moving or self.tendons.moving

    @property
    def stopped(self) -> str:
        """Why tendon motion is stopped; empty when it is not."""
        if self.tendons.stopped == TendonActuationState.NOT_STOPPED:
            return ''
        return self.tendons.stop_message or 'tendon_actuation is stopped'

    @property
    def reported_fault(self) -> str:
        """Reported faults of the arm; empty for none."""
        if problem := self.conflicts.problem:
            return problem
        timeout = self.timeout
        faults = [f'{node}: {fault}' for node, (fault, age) in self._faults.items()
                  if age.seconds > timeout]
        if self._unmeasured:
            faults.append(f'{TENDON_ACTUATION}: the tension of {self._unmeasured} is not measured')
        return '; '.join(faults)

    @property
    def fault(self) -> str:
        """Why the arm cannot be operated; empty when it can."""
        return self._fault(self.timeout)

    def _fault(self, shape_timeout: float) -> str:
        """Return the fault; shape_timeout: s after which kinematics is stale."""
        if faults := self.reported_fault:
            return faults
        if self.tendons.connected and not self.tendons.referenced:
            return f'{TENDON_ACTUATION}: {NOT_REFERENCED}'
        if missing_sources := self.missing_sources:
            return (f'nothing received yet from {", ".join(missing_sources)}; check that they '
                    'run, and their status')
        stale = {name: timeout for name, age in self._ages.items() if age.seconds > (
            timeout := shape_timeout if age is self.shape_age else self.timeout)}
        if not stale:
            return ''
        # A node that is gone, or is so in a moment, may be why others, which run, report nothing.
        if all(age.seconds - self.conflicts.heartbeat_age(source.split()[0]) > HEARTBEAT_PERIOD
               for source, age in self._ages.items() if age.seconds > 0.5 * self.timeout):
            source, timeout = next(iter(stale.items()))
            return (f'{source.split()[0]} runs, but has reported no {REPORTED[source]} for '
                    f'{timeout:g} s; its status has the reason')
        return f'nothing received for {min(stale.values()):g} s from {", ".join(stale)}'

    @property
    def missing_sources(self) -> list[str]:
        """
        Sources from which nothing was received yet since the start or ~/reference.

        Nodes and topics.
        """
        missing_sources = [name for name, age in self._ages.items() if age.seconds == inf]
        if not self.tendons_heard:
            missing_sources.append(f'{TENDON_ACTUATION} (~/state)')
        if None in self.stiff:
            missing_sources.append(f'{JAMMING_VALVES} (~/state)')
        return missing_sources

    @property
    def interlock(self) -> str:
        """Why no sequence may start now; empty if one may."""
        if fault := self.reported_fault:
            return fault
        if self.stopped:
            return (f'tendon motion is stopped ({self.stopped}); '
                    'call tendon_actuation/resume first')
        return self.fault

    @property
    def measured(self) -> float | None:
        """When the arm was last measured, s (steady); None for never."""
        return self._ros_time.steady(self.kinematics.measured)

    def _lost(self, node: str, age: Age) -> bool:
        """Return whether a node is gone: with its device alone, its signs of life would come."""
        return age.seconds > self.timeout and self.conflicts.lost(node, self.timeout)

    @property
    def _vacuums_agreed(self) -> bool:
        """Whether kinematics has the set-points of regulators as vacuums of jams with a law."""
        full = self.parameters['full_vacuum']
        segments = zip(
            self.kinematics.vacuum, self.stiffness.setpoints, self._elastic, strict=False)
        return all(abs(part * full - min(full, setpoint)) <= VACUUM_ROUNDING
                   for part, setpoint, elastic in segments if elastic and setpoint)

    def observation(self, motion_failure: Failure | None, fault: str) -> Observation:
        """Return the observation of a Runner, with the failures of its requests."""
        ambient = self.parameters['ambient_pressure']
        return Observation(
            pulls=self.pulls, pull_tolerances=self._pull_tolerances, moving=self.moves,
            stiff=tuple(bool(stiff) for stiff in self.stiff),
            vacuum=tuple(ambient - pressure for pressure in self.pressures),
            stopped=self.stopped, stops=self.tendons.stops,
            fault=self._fault(self.timeout * (1.0 if self.moves else COMPUTING)) or fault,
            motion_failure=motion_failure, measured=self.measured,
            anomaly='; '.join(one.message for one in self.kinematics.anomalies),
            regulators=self.regulators,
            lost_tendons=self._lost(TENDON_ACTUATION, self._tendon_age),
            lost_valves=self._lost(JAMMING_VALVES, self.jamming_age),
            agreed=self.agreed and self._vacuums_agreed)
