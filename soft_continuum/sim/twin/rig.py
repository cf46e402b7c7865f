# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The plant in real time, driven by the motors and the vacuum of the emulated boards."""

from contextlib import ExitStack
from pathlib import Path
import threading
from typing import Self

import numpy as np

from soft_continuum.hardware.clock import Clock, STEADY
from soft_continuum.hardware.simulated_jamming import JammingPlant
from soft_continuum.mechanics.arm import Arm
from soft_continuum.parameters.parameter import Value
from soft_continuum.sim.emulators.modbus import modbus_parameters, ModbusEmulator
from soft_continuum.sim.emulators.tendon_motors import TENDON_MOTORS
from soft_continuum.sim.twin.model_errors import ModelErrors
from soft_continuum.sim.twin.plant import Plant, Sensors, TIME_STEP

PERIOD = 0.005  # s between two looks at the boards
MAX_LATENESS = 0.2  # s that are made up for; the plant stands still for what is beyond
STEPS = 10  # of time between two looks, at most: sensors wait until they are done
FULL_VACUUM = JammingPlant.ultimate_vacuum  # Pa


class TwinRig:
    """
    The emulated boards and the plant behind them; runs while this context manager is open.

    It starts stiff, like a rig with a running pump, if its segments have jamming.  While ``lock``
    is held no time passes for the plant.  sensors: its readings.  lost: s of real time that the
    plant lost because the computer was too slow.
    """

    def __init__(self, arm: Arm, model_errors: ModelErrors, tendon_link: str | Path = '',
                 modbus_link: str | Path = '', clock: Clock = STEADY, *,
                 tendon_driver: str = 'grbl', jams: bool = True,
                 regulators: bool = False) -> None:
        """
        Make the rig.

        links: paths at which the ports can always be found; those of further boards of tendons end
        with _2, _3, ...  tendon_driver: one of TENDON_MOTORS.  jams: whether segments can be
        stiff.  regulators: of vacuum, in place of pump and valves.
        """
        self.plant = Plant(arm, model_errors)
        self.sensors = Sensors(self.plant)
        self.motors = TENDON_MOTORS[tendon_driver](tendon_link, len(arm.tendon_names), clock)
        self.modbus = ModbusEmulator(
            len(arm.segments), initially_stiff=jams, link=modbus_link or None, baud_rate=9600,
            clock=clock, regulators=regulators)
        self.lock = threading.Lock()
        self.lost = 0.0
        self._clock = clock
        self._closing = False
        self._thread = threading.Thread(target=self._run, name='twin', daemon=True)
        self._devices = ExitStack()

    def __enter__(self) -> Self:
        """Plug in the boards and let time pass; raises OSError for a link that cannot be."""
        with ExitStack() as devices:
            devices.enter_context(self.motors)
            devices.enter_context(self.modbus)
            self._devices = devices.pop_all()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """End."""
        self._closing = True
        while self._thread.is_alive():
            self._clock.sleep(PERIOD)
        self._devices.close()

    def parameters(self) -> dict[str, Value]:
        """Return the parameters of nodes that drive this rig."""
        return self.motors.parameters() | modbus_parameters(self.modbus.port) | {
            'modbus.regulators': self.modbus.regulators}

    def _run(self) -> None:
        begin = self._clock()
        while not self._closing:
            self._clock.sleep(PERIOD)
            pulls = np.array(self.motors.pulls())
            vacuum = np.array([self.modbus.vacuum(s) for s in range(len(self.modbus.segments))])
            late = self._clock() - begin - self.plant.time
            if late > MAX_LATENESS:
                begin += late - MAX_LATENESS
                self.lost += late - MAX_LATENESS
                late = MAX_LATENESS
            with self.lock:
                for _ in range(min(STEPS, int(late / TIME_STEP))):
                    self.plant.step(pulls, vacuum / FULL_VACUUM)
                tensions = self.plant.tensions
            self.motors.load(tensions.tolist())
