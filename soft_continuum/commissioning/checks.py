# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The checks of ``doctor``: ports, firmware, settings, boards, valves and sensors of a rig.

They move and switch nothing.  Steps that depend on one that failed are left out.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
import getpass
from math import isfinite
import os
from typing import Any

from soft_continuum.hardware.clock import STEADY
from soft_continuum.hardware.drivers import JAMMING_DRIVERS, make_driver, TENDON_DRIVERS
from soft_continuum.hardware.dynamixel.bus import DynamixelBus, latency_timer
from soft_continuum.hardware.dynamixel.reference import ZeroFile
from soft_continuum.hardware.dynamixel.registers import (
    PRESENT_CURRENT,
    RETURN_DELAY,
    TORQUE_ENABLE,
)
from soft_continuum.hardware.dynamixel.setup import (
    find_servos,
    problems,
    Servo,
    Spools,
)
from soft_continuum.hardware.dynamixel.start import find_zeros, read_states
from soft_continuum.hardware.grbl.link import GrblLink
from soft_continuum.hardware.grbl.motion import Motors
from soft_continuum.hardware.grbl.setup import find_controller, invalid_settings, UNLOCK
from soft_continuum.hardware.modbus.bus import MAX_PAUSE, ModbusBus
from soft_continuum.hardware.modbus.jamming import registers_from_parameters
from soft_continuum.hardware.modbus.regulators import Outputs
from soft_continuum.hardware.modbus.transmitters import Transmitters
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.hardware.real_time import LIMITS, NICENESS, PRIORITY, priority_allowed
from soft_continuum.hardware.serial_ports import describe_ports, open_serial
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.user_files import dynamixel_zeros

OK, WARN, FAIL = 'OK', 'WARN', 'FAIL'
ROUND_TRIPS, MAX_LOST_REPLIES = 5, 1
"""Requests to each board, and replies that may be missing before it counts as failed."""
MAX_TIMEOUT_SHARE = 0.5
"""Share of modbus.timeout that a reply may take."""
MAX_ZERO_ERROR = 3e3
"""Pa that a vented segment may differ from ambient pressure: 3 % of the usual full scale."""
MAX_LATENCY = 1  # ms that a USB adapter may keep what it receives
OUTPUT_BOARD = 'output board'
SIMULATED = 'simulated'
PORTS = {'grbl.port': ('tendon_driver', 'grbl'),
         'dynamixel.port': ('tendon_driver', 'dynamixel'),
         'modbus.port': ('jamming_driver', 'modbus')}
"""Which parameter is a port, and the driver that uses it."""


@dataclass(frozen=True)
class Check:
    """What one step found; status: OK, WARN or FAIL.  If not OK, the message names the remedy."""

    step: str
    status: str
    message: str


def check_real_time(values: Mapping[str, Any]) -> Check:
    """Return whether the threads that talk to devices may go on before others."""
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
        have += ', and those around them no larger share of the processor'
    simulated = values['tendon_driver'] == values['jamming_driver'] == SIMULATED
    return Check(step, OK if simulated else WARN,
                 f'{have}: other programs of a busy computer may keep them waiting until a '
                 f'device, or its watchdog, ends the motion. As root, write {lines} to {LIMITS} '
                 f'(for a container: --ulimit rtprio={PRIORITY} --ulimit nice={20 - NICENESS}), '
                 'and restart the computer')


def check_ports(values: Mapping[str, Any]) -> Check:
    """Return whether the configured port names stay with their devices."""
    step = 'serial ports'
    used = [(name, port) for name, driver in PORTS.items() if values[driver[0]] == driver[1]
            for port in values[name].split()]
    message = '; '.join(f'{name} is {port}' for name, port in used) or 'none configured'
    if len({os.path.realpath(port) for _, port in used}) < len(used):
        return Check(step, FAIL, f'{message}: the same port; give each device its own; '
                     + describe_ports())
    passing = [name for name, port in used
               if os.path.exists(port) and not os.path.islink(port)]
    if passing:
        return Check(step, WARN, f'{message}; {" and ".join(passing)} may be another device after '
                     'the next start: use its name below /dev/serial/by-id, or make one with a '
                     f'udev rule; {describe_ports()}')
    return Check(step, OK, message)


