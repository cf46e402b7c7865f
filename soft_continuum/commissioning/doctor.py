# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
``doctor``: checks a rig, or the sensors or the network of a running arm; moves nothing.

A rig: its ports, firmware, settings, boards, valves and sensors.  Nothing is switched.  Steps that
depend on one that failed are left out.
"""

from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
import getpass
from importlib import import_module
import json
from math import isfinite
import os
from pathlib import Path
import sys
from time import monotonic
from typing import Any

from soft_continuum.extras import missing, remedy, requirements, USES
from soft_continuum.hardware.clock import STEADY
from soft_continuum.hardware.commissioning import Check, check_reference, FAIL, OK, WARN
from soft_continuum.hardware.drivers import chosen_families, DriverFamily
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.hardware.real_time import LIMITS, NICENESS, PRIORITY, priority_allowed
from soft_continuum.hardware.serial_ports import describe_ports
from soft_continuum.parameters.arguments import (
    DONE,
    FAILED,
    in_verbs,
    INTERRUPTED,
    number_in,
    Parser,
)
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.text import printable

LISTENING = 3.0  # s
MAX_ZERO_ERROR = 3e3
"""Pa that a vented segment may differ from ambient pressure: 3 % of the usual full scale."""
SIMULATED = 'simulated'


def main(argv: Sequence[str] | None = None) -> int:
    """Run the verb; return the exit status, FAILED if a check failed."""
    parser = Parser('doctor', 'Check parameter files, model, ports, firmware, settings, valves '
                    'and sensors step by step. Nothing is moved or switched. Nodes that use the '
                    'rig must not run, except with --sensors and --network, which need them.',
                    '--params-file', '--json', '--namespace')
    parser.add_argument('--sensors', action='store_true',
                        help='check cameras, trackers, IMUs and load cells while the nodes run')
    parser.add_argument('--network', action='store_true',
                        help='list the nodes on each computer and check round trips, loss, '
                        'clocks, versions, descriptions')
    parser.add_argument('--duration', type=number_in(1.0, 60.0, 's'), default=None, metavar='S',
                        help='time for which --sensors receives (default: 3 s)')
    options = parser.parse_args(argv)
    running = options.sensors or options.network
    if options.sensors and options.network:
        parser.error('--sensors and --network cannot be combined; give one of them')
    if running and options.params_file:
        parser.error('--params-file is for a rig without running nodes, not for --sensors or '
                     '--network')
    if options.duration is not None and not options.sensors:
        parser.error('--duration needs --sensors')
    found: list[Check] = []
    try:
        for check in (_running_checks('sensors', options.namespace, options.duration or LISTENING)
                      if options.sensors else _running_checks('network', options.namespace)
                      if options.network else checks(options.params_file, options.namespace)):
            found.append(check)
            if not options.json:
                message = printable(in_verbs(check.message))
                print(f'{check.status:<4}  {check.step}: {message}', flush=True)
    except KeyboardInterrupt:
        print(file=sys.stderr)
        return parser.fail('interrupted', INTERRUPTED)
    failed = sum(check.status == FAIL for check in found)
    if options.json:
        print(json.dumps({'result': FAIL if failed else OK,
                          'checks': [asdict(check) for check in found]}))
    else:
        warned = sum(check.status == WARN for check in found)
        print(f'\n{len(found)} checks: {failed} failed, {warned} to be looked at')
    return FAILED if failed else DONE


def _running_checks(what: str, namespace: str, *given: float) -> Iterator[Check]:
    """Yield the checks of ``doctor_sensors`` or ``doctor_network`` of a running arm."""
    try:
        from soft_continuum.client import ClientError
        from soft_continuum.client.connection import Connection
        module = import_module(f'soft_continuum.commissioning.doctor_{what}')
    except ImportError as error:
        yield Check(what, FAIL, remedy(error) or str(error))
        return
    try:
        connection = Connection(f'doctor_{os.getpid()}', namespace)
        try:
            yield from module.checks(connection, *given)
        finally:
            connection.close()
    except ClientError as error:
        yield Check(what, FAIL, str(error))


def checks(paths: Sequence[Path], namespace: str = '') -> Iterator[Check]:
    """Yield the result of each step; steps that depend on a failed one are skipped."""
    yield from _check_packages()
    model = _check_model()
    yield model
    if model.status == FAIL:  # the parameter files describe a model
        return
    from soft_continuum.ros.description import load_rig  # imports the model

    where = ', '.join(str(path) for path in paths) or "none given: the paper's arm, simulated"
    try:
        values = load_rig(paths, namespace)
    except ParameterError as error:
        yield Check('parameters', FAIL, str(error))
        return
    yield Check('parameters', OK, where)
    yield check_real_time(values)
    yield check_ports(values)
    yield from check_tendons(values)
    if values['arm.jamming']:
        yield from check_jamming(values)


def _check_packages() -> Iterator[Check]:
    if not any(requirements().values()):
        yield Check('packages', WARN, 'cannot be checked, since soft_continuum is not installed')
        return
    found = [Check(f'packages for {extra}', WARN, text)
             for extra in USES if (text := missing(extra))]
    yield from found or [Check('packages', OK, 'all optional packages are installed')]


def _check_model() -> Check:
    step, begin = 'model', monotonic()
    try:
        # Imported here so that an installation that cannot compile can be diagnosed too.
        kernel = import_module('soft_continuum.mechanics._kernel')
        if kernel.must_build():
            print('compiling the model, which takes up to a minute once ...', file=sys.stderr)
        runs_in = kernel.functions().runs_in
    except Exception as error:  # numba and its compiler fail in many ways
        return Check(step, FAIL, f'does not compile: {type(error).__name__}: {_first(error)}; '
                     'check that ~/.cache is writable, and the versions of numba and NumPy')
    if runs_in == 'python':
        return Check(step, WARN, 'works, but numba is not installed, so it runs many times '
                     'slower; install python3-numba (apt) or numba (pip)')
    if runs_in == 'numba':
        return Check(step, WARN, 'works, but every start takes seconds longer because it could '
                     f'not be built: {kernel.why_not_built()}')
    return Check(step, OK, f'compiled, ready after {monotonic() - begin:.1f} s')


def _first(error: Exception) -> str:
    return (str(error).strip() or 'no reason given').splitlines()[0]


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
        elif checks_device := family.checks:
            yield from checks_device(values)
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
        if checks_device := family.checks:
            found = [*checks_device(values)]
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
