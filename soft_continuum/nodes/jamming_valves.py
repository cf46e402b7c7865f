# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The node that owns pump, valves and pressure sensors."""

from functools import partial
from typing import Any

from sensor_msgs.msg import FluidPressure
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

from soft_continuum.hardware.clock import STEADY
from soft_continuum.hardware.drivers import JAMMING_DRIVERS, make_driver
from soft_continuum.hardware.protocols import HardwareError, JammingDriver
from soft_continuum.nodes.conflicts import Conflicts
from soft_continuum.nodes.emergency_stop import EmergencyStop
from soft_continuum.nodes.entries import serve
from soft_continuum.nodes.jamming_control import JammingControl, Report
from soft_continuum.nodes.managed_node import ManagedNode
from soft_continuum.nodes.status import ERROR, OK, StatePublisher
from soft_continuum.nodes.threads import Newest
from soft_continuum.parameters.arm import any_arm_from_parameters, check_jamming
from soft_continuum.parameters.nodes import jamming_settings, NODE_PARAMETERS
from soft_continuum.ros.qos import LATCHED, STREAM
from soft_continuum_interfaces.msg import JammingValvesState


class JammingValves(ManagedNode):
    """
    Switches segments soft or stiff and reports, from the pressure, which they are.

    Publishes segment_N/stiff (std_msgs/Bool, latched), segment_N/pressure
    (sensor_msgs/FluidPressure), ~/state (soft_continuum_interfaces/JammingValvesState, latched),
    ~/status and /diagnostics.  Subscribes to emergency_stop.  Serves
    ~/segment_N/set_stiff and ~/set_all_stiff (std_srvs/SetBool).  N counts from 1 at the base.

    While a device does not answer nobody knows whether its segments are stiff: segment_N/stiff is
    false, and ~/state calls them unknown.

    Three threads: those of a ManagedNode, of which the one of control owns a JammingControl.
    """

    def __init__(self, **options: Any) -> None:
        """Declare parameters, topics and services."""
        super().__init__('jamming_valves', NODE_PARAMETERS['jamming_valves'], **options)
        check_jamming(self.parameters)
        self._segments = len(any_arm_from_parameters(self.parameters).segments)
        self._control = JammingControl(
            self._segments, jamming_settings(self.parameters),
            Newest(self.on_ros_thread, self._publish).put)
        self._loop = self.control(
            self.parameters['jamming_rate'], self._control.cycle, self._on_control_failure)
        self._published: list[bool] = [False] * self._segments
        self._pressures: tuple[float, ...] | None = None  # that were published
        numbers = range(1, self._segments + 1)
        self._stiff = [
            self.create_publisher(Bool, f'segment_{n}/stiff', LATCHED) for n in numbers]
        self._pressure = [
            self.create_publisher(FluidPressure, f'segment_{n}/pressure', STREAM) for n in numbers]
        for n in numbers:
            serve(self, SetBool, f'~/segment_{n}/set_stiff', partial(self._set_stiff, [n - 1]))
        serve(self, SetBool, '~/set_all_stiff',
              partial(self._set_stiff, list(range(self._segments))))
        self._emergency = EmergencyStop(self)
        self._conflicts = Conflicts(self, self._segments)
        self._state_publisher = StatePublisher(self, JammingValvesState)
        for publisher in self._stiff:
            publisher.publish(Bool(data=False))
        self.publish_last()

    def hardware_id(self) -> str:
        """Name the driver."""
        return f'{self.parameters["jamming_driver"]} jamming valves'

    def open_device(self) -> JammingDriver:
        """Connect and read; switch nothing."""
        driver: JammingDriver = make_driver(
            JAMMING_DRIVERS, self.parameters['jamming_driver'], self.parameters, STEADY, self)
        driver.open()
        return driver

    def close_device(self, device: JammingDriver) -> None:
        """Disconnect; pump and valves stay as they are."""
        device.close()

    def attach(self, device: JammingDriver) -> None:
        """Control a device from now on."""
        self._control.attach(device)

    def detach(self) -> JammingDriver | None:
        """Stop controlling the device."""
        return self._control.detach()

    def activate(self) -> None:
        """Begin to read and to switch."""
        self._control.activate()

    def deactivate(self) -> None:
        """Leave pump and valves as they are."""
        self._control.deactivate()

    def lost(self) -> bool:
        """Return False: the driver itself connects again to boards that did not answer."""
        return False

    def not_connected(self, error: str) -> None:
        """Note an attempt to connect that failed."""
        self._loop.post(self._control.not_connected, error)

    def publish_last(self) -> None:
        """Publish the state in which the process ends."""
        self._publish(self._control.snapshot())

    def _on_control_failure(self, error: Exception) -> None:
        self._on_thread_failure(error)
        self._control.failed(error)

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
                ERROR if faults else OK, faults or 'working', pump='on' if state.pump else 'off',
                stiff=' '.join(str(s == JammingValvesState.STIFF).lower()
                               for s in state.stiffness))
        else:
            self.status.set(ERROR if faults else OK, faults or 'inactive')

    def _set_stiff(self, segments: list[int], request: SetBool.Request,
                   response: SetBool.Response) -> SetBool.Response:
        names = ', '.join(f'segment {i + 1}' for i in segments)
        if self._emergency.on:
            response.message = (f'{names}: not switched: emergency_stop is on; valves stay as '
                                'they are until it is published as false')
            return response
        if self._conflicts.problem and not request.data:
            response.message = f'{names}: not softened: {self._conflicts.problem}'
            return response
        try:
            self.in_loop(self._control.set_stiff, segments, request.data)
        except (HardwareError, ValueError) as error:
            response.message = f'{names}: {error}'
            return response
        except TimeoutError:
            response.message = (f'{names}: the device has not confirmed it yet; segment_N/stiff '
                                'and jamming_valves/state tell when it does')
            return response
        response.success = True
        doing = 'evacuating' if request.data else 'venting'
        response.message = f'{doing} {names}; segment_N/stiff says when it is done'
        self.get_logger().info(f'{doing} {names}')
        return response