def check_tendons(values: Mapping[str, Any]) -> Iterator[Check]:
    """Yield the state of the motors; nothing moves."""
    name = values['tendon_driver']
    step = f'tendon driver {name}'
    try:
        driver = make_driver(TENDON_DRIVERS, name, values, STEADY)
        if name == SIMULATED:
            yield Check(step, OK, 'steppers are simulated: there is no device to check')
        elif name == 'grbl':
            for port, motors in Motors.of_boards(values):
                yield from _check_grbl(port, values['grbl.baud_rate'], motors)
        elif name == 'dynamixel':
            yield from check_servos(values)
        else:
            driver.open()
            try:
                yield Check(step, OK, 'opens and reads')
                yield from _check_topics(driver)
                reading = driver.read()
            finally:
                driver.close()
            yield check_reference(reading.referenced, reading.unreferenced)
    except (HardwareError, ParameterError) as error:
        yield Check(step, FAIL, str(error))


def _check_topics(driver: Any) -> Iterator[Check]:
    """Yield what is heard on the topics of a driver that has any."""
    if hasattr(driver, 'link'):
        from soft_continuum.ros_topics.survey import (
            survey,  # needs ROS, as the driver does
        )

        for found in survey(driver):
            yield Check(found.step, WARN if found.warning else OK,
                        '; '.join(filter(None, (found.message, found.warning))))


def check_reference(referenced: bool, why: str = '') -> Check:
    """Return whether the zero of the tendons is known; why: not."""
    if referenced:
        return Check('tendon reference', OK, 'the zero of the tendons is known')
    return Check('tendon reference', WARN,
                 f'the zero of the tendons is not known{why and f" ({why})"}, so no motion is '
                 'allowed: use calibrate zero, or straighten the arm with both tendons just taut '
                 'and call /tendon_actuation/reference')


def _check_grbl(port: str, baud_rate: int, motors: Motors) -> Iterator[Check]:
    step = 'tendon port'
    try:
        link = GrblLink(open_serial(port, baud_rate))
    except HardwareError as error:
        yield Check(step, FAIL, str(error))
        return
    yield Check(step, OK, f'{port} opened, no other program uses it')
    try:
        found = find_controller(link)
    except HardwareError as error:
        yield Check('tendon firmware', FAIL, str(error))
        return
    finally:
        link.close()
    if found.locked and not motors.homes:
        yield Check('tendon firmware', FAIL, f'{found.firmware}, locked (Alarm); {UNLOCK}')
    else:
        yield Check('tendon firmware', OK, f'{found.firmware}, at rest')
    if unfit := invalid_settings(found.settings, motors):
        yield Check('tendon settings', FAIL, f'{"; ".join(unfit)}; type these lines in a terminal '
                    '(docs/how_to/set_up_a_rig.md), or change the parameter file')
    else:
        yield Check('tendon settings', OK, 'fit the parameters')
    if motors.homes and (found.locked or found.zero is None):
        yield Check('tendon reference', WARN, 'the tendons have to be homed before any motion: '
                    'straighten and stiffen the arm, and call /tendon_actuation/reference')
    else:
        yield check_reference(found.zero is not None)


def check_servos(values: Mapping[str, Any]) -> Iterator[Check]:
    """Yield the state of Dynamixel servos; nothing is written to them."""
    port = values['dynamixel.port']
    spools = Spools.from_parameters(values)
    try:
        bus = DynamixelBus.from_parameters(values)
    except HardwareError as error:
        yield Check('tendon port', FAIL, str(error))
        return
    yield _check_latency(port)
    try:
        servos = find_servos(bus, spools)
        unfit = False
        for servo in servos:
            yield (check := _check_servo(servo, spools))
            unfit |= check.status == FAIL
        if not unfit:
            states = read_states(bus, servos)
            zeros = find_zeros(bus, servos, states, spools, ZeroFile(dynamixel_zeros(), port))
            why = '; '.join(zero.unknown for zero in zeros if zero.unknown)
            yield check_reference(not why, why)
    except HardwareError as error:
        yield Check('tendon servos', FAIL, str(error))
    finally:
        bus.close()


