# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The node that owns pump, valves or regulators, and pressure sensors, and its control thread."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import isclose
from typing import Any

from sensor_msgs.msg import FluidPressure
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

from soft_continuum.hardware.clock import STEADY
from soft_continuum.hardware.drivers import families, JAMMING_DRIVERS
from soft_continuum.hardware.jamming_controller import JammingController
from soft_continuum.hardware.protocols import HardwareError, JammingDriver, RegulatorDriver
from soft_continuum.nodes.conflicts import Conflicts
from soft_continuum.nodes.emergency_stop import EmergencyStop
from soft_continuum.nodes.managed_node import DeviceControl, ManagedNode, RestingStream
from soft_continuum.nodes.suite_node import ERROR, OK, StatePublisher
from soft_continuum.nodes.threads import Newest
from soft_continuum.parameters.arm import arm_from_parameters, require_jamming
from soft_continuum.ros.entries import LATCHED, serve, STREAM
from soft_continuum.ros.names import JAMMING_VALVES
from soft_continuum.ros.parameter_table import jamming_settings
from soft_continuum_interfaces.msg import JammingValvesState
from soft_continuum_interfaces.srv import SetVacuum

REST_CHANGE = 200.0  # Pa of pressure


@dataclass(frozen=True)
class Report:
    """
    State after a cycle or a request.

    pressures: last reading, absolute, Pa; None before the first.  time: of that reading, s
    (steady).
    """

    state: JammingValvesState
    pressures: tuple[float, ...] | None
    time: float


class JammingControl(DeviceControl):
    """
    Switches segments and watches their pressures; its snapshots are Reports.

    No device is ``lost``: the driver itself reconnects to boards that did not reply.
    """

    _controller: JammingController | None

    def __init__(self, segments: int, report: Callable[[Report], None]) -> None:
        """Start without a device."""
        super().__init__(report)
        self._segments = segments
        self._pressures: tuple[float, ...] | None = None
        self._time = 0.0
        self._stream = RestingStream(REST_CHANGE)

    def attach(self, device: JammingController) -> None:
        """Control a connected device from now on."""
        super().attach(device)
        self._pressures = None
        self.report()

    def deactivate(self) -> None:
        """Leave pump and valves as they are."""
        self._active, self._fault, self._pressures = False, '', None  # of then, when active again
        self.report()

    def failed(self, error: Exception) -> None:
        """Report an error of this program like a failed device."""
        self.not_connected(f'control failed: {type(error).__name__}: {error}')

    def cycle(self, _: float) -> None:
        """Read the pressures, decide which segments are stiff, switch the pump if needed."""
        if not self._active or self._controller is None:
            return
        time = STEADY()
        try:
            self._pressures = tuple(self._controller.update().pressures)
        except HardwareError as error:
            self.not_connected(str(error))
            return
        changed, self._fault, self._time = bool(self._fault), '', time
        controller = self._controller
        reading = controller.reading
        state = tuple(controller.stiff), controller.faults, reading.pump, reading.vacuums
        if self._stream.due(time, state, self._pressures) or changed:
            self.report()

    def command(self, command: Callable[[JammingController], None]) -> None:
        """
        Switch segments; command: does so by a controller.

        Raises ValueError when the node is not active or for what cannot be set, HardwareError when
        the device fails.
        """
        if not self._active or self._controller is None:
            raise ValueError('not switched: the node is not active')
        try:
            command(self._controller)
        except HardwareError as error:
            self.not_connected(str(error))
            raise
        if not self._fault:  # what is vented is not stiff from now on
            self.report()

    def snapshot(self) -> Report:
        """Return the state as it is now."""
        controller, pressures = self._controller, self._pressures
        state = JammingValvesState(
            fault=self._fault, stiffness=[JammingValvesState.UNKNOWN] * self._segments,
            segment_faults=[''] * self._segments)
        if not self._active or controller is None or self._fault:
            pressures = None
        elif pressures is not None:
            state.connected, state.pump = True, controller.reading.pump
            state.stiffness = [JammingValvesState.STIFF if stiff else JammingValvesState.NOT_STIFF
                               for stiff in controller.stiff]
            state.segment_faults = list(controller.faults)
            state.vacuums = list(controller.reading.vacuums)
        return Report(state, pressures, self._time)


