# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Control thread of jamming_valves: pump, valves or regulators, and pressure sensors."""

from collections.abc import Callable
from dataclasses import dataclass

from soft_continuum.hardware.clock import STEADY
from soft_continuum.hardware.jamming_controller import JammingController, JammingSettings
from soft_continuum.hardware.protocols import HardwareError, JammingDriver, RegulatorDriver
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


Driver = JammingDriver | RegulatorDriver


class JammingControl:
    """
    Switches segments and watches their pressures.

    Every method is called on the control thread; a Report follows every change.
    """

    lost = False  # the driver itself reconnects to boards that did not reply

    def __init__(self, segments: int, settings: JammingSettings,
                 report: Callable[[Report], None]) -> None:
        """Start without a device."""
        self._segments, self._settings, self._report = segments, settings, report
        self._driver: Driver | None = None
        self._controller: JammingController | None = None
        self._active = False
        self._pressures: tuple[float, ...] | None = None
        self._time = 0.0
        self._fault = ''
        self._stream = RestingStream(REST_CHANGE)

    def attach(self, driver: Driver) -> None:
        """Control an open ``driver`` from now on."""
        self._driver = driver
        self._controller = JammingController(driver, self._segments, self._settings)
        self._fault, self._pressures = '', None
        self.report()

    def detach(self) -> Driver | None:
        """Return the driver, if any, and continue without it."""
        driver, self._driver, self._controller = self._driver, None, None
        self._active, self._fault = False, ''
        self.report()
        return driver

    def activate(self) -> None:
        """Begin to read and to switch."""
        self._active = True

    def deactivate(self) -> None:
        """Leave pump and valves as they are."""
        self._active, self._fault = False, ''
        self.report()

    def not_connected(self, error: str) -> None:
        """Note why the device does not reply."""
        self._fault = error
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

    def report(self) -> None:
        """Publish a snapshot for the other threads."""
        self._report(self.snapshot())