def _check_latency(port: str) -> Check:
    step, message = 'tendon port', f'{port} opened, no other program uses it'
    if (latency := latency_timer(port)) is not None and latency > MAX_LATENCY:
        return Check(step, WARN, f'{message}; its adapter keeps what it receives for {latency} '
                     f'ms, which slows every cycle: set it to {MAX_LATENCY} with a udev rule '
                     '(docs/how_to/use_dynamixel_servos.md)')
    return Check(step, OK, message)


def _check_servo(servo: Servo, spools: Spools) -> Check:
    if found := problems(servo, spools.speed_limit):
        return Check(str(servo), FAIL, '; '.join(
            line.removeprefix(f'{servo}: ') for line in found))
    sign = spools.signs[spools.ids.index(servo.id)]
    tension = max(0.0, sign * servo.tension(servo.get(PRESENT_CURRENT)))
    torque = 'holds' if servo.get(TORQUE_ENABLE) else 'torque off'
    message = (f'{servo.describe()}, {torque}, about {tension:.1f} N '
               f'(standard deviation {servo.stddev(tension):.1f} N)')
    if servo.get(RETURN_DELAY):
        return Check(str(servo), WARN, f'{message}; {RETURN_DELAY} is '
                     f'{servo.get(RETURN_DELAY)}, which slows every cycle: set it to 0')
    return Check(str(servo), OK, message)


def check_jamming(values: Mapping[str, Any]) -> Iterator[Check]:
    """Yield the state of boards, pump, valves and sensors; nothing is switched."""
    name = values['jamming_driver']
    step = f'jamming driver {name}'
    try:
        driver = make_driver(JAMMING_DRIVERS, name, values, STEADY)
        if name == SIMULATED:
            yield Check(step, OK, 'pump, valves and sensors are simulated: there is no device to '
                        'check')
            return
        if name == 'modbus':
            checks = [*_check_boards(values)]
            yield from checks
            if any(check.status == FAIL for check in checks):
                return
        driver.open()
        try:
            yield from _check_topics(driver)
            reading = driver.read()
        finally:
            driver.close()
    except (HardwareError, ParameterError) as error:
        yield Check(step, FAIL, str(error))
        return
    if not reading.vacuums:
        yield _check_pump(reading.pump, reading.evacuated)
    for i, (pressure, evacuated) in enumerate(
            zip(reading.pressures, reading.evacuated, strict=True)):
        told = reading.vacuums[i] if reading.vacuums else 0.0
        yield _check_segment(f'segment {i + 1}', values, pressure, evacuated, told)


def _check_boards(values: Mapping[str, Any]) -> Iterator[Check]:
    bus = ModbusBus(values['modbus.port'], values['modbus.baud_rate'], values['modbus.timeout'])
    try:
        bus.open()
    except HardwareError as error:
        yield Check('jamming port', FAIL, str(error))
        return
    yield Check('jamming port', OK, f'{values["modbus.port"]} opened, no other program uses it')
    trips: list[float] = []
    transmitters = Transmitters.from_parameters(values)
    try:
        for board, ask, unit, addresses in (
                _switching_board(bus, values),
                ('analog board', bus.read_input_registers, transmitters.unit,
                 transmitters.registers)):
            state: tuple[int, ...] = ()
            lost: list[str] = []
            for _ in range(ROUND_TRIPS):
                begin = STEADY()
                try:
                    state = ask(unit, addresses[0], len(addresses))
                    trips.append(STEADY() - begin)
                except HardwareError as error:
                    lost.append(str(error))
                    STEADY.sleep(MAX_PAUSE)
                    bus.open()  # so that no late reply is received
                if len(lost) > MAX_LOST_REPLIES:
                    break
            message = f'unit {unit} answers: ' + ', '.join(
                _state(board, a, s) for a, s in zip(addresses, state, strict=False))
            if len(lost) > MAX_LOST_REPLIES:
                yield Check(board, FAIL, lost[-1])
            elif lost:
                yield Check(board, WARN, f'{message}; {len(lost)} of {ROUND_TRIPS} replies was '
                            f'missed: {lost[0]}')
            else:
                yield Check(board, OK, message)
    except HardwareError as error:
        yield Check('jamming port', FAIL, str(error))
        return
    finally:
        bus.close()
    if trips:
        yield _check_round_trip(trips, values['modbus.timeout'])


