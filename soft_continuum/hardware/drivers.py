# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The drivers, of this package and of others, by name.

A driver is a class that implements TendonDriver, JammingDriver or RegulatorDriver and also has
``PARAMETERS``, a tuple of Parameter, and ``from_parameters(values, clock)``, which returns one for
the checked parameters of its node (its own, and all that the node has without it) and a steady
clock in s.  A driver that talks to other nodes has an attribute ``node``, which make_driver sets
to the node that uses it, or None: the driver shares its context, namespace and remapping.  Its
attribute ``COMMISSIONING`` names a module for doctor and calibrate (hardware.commissioning), and
``EMULATOR`` one whose ``main(options)`` serves an emulated device.
Other packages add drivers by an entry point in the group TENDON_DRIVERS or JAMMING_DRIVERS;
docs/how_to/write_a_driver.md shows how.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache, partial
from importlib import import_module
from importlib.metadata import entry_points, EntryPoint
from typing import Any

from soft_continuum.extras import remedy
from soft_continuum.hardware import dynamixel, grbl, modbus
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.parameters.parameter import Parameter

TENDON_DRIVERS = 'soft_continuum.tendon_drivers'
JAMMING_DRIVERS = 'soft_continuum.jamming_drivers'
GROUPS = {'tendon_driver': TENDON_DRIVERS, 'jamming_driver': JAMMING_DRIVERS}
"""By the parameter that selects one."""
_HERE = 'soft_continuum.hardware'
_OWN = {
    TENDON_DRIVERS: {'simulated': f'{_HERE}.simulated_tendons:SimulatedTendons',
                     'grbl': f'{_HERE}.grbl.tendons:GrblTendons',
                     'dynamixel': f'{_HERE}.dynamixel.tendons:DynamixelTendons',
                     'ros_topics': 'soft_continuum.ros_topics.tendons:RosTendons'},
    JAMMING_DRIVERS: {'simulated': f'{_HERE}.simulated_jamming:SimulatedJamming',
                      'modbus': f'{_HERE}.modbus.jamming:ModbusJamming',
                      'ros_topics': 'soft_continuum.ros_topics.jamming:RosJamming'},
}
_PARAMETERS: Mapping[str, Mapping[str, tuple[Parameter, ...]]] = {
    TENDON_DRIVERS: {'grbl': grbl.PARAMETERS, 'dynamixel': dynamixel.PARAMETERS},
    JAMMING_DRIVERS: {'modbus': modbus.PARAMETERS},
}
"""Parameters of drivers that load slowly, since every node reads the parameters of all."""


@cache
def _installed() -> Any:  # of another type in each version of Python
    """Return the entry points of all groups: to read one group takes as long."""
    return entry_points()


@cache
def _available(group: str) -> dict[str, EntryPoint]:
    own = {name: EntryPoint(name, value, group) for name, value in _OWN[group].items()}
    return {entry.name: entry for entry in _installed().select(group=group)} | own


def driver_names(group: str) -> tuple[str, ...]:
    """Return the names of all drivers of a group, those of this package first."""
    return (*_OWN[group], *sorted(_available(group).keys() - _OWN[group].keys()))


@cache
def driver_parameters(group: str) -> tuple[Parameter, ...]:
    """Return the parameters of all drivers of a group; one that cannot be loaded has none."""
    found: dict[str, Parameter] = {}
    for name in driver_names(group):
        try:
            parameters = _PARAMETERS[group].get(name) or _load(group, name).PARAMETERS
        except HardwareError:
            continue  # make_driver reports it when it is chosen
        for parameter in parameters:
            found.setdefault(parameter.name, parameter)
    return tuple(found.values())


def make_driver(group: str, name: str, values: Mapping[str, Any],
                clock: Callable[[], float], node: Any = None) -> Any:
    """
    Return the driver of that name, not opened yet.

    node: of ROS, which uses it; None outside of nodes.  A driver that talks to other nodes has an
    attribute for it.  Raises HardwareError when its package cannot be loaded, ParameterError for
    its parameters.
    """
    driver = _load(group, name).from_parameters(values, clock)
    if hasattr(driver, 'node'):
        driver.node = node
    return driver


def commissioning(group: str, name: str) -> Any:
    """Return the module COMMISSIONING of a driver, None without one; raises HardwareError."""
    module = getattr(_load(group, name), 'COMMISSIONING', None)
    return None if module is None else _imported(name, module)


def emulated_devices() -> dict[str, Callable[[], Any]]:
    """Return what imports the module EMULATOR of each driver with one; raises HardwareError."""
    found: dict[str, Callable[[], Any]] = {}
    for group in GROUPS.values():
        for name in driver_names(group):
            try:
                module = getattr(_load(group, name), 'EMULATOR', None)
            except HardwareError:
                found.setdefault(name, partial(_load, group, name))  # says why, when it is chosen
                continue
            if module:
                found.setdefault(name, partial(_imported, name, module))
    return found


def driver_topics(values: Mapping[str, Any]) -> dict[str, tuple[dict[str, str], dict[str, str]]]:
    """
    Return the topics of other nodes that drivers use, by the parameter that selects the driver.

    values: checked parameters of a rig.  For each driver, two dicts from the names of topics (as
    in the parameters) to types (as std_msgs/Bool): published by its node, and subscribed to.
    """
    found = {}
    for name, group in GROUPS.items():
        topics = getattr(_load(group, values[name]), 'topics', None)
        found[name] = topics(values) if topics is not None else ({}, {})
    return found


def _imported(name: str, module: str) -> Any:
    with _refused(name, module):
        return import_module(module)


def _load(group: str, name: str) -> Any:
    entry = _available(group)[name]
    with _refused(name, entry.value):
        return entry.load()


@contextmanager
def _refused(name: str, where: str) -> Iterator[None]:
    """Raise HardwareError for any failure of another package."""
    try:
        yield
    except Exception as error:
        raise HardwareError(
            isinstance(error, ImportError) and remedy(error)
            or f'the driver {name} ({where}) cannot be loaded: '
            f'{type(error).__name__}: {error}; check the package it comes with') from error
