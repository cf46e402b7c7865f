# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The checks of ``doctor``: ports, firmware, settings, boards, valves and sensors of a rig.

They move and switch nothing.  Steps that depend on one that failed are left out.
"""

from collections.abc import Generator, Iterator, Mapping
from contextlib import suppress
import getpass
from math import isfinite
import os
from typing import Any

from soft_continuum.hardware.clock import STEADY
from soft_continuum.hardware.commissioning import Check, check_reference, FAIL, OK, WARN
from soft_continuum.hardware.drivers import (
    chosen_families,
    DriverFamily,
)
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.hardware.real_time import LIMITS, NICENESS, PRIORITY, priority_allowed
from soft_continuum.hardware.serial_ports import describe_ports
from soft_continuum.parameters.parameter import ParameterError

MAX_ZERO_ERROR = 3e3
"""Pa that a vented segment may differ from ambient pressure: 3 % of the usual full scale."""
SIMULATED = 'simulated'


def check_real_time(values: Mapping[str, Any]) -> Check:
    """Check that the threads of devices may have priority over others."""
    step, (real_time, share) = 'control threads', priority_allowed()
    have = (f'have real-time priority (SCHED_FIFO {PRIORITY})' if real_time
            else 'have no real-time priority')
    if real_time and share:
        return Check(step, OK, have)
    user = getpass.getuser()
    missing = [limit for limit, allowed in ((f'rtprio {PRIORITY}', real_time), (
        f'nice {NICENESS}', share)) if not allowed]
    lines = ' and '.join(f'"{user} - {limit}"' for limit in missing)
    if not share:
        have += ', and the surrounding threads no larger share of the processor'
    simulated = values['tendon_driver'] == values['jamming_driver'] == SIMULATED
    return Check(step, OK if simulated else WARN,
                 f'{have}: on a busy computer other programs may delay them until a device, or '
                 f'its watchdog, ends the motion. As root, write {lines} to {LIMITS} (for a '
                 f'container: --ulimit rtprio={PRIORITY} --ulimit nice={20 - NICENESS}), then '
                 'restart the computer')


def check_ports(values: Mapping[str, Any]) -> Check:
    """Check that the configured port names are stable."""
    step = 'serial ports'
    names = []
    for parameter, family in chosen_families(values).items():
        if parameter == 'jamming_driver' and not values['arm.jamming']:
            continue
        with suppress(HardwareError):  # the check of that driver reports it
            names.append(family.port)
    used = [(name, port) for name in names if name for port in values[name].split()]
    message = '; '.join(f'{name} is {port}' for name, port in used) or 'none configured'
    if len({os.path.realpath(port) for _, port in used}) < len(used):
        return Check(step, FAIL, f'{message}: the same port; give each device its own; '
                     + describe_ports())
    passing = [name for name, port in used
               if os.path.exists(port) and not os.path.islink(port)]
    if passing:
        return Check(step, WARN, f'{message}; {" and ".join(passing)} may be another device after '
                     'the next start: use its name in /dev/serial/by-id, or add a udev rule; '
                     f'{describe_ports()}')
    return Check(step, OK, message)


def check_tendons(values: Mapping[str, Any]) -> Iterator[Check]:
    """Check the motors; nothing moves."""
    family = chosen_families(values)['tendon_driver']
    step = f'tendon driver {family.name}'
    try:
        driver = family.make(values, STEADY)
        if family.name == SIMULATED:
            yield Check(step, OK, 'steppers are simulated: there is no device to check')
        elif checks := family.checks:
            yield from checks(values)
        else:
            reading = yield from _read(family, driver, Check(step, OK, 'opens and reads'))
            yield check_reference(reading.referenced, reading.unreferenced)
    except (HardwareError, ParameterError) as error:
        yield Check(step, FAIL, str(error))


def _read(family: DriverFamily, driver: Any, *opened: Check) -> Generator[Check, None, Any]:
    """Yield the checks of a driver while it is open, ``opened`` first; return its reading."""
    driver.open()
    try:
        yield from opened
        yield from family.checks_opened(driver)
        return driver.read()
    finally:
        driver.close()


def check_jamming(values: Mapping[str, Any]) -> Iterator[Check]:
    """Check boards, pump, valves and sensors; nothing is switched."""
    family = chosen_families(values)['jamming_driver']
    step = f'jamming driver {family.name}'
    try:
        driver = family.make(values, STEADY)
        if family.name == SIMULATED:
            yield Check(step, OK, 'pump, valves and sensors are simulated: there is no device to '
                        'check')
            return
        if checks := family.checks:
            found = [*checks(values)]
            yield from found
            if any(check.status == FAIL for check in found):
                return
        reading = yield from _read(family, driver)
    except (HardwareError, ParameterError) as error:
        yield Check(step, FAIL, str(error))
        return
    if not reading.vacuums:
        yield _check_pump(reading.pump, reading.evacuated)
    for i, (pressure, evacuated) in enumerate(
            zip(reading.pressures, reading.evacuated, strict=True)):
        setpoint = reading.vacuums[i] if reading.vacuums else 0.0
        yield _check_segment(f'segment {i + 1}', values, pressure, evacuated, setpoint)


def _check_pump(pump: bool, evacuated: tuple[bool, ...]) -> Check:
    valves = ', '.join(f'segment {i + 1} {"to the pump" if e else "vented"}'
                       for i, e in enumerate(evacuated))
    message = f'pump {"on" if pump else "off"}; {valves}'
    if pump and not any(evacuated):
        return Check('pump and valves', WARN, f'{message}; the pump runs although no segment '
                     'needs it: start jamming_valves, which switches it off, or check '
                     'modbus.pump_coil and modbus.energised_valve_evacuates')
    return Check('pump and valves', OK, message)


def _check_segment(step: str, values: Mapping[str, Any], pressure: float,
                   evacuated: bool, setpoint: float) -> Check:
    if not isfinite(pressure):
        return Check(step, FAIL, 'no pressure: its transmitter gives no current between 3.6 and '
                     '21 mA; check its wires and its supply, and modbus.pressure_registers')
    vacuum = values['ambient_pressure'] - pressure
    message = f'{vacuum / 1e3:.1f} kPa of vacuum'
    if setpoint:
        text = f'{message}, its regulator is set to {setpoint / 1e3:.1f} kPa'
        if abs(vacuum - setpoint) <= values['vacuum_tolerance']:
            return Check(step, OK, text)
        return Check(step, FAIL, f'{text}; if the set-point has not just changed, its regulator, '
                     'the regulator supply or its sensor has failed, or it leaks')
    if evacuated:
        return Check(step, WARN, f'{message}, connected to the pump: its sensor can be checked '
                     'only while it is vented; vent it and run this again')
    if abs(vacuum) > values['soft_vacuum']:
        return Check(step, FAIL, f'{message} although it is vented; if it was not vented just '
                     'now, its sensor or valve is stuck, its vent is blocked, or '
                     'modbus.vacuum_at_4_ma, modbus.vacuum_at_20_ma and ambient_pressure do not '
                     'match this sensor')
    if abs(vacuum) > MAX_ZERO_ERROR:
        return Check(step, WARN, f'{message} although it is vented; adjust the zero of the '
                     'transmitter, modbus.vacuum_at_4_ma or ambient_pressure')
    return Check(step, OK, f'{message}, vented')
