# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""The node that owns pump, valves and pressure sensors."""

from collections.abc import Iterable
from typing import Any

from sensor_msgs.msg import FluidPressure
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

from soft_continuum.hardware.drivers import JAMMING_DRIVERS, make_driver
from soft_continuum.hardware.jamming_controller import JammingController
from soft_continuum.hardware.protocols import HardwareError, JammingDriver
from soft_continuum.nodes.support import EmergencyStop, ERROR, ManagedNode, OK, StatePublisher
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.nodes import jamming_settings, NODE_PARAMETERS
from soft_continuum.ros.qos import LATCHED, STREAM
from soft_continuum_interfaces.msg import JammingValvesState


class JammingValves(ManagedNode):
    """
    Switches segments soft or stiff and says, from the pressure, which they are.

    Publishes segment_N/stiff (std_msgs/Bool, latched), segment_N/pressure
    (sensor_msgs/FluidPressure), ~/state (soft_continuum_interfaces/JammingValvesState, latched),
    ~/status and /diagnostics.  Subscribes to emergency_stop.  Serves
    ~/segment_N/set_stiff and ~/set_all_stiff (std_srvs/SetBool).  N counts from 1 at the base.

    While a device does not answer only ~/state, ~/status and /diagnostics are published: whether
    its segments are stiff is then not known to anybody.
    """

    def __init__(self, **options: Any) -> None:
        """Declare parameters, topics and services."""
        super().__init__('jamming_valves', NODE_PARAMETERS['jamming_valves'], **options)
        self._segments = len(arm_from_parameters(self.parameters).segments)
        self._settings = jamming_settings(self.parameters)
        self._controller: JammingController | None = None
        self._driver: JammingDriver | None = None
        self._said: list[bool | None] = [None] * self._segments
        numbers = range(1, self._segments + 1)
        self._stiff = [
            self.create_publisher(Bool, f'segment_{n}/stiff', LATCHED) for n in numbers]
        self._pressure = [
            self.create_publisher(FluidPressure, f'segment_{n}/pressure', STREAM) for n in numbers]
        for n in numbers:
            self.create_service(
                SetBool, f'~/segment_{n}/set_stiff',
                lambda request, response, n=n: self._set_stiff([n - 1], request, response))
        self.create_service(
            SetBool, '~/set_all_stiff',
            lambda request, response: self._set_stiff(
                list(range(self._segments)), request, response))
        self._emergency = EmergencyStop(self)
        self._state = StatePublisher(self, JammingValvesState)
        self._publish_state()
        self._timer = self.create_timer(1.0 / self.parameters['jamming_rate'], self._update)

    def hardware_id(self) -> str:
        """Name the driver."""
        return f'{self.parameters["jamming_driver"]} jamming valves'

    def configure(self) -> None:
        """Connect and read; switch nothing."""
        driver: JammingDriver = make_driver(
            JAMMING_DRIVERS, self.parameters['jamming_driver'], self.parameters, self._seconds)
        driver.open()
        self._driver = driver
        self._controller = JammingController(driver, self._segments, self._settings)
        self.status.set(OK, 'connected')

    def deactivate(self) -> None:
        """Leave pump and valves as they are."""
        self.status.set(OK, 'inactive')
        self._publish_state()

    def clean_up(self) -> None:
        """Disconnect; pump and valves stay as they are."""
        if self._driver is not None:
            self._driver.close()
        self._driver = self._controller = None

    def _seconds(self) -> float:
        return self.get_clock().now().nanoseconds * 1e-9

    def _update(self) -> None:
        if not self.active or self._controller is None:
            return
        try:
            reading = self._controller.update()
        except HardwareError as error:
            self.status.set(ERROR, str(error))
            self._publish_state(str(error))
            return
        stamp = self.get_clock().now().to_msg()
        for i in range(self._segments):
            message = FluidPressure(fluid_pressure=reading.pressures[i])
            message.header.stamp = stamp
            message.header.frame_id = f'segment_{i + 1}'
            self._pressure[i].publish(message)
        self._say_stiff(range(self._segments))
        faults = '; '.join(fault for fault in self._controller.faults if fault)
        self.status.set(ERROR if faults else OK, faults or 'working',
                        pump='on' if reading.pump else 'off',
                        stiff=' '.join(str(s).lower() for s in self._controller.stiff))

        self._publish_state()

    def _publish_state(self, fault: str = '') -> None:
        controller = self._controller
        state = JammingValvesState(
            fault=fault, stiffness=[JammingValvesState.UNKNOWN] * self._segments,
            segment_faults=[''] * self._segments)
        if self.active and controller is not None and not fault:
            state.connected, state.pump = True, controller.reading.pump
            state.stiffness = [JammingValvesState.STIFF if stiff else JammingValvesState.NOT_STIFF
                               for stiff in controller.stiff]
            state.segment_faults = list(controller.faults)
        self._state.publish(state)

    def _say_stiff(self, segments: Iterable[int]) -> None:
        assert self._controller is not None
        for i in segments:
            stiff = self._controller.stiff[i]
            if stiff != self._said[i]:
                self._said[i] = stiff
                self._stiff[i].publish(Bool(data=stiff))

    def _set_stiff(self, segments: list[int], request: SetBool.Request,
                   response: SetBool.Response) -> SetBool.Response:
        names = ', '.join(f'segment {i + 1}' for i in segments)
        if not self.active or self._controller is None:
            response.message = f'{names}: not switched: the node is not active'
            return response
        if self._emergency.on:
            response.message = (f'{names}: not switched: emergency_stop is on; valves stay as '
                                'they are until it is published as false')
            return response
        try:
            for i in segments:
                self._controller.set_stiff(i, request.data)
        except HardwareError as error:
            response.message = f'{names}: {error}'
            self.status.set(ERROR, str(error))
            return response
        if not request.data:  # what is vented is not stiff from now on
            self._say_stiff(segments)
        response.success = True
        doing = 'evacuating' if request.data else 'venting'
        response.message = f'{doing} {names}; segment_N/stiff says when it is done'
        self.get_logger().info(f'{doing} {names}')
        return response
