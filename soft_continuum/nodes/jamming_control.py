# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Control thread of jamming_valves: pump, valves or regulators, and pressure sensors."""

from collections.abc import Callable
from dataclasses import dataclass

from soft_continuum.hardware.clock import STEADY
from soft_continuum.hardware.jamming_controller import JammingController
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.nodes.managed_node import DeviceControl
from soft_continuum.nodes.threads import RestingStream
from soft_continuum_interfaces.msg import JammingValvesState

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