class JammingValves(ManagedNode):
    """
    Switches segments soft or stiff and reports their state from the pressures.

    Publishes segment_N/stiff (std_msgs/Bool, latched), segment_N/pressure
    (sensor_msgs/FluidPressure), ~/state (soft_continuum_interfaces/JammingValvesState, latched),
    ~/status and /diagnostics.  Subscribes to emergency_stop.  Serves
    ~/segment_N/set_stiff and ~/set_all_stiff (std_srvs/SetBool), and ~/segment_N/set_vacuum
    (soft_continuum_interfaces/SetVacuum), which valves refuse.  N counts from 1 at the base.

    While a device does not reply the stiffness of its segments is unknown: segment_N/stiff is
    false, and ~/state reports unknown.

    Three threads: those of a ManagedNode; the control thread owns a JammingControl.
    """

    _control: JammingControl

    def __init__(self, **options: Any) -> None:
        """Declare parameters, topics and services."""
        super().__init__(JAMMING_VALVES, '{jamming_driver} jamming valves', **options)
        require_jamming(self.parameters)
        self._settings = jamming_settings(self.parameters)
        self._jams = [s.jam for s in arm_from_parameters(self.parameters).segments]
        self._segments = len(self._jams)
        self._control = JammingControl(
            self._segments, Newest(self.on_ros_thread, self._publish).put)
        self.start_control(self.parameters['jamming_rate'])
        self._published: list[bool] = [False] * self._segments
        self._pressures: tuple[float, ...] | None = None  # that were published
        numbers = range(1, self._segments + 1)
        self._stiff = [
            self.create_publisher(Bool, f'segment_{n}/stiff', LATCHED) for n in numbers]
        self._pressure = [
            self.create_publisher(FluidPressure, f'segment_{n}/pressure', STREAM) for n in numbers]
        for n in numbers:
            serve(self, SetBool, f'~/segment_{n}/set_stiff', partial(self._set_stiff, [n - 1]))
            serve(self, SetVacuum, f'~/segment_{n}/set_vacuum', partial(self._set_vacuum, n - 1))
        serve(self, SetBool, '~/set_all_stiff',
              partial(self._set_stiff, list(range(self._segments))))
        self._emergency = EmergencyStop(self)
        self._conflicts = Conflicts(self, self._segments)
        self._state_publisher = StatePublisher(self, JammingValvesState)
        for publisher in self._stiff:
            publisher.publish(Bool(data=False))
        self._publish(self._control.snapshot())

    def open_device(self) -> JammingController:
        """Connect and read; switch nothing."""
        family = families(JAMMING_DRIVERS)[self.parameters['jamming_driver']]
        driver: JammingDriver | RegulatorDriver = family.make(self.parameters, STEADY, self)
        if isinstance(driver, RegulatorDriver):
            self._settings.check_regulators(driver.max_vacuum)
        driver.open()
        return JammingController(driver, self._segments, self._settings)

    def _publish(self, report: Report) -> None:
        state = report.state
        if report.pressures is not None and report.pressures is not self._pressures:
            stamp = self.ros_time.stamp(report.time)
            for i, pressure in enumerate(report.pressures):
                message = FluidPressure(fluid_pressure=pressure)
                message.header.stamp = stamp
                message.header.frame_id = f'segment_{i + 1}'
                self._pressure[i].publish(message)
        self._pressures = report.pressures
        for i, stiffness in enumerate(state.stiffness):
            stiff = stiffness == JammingValvesState.STIFF
            if stiff != self._published[i]:
                self._published[i] = stiff
                self._stiff[i].publish(Bool(data=stiff))
        self._state_publisher.publish(state)
        faults = state.fault or '; '.join(fault for fault in state.segment_faults if fault)
        if state.connected:
            self.status.set(
                ERROR if faults else OK, faults or 'working', **_switched(state),
                stiff=' '.join(str(s == JammingValvesState.STIFF).lower()
                               for s in state.stiffness))
        else:
            self.status.set(ERROR if faults else OK, faults or 'inactive')

    def _set_stiff(self, segments: list[int], request: SetBool.Request,
                   response: SetBool.Response) -> SetBool.Response:
        names = ', '.join(f'segment {i + 1}' for i in segments)
        doing = f'{"evacuating" if request.data else "venting"} {names}'

        def switch(controller: JammingController) -> None:
            for segment in segments:
                controller.set_stiff(segment, request.data)

        self._command(names, doing, 'segment_N/stiff', not request.data, response, switch)
        return response

    def _set_vacuum(self, segment: int, request: SetVacuum.Request,
                    response: SetVacuum.Response) -> SetVacuum.Response:
        name, vacuum, full = f'segment {segment + 1}', request.vacuum, self._settings.full_vacuum
        partly = vacuum > 0.0 and not isclose(vacuum, full)
        if partly and self._jams[segment].rigid:
            response.message = (
                f'{name}: not set: its jam is rigid in the description, which defines no '
                f'stiffness at {vacuum:g} Pa; allowed: 0 (soft) or {full:g} Pa (full_vacuum). '
                'Give arm.stiffness_ratios, and arm.yield_moments, for values in between')
            return response
        self._command(name, f'{name} to {vacuum / 1e3:g} kPa of vacuum', 'segment_N/pressure',
                      vacuum < full, response,
                      lambda controller: controller.set_vacuum(segment, vacuum))
        return response

    def _command(self, names: str, doing: str, topic: str, softens: bool, response: Any,
                 command: Callable[[JammingController], None]) -> None:
        """Execute a command on the control thread, unless it is refused; fill in the response."""
        if self._emergency.on:
            response.message = (f'{names}: not switched: emergency_stop is on; valves and '
                                'set-points stay as they are until it is published as false')
            return
        if self._conflicts.problem and softens:
            response.message = f'{names}: not softened: {self._conflicts.problem}'
            return
        try:
            self.loop.call(self._control.command, command)
        except (HardwareError, ValueError) as error:
            response.message = f'{names}: {error}'
            return
        except TimeoutError:
            response.message = (f'{names}: the device has not confirmed it yet; {topic} and '
                                'jamming_valves/state report when it does')
            return
        response.success = True
        response.message = f'{doing}; {topic} reports when it is done'
        self.get_logger().info(doing)


def _switched(state: JammingValvesState) -> dict[str, str]:
    """Return the states of regulators or of the pump, for people."""
    if state.vacuums:
        return {'set to (kPa)': ' '.join(f'{vacuum / 1e3:g}' for vacuum in state.vacuums)}
    return {'pump': 'on' if state.pump else 'off'}
