# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The drivers, of this package and of others, by name.

A driver is a class that implements TendonDriver, JammingDriver or RegulatorDriver and also has
``PARAMETERS``, a tuple of Parameter, and ``from_parameters(values, clock)``, which returns one for
the checked parameters of its node (its own, and all that the node has without it) and a steady
clock in s.  The class may have more, which makes it a DriverFamily.  A driver that talks to other
nodes has an attribute ``node``, which is set to the node that uses it, or None: the driver shares
its context, namespace and remapping.  Its attribute ``COMMISSIONING`` names a module for doctor
and calibrate (hardware.commissioning), and ``EMULATOR`` one whose ``main(options)`` serves an
emulated device.  ``topics(values)`` returns the topics of other nodes that it uses.
Other packages add drivers by an entry point in the group TENDON_DRIVERS or JAMMING_DRIVERS;
docs/how_to/write_a_driver.md shows how.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points, EntryPoint
from typing import Any

from soft_continuum.extras import remedy
from soft_continuum.hardware import dynamixel, grbl, modbus
from soft_continuum.hardware.commissioning import Check, Drive
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.parameters.parameter import Parameter

TENDON_DRIVERS = 'soft_continuum.tendon_drivers'
JAMMING_DRIVERS = 'soft_continuum.jamming_drivers'
GROUPS = {'tendon_driver': TENDON_DRIVERS, 'jamming_driver': JAMMING_DRIVERS}
"""By the parameter that selects one."""
Values = Mapping[str, Any]
"""Checked parameters of a node, or of a rig."""
Topics = tuple[dict[str, str], dict[str, str]]
"""Types (as std_msgs/Bool) by name (as in the parameters): published, and subscribed to."""


@dataclass(frozen=True)
class DriverFamily:
    """
    A driver with what belongs to it: parameters, checks, calibration, emulator and topics.

    Its class, and the modules that it names, are loaded when they are used; HardwareError if they
    cannot be.  name: as in parameters.  where: module and class.  known: parameters of one that
    loads slowly, since every node reads the parameters of all.
    """

    name: str
    where: str
    known: tuple[Parameter, ...] = ()

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Its parameters."""
        return self.known or tuple(self._driver.PARAMETERS)

    def make(self, values: Values, clock: Callable[[], float], node: Any = None) -> Any:
        """
        Return the driver, not opened yet.

        clock: s.  node: of ROS, which uses it; None outside of nodes.  Raises ParameterError.
        """
        driver = self._driver.from_parameters(values, clock)
        if hasattr(driver, 'node'):
            driver.node = node
        return driver

    def topics(self, values: Values) -> Topics:
        """Return the topics of other nodes that it uses."""
        topics = getattr(self._driver, 'topics', None)
        found: Topics = topics(values) if topics is not None else ({}, {})
        return found

    @property
    def emulator(self) -> Any:
        """Its module EMULATOR; None without one."""
        return self._module('EMULATOR')

    @property
    def has_emulator(self) -> bool:
        """Whether it has one, or cannot be loaded, as using the emulator then tells."""
        try:
            return bool(getattr(self._driver, 'EMULATOR', None))
        except HardwareError:
            return True

    # What its module COMMISSIONING has for doctor and calibrate.

    @property
    def port(self) -> str:
        """Name of the parameter with its serial ports; empty without one."""
        return str(self._commissioning('PORT') or '')

    @property
    def drive(self) -> Drive | None:
        """The parameters that calibrate corrects, if any."""
        drive: Drive | None = self._commissioning('DRIVE')
        return drive

    @property
    def checks(self) -> Callable[[Values], Iterator[Check]] | None:
        """Checks of the device that is not open, if any."""
        checks: Callable[[Values], Iterator[Check]] | None = self._commissioning('checks')
        return checks

    def checks_opened(self, driver: Any) -> Iterator[Check]:
        """Yield further checks of an open driver."""
        if checks := self._commissioning('checks_opened'):
            yield from checks(driver)

    def clear_zero(self, values: Values) -> None:
        """Make the devices lose their zeros, without a motion, if they can."""
        if clear := self._commissioning('clear_zero'):
            clear(values)

    def _commissioning(self, part: str) -> Any:
        return getattr(self._module('COMMISSIONING'), part, None)

    @property
    def _driver(self) -> Any:
        with self._refused(self.where):
            return EntryPoint(self.name, self.where, '').load()

    def _module(self, attribute: str) -> Any:
        module = getattr(self._driver, attribute, None)
        if module is None:
            return None
        with self._refused(module):
            return import_module(module)

    @contextmanager
    def _refused(self, where: str) -> Iterator[None]:
        """Raise HardwareError for any failure of another package."""
        try:
            yield
        except Exception as error:
            raise HardwareError(
                isinstance(error, ImportError) and remedy(error)
                or f'the driver {self.name} ({where}) cannot be loaded: '
                f'{type(error).__name__}: {error}; check the package it comes with') from error


_HERE = 'soft_continuum.hardware'
_OWN = {
    TENDON_DRIVERS: (
        DriverFamily('simulated', f'{_HERE}.simulated_tendons:SimulatedTendons'),
        DriverFamily('grbl', f'{_HERE}.grbl.tendons:GrblTendons', grbl.PARAMETERS),
        DriverFamily('dynamixel', f'{_HERE}.dynamixel.tendons:DynamixelTendons',
                     dynamixel.PARAMETERS),
        DriverFamily('ros_topics', 'soft_continuum.ros_topics.tendons:RosTendons')),
    JAMMING_DRIVERS: (
        DriverFamily('simulated', f'{_HERE}.simulated_jamming:SimulatedJamming'),
        DriverFamily('modbus', f'{_HERE}.modbus.jamming:ModbusJamming', modbus.PARAMETERS),
        DriverFamily('ros_topics', 'soft_continuum.ros_topics.jamming:RosJamming')),
}


@cache
def _installed() -> Any:  # of another type in each version of Python
    """Return the entry points of all groups: to read one group takes as long."""
    return entry_points()


@cache
def families(group: str) -> Mapping[str, DriverFamily]:
    """Return the families of a group by name, those of this package first."""
    own = {family.name: family for family in _OWN[group]}
    others = {entry.name: DriverFamily(entry.name, entry.value)
              for entry in _installed().select(group=group) if entry.name not in own}
    return own | dict(sorted(others.items()))


def chosen_families(values: Values) -> dict[str, DriverFamily]:
    """Return the families that a rig uses, by the parameter that selects one."""
    return {parameter: families(group)[values[parameter]] for parameter, group in GROUPS.items()}


@cache
def driver_parameters(group: str) -> tuple[Parameter, ...]:
    """Return the parameters of all drivers of a group; one that cannot be loaded has none."""
    found: dict[str, Parameter] = {}
    for family in families(group).values():
        try:
            parameters = family.parameters
        except HardwareError:
            continue  # ``make`` reports it when it is chosen
        for parameter in parameters:
            found.setdefault(parameter.name, parameter)
    return tuple(found.values())


def emulated_devices() -> dict[str, DriverFamily]:
    """Return the families with an emulator, by name, and those that cannot be loaded."""
    found: dict[str, DriverFamily] = {}
    for group in GROUPS.values():
        for family in families(group).values():
            if family.has_emulator:
                found.setdefault(family.name, family)
    return found
