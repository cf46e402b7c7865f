# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The arm as the other nodes report it, and its interlocks.

ReportedArm is what tendon_actuation needs of jamming_valves and kinematics; ArmObserver adds what
tendon_actuation reports, for shape_sequencer and servo.
"""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from math import inf, isfinite
from time import monotonic
from typing import Any, TYPE_CHECKING

import numpy as np
from sensor_msgs.msg import FluidPressure, JointState

from soft_continuum.hardware.tendon_controller import Reason
from soft_continuum.mechanics.arm import Arm
from soft_continuum.mechanics.chain import Chain, Equilibrium
from soft_continuum.nodes.conflicts import Conflicts
from soft_continuum.nodes.suite_node import HEARTBEAT_PERIOD
from soft_continuum.ros.conversions import (
    accuracy_from_ros,
    equilibrium_from_ros,
    pulls_from_ros,
    SHAPE_FIELDS,
    Stiffness,
    stiffness_from_ros,
)
from soft_continuum.ros.entries import EVERY_STATE, SENSOR, subscribe
from soft_continuum.ros.estimates import Model, model_from_ros
from soft_continuum.ros.motion_tracker import NOT_REFERENCED
from soft_continuum.ros.names import JAMMING_VALVES, KINEMATICS, TENDON_ACTUATION
from soft_continuum.ros.ros_time import Age, RosTime
from soft_continuum.text import plain
from soft_continuum_interfaces.msg import (
    JammingValvesState,
    KinematicsState,
    TendonActuationState,
)

if TYPE_CHECKING:  # tendon_actuation does without the state machines
    from soft_continuum.sequencing.runner import Failure, Observation

MAX_DISAGREEMENT = 1.0  # s for which kinematics may not know yet what jamming_valves reported
STRAIGHT = 0.02  # rad: largest bending angle of a segment that counts as straight
UNPULLED = 1e-3  # m: largest pull of a tendon that counts as that of a straight arm
POSITIONS = f'{TENDON_ACTUATION} (tendon_states)'
SHAPES = f'{KINEMATICS} (~/state)'
PRESSURES = f'{JAMMING_VALVES} (segment_N/pressure)'
REPORTED = {POSITIONS: 'position', SHAPES: 'shape', PRESSURES: 'pressure'}
"""What the nodes report, by node and topic."""
VACUUM_ROUNDING = 1.0  # Pa
COMPUTING = 4.0
"""
Factor of stale_timeout for kinematics while no tendon moves: when a segment of a spatial arm
becomes soft, some solves take 0.3 s each, more on a busy computer.
"""


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
        now = monotonic()
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

    def observation(self, motion_failure: 'Failure | None', fault: str) -> 'Observation':
        """Return the observation of a Runner, with the failures of its requests."""
        from soft_continuum.sequencing.runner import Observation
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