def _switching_board(bus: ModbusBus, values: Mapping[str, Any]
                     ) -> tuple[str, Callable[[int, int, int], tuple[int, ...]], int, range]:
    """Return the board that evacuates segments: how it is asked, its unit and its addresses."""
    if values['modbus.regulators']:
        outputs = Outputs.from_parameters(values)
        return OUTPUT_BOARD, bus.read_holding_registers, outputs.unit, outputs.registers
    relays = registers_from_parameters(values)
    return 'relay board', bus.read_coils, relays.relay_unit, relays.coils


def _state(board: str, address: int, state: int) -> str:
    if board == OUTPUT_BOARD:
        return f'register {address} is {state}'
    if isinstance(state, bool):
        return f'coil {address} {"on" if state else "off"}'
    return f'register {address} {state / 1000:.2f} mA'


def _check_round_trip(trips: list[float], timeout: float) -> Check:
    slowest = max(trips)
    message = (f'slowest of {len(trips)} replies after {1e3 * slowest:.0f} ms, '
               f'modbus.timeout is {1e3 * timeout:g} ms')
    if slowest > MAX_TIMEOUT_SHARE * timeout:
        return Check('modbus round trip', WARN,
                     f'{message}; set it to {2.0 / MAX_TIMEOUT_SHARE * slowest:.2f} s or more')
    return Check('modbus round trip', OK, message)


def _check_pump(pump: bool, evacuated: tuple[bool, ...]) -> Check:
    valves = ', '.join(f'segment {i + 1} {"to the pump" if e else "vented"}'
                       for i, e in enumerate(evacuated))
    message = f'pump {"on" if pump else "off"}; {valves}'
    if pump and not any(evacuated):
        return Check('pump and valves', WARN, f'{message}; the pump runs without need: start '
                     'jamming_valves, which switches it off, or check modbus.pump_coil and '
                     'modbus.energised_valve_evacuates')
    return Check('pump and valves', OK, message)


def _check_segment(step: str, values: Mapping[str, Any], pressure: float,
                   evacuated: bool, told: float) -> Check:
    if not isfinite(pressure):
        return Check(step, FAIL, 'no pressure: its transmitter gives no current between 3.6 and '
                     '21 mA; check its wires and its supply, and modbus.pressure_registers')
    vacuum = values['ambient_pressure'] - pressure
    message = f'{vacuum / 1e3:.1f} kPa of vacuum'
    if told:
        text = f'{message}, its regulator is set to {told / 1e3:.1f} kPa'
        if abs(vacuum - told) <= values['vacuum_tolerance']:
            return Check(step, OK, text)
        return Check(step, FAIL, f'{text}; if that was not a moment ago, its regulator, the '
                     'supply of the regulators or its sensor fails, or it leaks')
    if evacuated:
        return Check(step, WARN, f'{message}, connected to the pump: its sensor can be judged '
                     'only while it is vented; vent it and run this again')
    if abs(vacuum) > values['soft_vacuum']:
        return Check(step, FAIL, f'{message} though it is vented; if that was not a moment ago, '
                     'its sensor or valve is stuck, its vent is blocked, or '
                     'modbus.vacuum_at_4_ma, modbus.vacuum_at_20_ma and ambient_pressure do not '
                     'belong to this sensor')
    if abs(vacuum) > MAX_ZERO_ERROR:
        return Check(step, WARN, f'{message} though it is vented; adjust the zero of the '
                     'transmitter, modbus.vacuum_at_4_ma or ambient_pressure')
    return Check(step, OK, f'{message}, vented')
