# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Valves with a pump, or vacuum regulators, as a board has them: a plant on topics."""

from collections.abc import Callable
import time
from typing import Any

from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import FluidPressure
from std_msgs.msg import Bool, Float64, Float64MultiArray

from soft_continuum.hardware.simulated_jamming import (
    JammingPlant,
    SimulatedJamming,
    SimulatedRegulators,
)
from support.ros2_control import OtherNodes

RATE = 50.0  # Hz
AMBIENT = 101325.0  # Pa
KPA = 1e3  # Pa
QUICK = JammingPlant(AMBIENT, evacuation_time=0.03, venting_time=0.03, valve_delay=0.0)
BEST_EFFORT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)

VALVES = {
    'jamming_driver': 'ros_topics',
    'ros_jamming.pressure_topics': [f'/board/pressure_{n}' for n in (1, 2, 3)],
    'ros_jamming.command_topics': [f'/board/valve_{n}' for n in (1, 2, 3)],
    'ros_jamming.state_topics': [f'/board/valve_state_{n}' for n in (1, 2, 3)],
    'ros_jamming.pump_topic': '/board/pump', 'ros_jamming.pump_state_topic': '/board/pump_state',
}
REGULATORS = {
    'jamming_driver': 'ros_topics', 'ros_jamming.regulators': True,
    'ros_jamming.pressure_topics': ['/board/pressures'],
    'ros_jamming.pressure_type': 'std_msgs/Float64MultiArray',
    'ros_jamming.pressures_are': 'gauge', 'ros_jamming.pressure_scales': [KPA],
    'ros_jamming.command_topics': ['/board/setpoints'],
    'ros_jamming.command_type': 'std_msgs/Float64MultiArray',
    'ros_jamming.state_topics': [f'/board/setpoint_{n}' for n in (1, 2, 3)],
    'ros_jamming.state_type': 'std_msgs/Float64', 'ros_jamming.vacuum_scale': -KPA,
}


class _Board(OtherNodes):
    """
    A board of three segments.

    publishes: whether it does.  obeys: whether commands are followed.  switched: how many were.
    """

    def __init__(self, domain: int) -> None:
        super().__init__(domain, 'board', '/board')
        self.publishes, self.obeys, self.switched = True, True, 0
        self.pressure: Callable[[float], float] = lambda pressure: pressure
        self.node.create_timer(1.0 / RATE, self._update)

    def publisher(self, kind: Any, topic: str) -> Any:
        return self.node.create_publisher(kind, topic, BEST_EFFORT)

    def obey(self, kind: Any, topic: str, function: Callable[..., None], *first: Any) -> None:
        def on_command(message: Any) -> None:
            self.switched += 1
            if self.obeys:
                function(*first, message.data)
        self.node.create_subscription(kind, topic, on_command, BEST_EFFORT)

    def _update(self) -> None:
        raise NotImplementedError


class Valves(_Board):
    """Three valves and a pump by Bool, absolute pressures in Pa."""

    def __init__(self, domain: int) -> None:
        super().__init__(domain)
        self.plant = SimulatedJamming(time.monotonic, 3, QUICK, True)
        for n in range(3):
            self.obey(Bool, f'valve_{n + 1}', self.plant.set_evacuated, n)
        self.obey(Bool, 'pump', self.plant.set_pump)
        self._states = [self.publisher(Bool, f'valve_state_{n}') for n in (1, 2, 3)]
        self._pump = self.publisher(Bool, 'pump_state')
        self._pressures = [self.publisher(FluidPressure, f'pressure_{n}') for n in (1, 2, 3)]
        self.start()

    def _update(self) -> None:
        if not self.publishes:
            return
        reading = self.plant.read()
        self._pump.publish(Bool(data=reading.pump))
        for n in range(3):
            self._states[n].publish(Bool(data=reading.evacuated[n]))
            message = FluidPressure(fluid_pressure=self.pressure(reading.pressures[n]))
            message.header.stamp = self.node.get_clock().now().to_msg()
            self._pressures[n].publish(message)


class Regulators(_Board):
    """Three regulators that take gauge pressures in kPa, and report them and what they measure."""

    def __init__(self, domain: int) -> None:
        super().__init__(domain)
        self.plant = SimulatedRegulators(time.monotonic, 3, QUICK, True, 90e3, 500.0)
        self.setpoint: Callable[[float], float] = lambda setpoint: setpoint
        self.obey(Float64MultiArray, 'setpoints', self._set)
        self._setpoints = [self.publisher(Float64, f'setpoint_{n}') for n in (1, 2, 3)]
        self._pressures = self.publisher(Float64MultiArray, 'pressures')
        self.start()

    def _set(self, gauge: list[float]) -> None:
        for n, pressure in enumerate(gauge):
            self.plant.set_vacuum(n, -KPA * pressure)

    def _update(self) -> None:
        if not self.publishes:
            return
        reading = self.plant.read()
        for publisher, vacuum in zip(self._setpoints, reading.vacuums, strict=True):
            publisher.publish(Float64(data=self.setpoint(-vacuum / KPA)))
        self._pressures.publish(Float64MultiArray(data=[
            self.pressure((pressure - AMBIENT) / KPA) for pressure in reading.pressures]))
