# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
A servo of the X series with its spool and tendon: registers, their checks, control loop, motor.

After the pages of the models and _includes/en/dxl/x/ of the ROBOTIS e-Manual.  Behaviour that
those leave open is marked 'assumed'; the choice is the hardest one for a driver.

A DC motor: its torque falls from the stall torque to nothing at the speed without load, both in
proportion to the voltage.  The gears rub with a part of the load and a part of the stall torque,
and the tendon turns the spool back when nothing holds it.  Inertia and friction are assumptions
(the maker gives neither): they are the order of what such servos show.

The loop is that of 'Position PID Gain' and 'Operating Mode' of the e-Manual: the profile gives the
desired position, a PID of its error the PWM, Goal PWM limits that, and in Current-based Position
Control Goal Current limits the current, and so the torque.  Feedforward is left out.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import copysign, floor, inf, sqrt
import random

from soft_continuum.sim.emulators.dynamixel_models import (
    ACCELERATION_UNIT,
    control_table,
    CURRENT,
    CURRENT_POSITION,
    EEPROM_END,
    EmulatedModel,
    EXTENDED,
    Field,
    FULL_PWM,
    POSITION,
    PULSE,
    PULSES,
    PWM,
    VELOCITY,
    VELOCITY_UNIT,
    WATCHDOG_UNIT,
)
from soft_continuum.sim.emulators.dynamixel_packets import ALERT, Error, Instruction

TIME_CONSTANT = 0.015  # s in which the motor follows a voltage, est
LOAD_FRICTION = 0.1  # of the load torque, est
OWN_FRICTION = 0.01  # of the stall torque, est
OFF_DAMPING = 0.1  # of the damping of the powered motor, est
STICTION, STANDSTILL = 1.2, 1e-3
"""Factor of friction below this speed (rad/s), est."""
P_UNIT, I_UNIT, D_UNIT = 1.0 / 128.0, 1.0 / 65536.0, 1.0 / 16.0
LOOP_TIME = 1e-3  # s of one step of the sums of the integral and the derivative; assumed
GOALS = frozenset(('Goal PWM', 'Goal Current', 'Goal Velocity', 'Goal Position'))
WATCHDOG_ERROR = 255  # -1 in a byte
VOLTAGE_ERROR, HEAT_ERROR, ENCODER_ERROR, SHOCK_ERROR, OVERLOAD_ERROR = 1, 4, 8, 16, 32
CLEAR_TURNS = b'\x01\x44\x58\x4c\x22'
BOOT_TIME = 0.3  # s without an answer after power or Reboot; assumed
OVERLOAD_TIME = 1.0  # s at OVERLOAD_SHARE of the stall torque; assumed
OVERLOAD_SHARE = 0.95
CURRENT_NOISE = 1.5  # steps of Present Current, standard deviation; assumed
IN_POSITION, FOLLOWING = 20, 200  # pulses; assumed
ROOM_TEMPERATURE = 30  # degrees C
ANSWERED_AT_LEVEL: dict[int, int] = {
    Instruction.PING: 0, Instruction.READ: 1, Instruction.SYNC_READ: 1,
    Instruction.FAST_SYNC_READ: 1, Instruction.BULK_READ: 1, Instruction.FAST_BULK_READ: 1}
"""The lowest Status Return Level at which a servo replies; 2 for all others."""
STEP, RECTANGULAR, TRIANGULAR, TRAPEZOIDAL = range(4)
"""Profile types, bits 4 and 5 of Moving Status."""
NEAR = 0.01  # pulses


@dataclass
class SpringTendon:
    """
    A tendon on a spool, as a spring that cannot push.

    radius: m.  sign: 1 if positive angles pull it in.  stiffness: N/m.  slack: m that must be
    pulled in before it is taut.  weight: additional load, N.  tension: N, from the plant of a
    twin, which then replaces all these.
    """

    radius: float = 0.01
    sign: int = 1
    stiffness: float = 2000.0
    slack: float = 0.0
    weight: float = 0.0
    tension: float | None = None

    def pull(self, angle: float) -> float:
        """Return the pull (m) at an angle (rad) of the spool."""
        return self.sign * self.radius * angle

    def tension_at(self, angle: float) -> float:
        """Return the tension, N."""
        if self.tension is not None:
            return self.tension
        return max(0.0, self.stiffness * (self.pull(angle) - self.slack)) + self.weight


class Motor:
    """
    A motor, its gears and its spool; positive torque and angle have the same direction.

    angle: rad since the beginning.  speed: rad/s.  torque: N m, of the motor before the gears rub.
    caught: it is blocked.
    """

    def __init__(self, model: EmulatedModel, tendon: SpringTendon) -> None:
        """Stand at angle 0."""
        self.tendon = tendon
        self.angle = self.speed = self.torque = 0.0
        self.caught = False
        self._stall = model.stall_torque
        self._damping = model.stall_torque / model.full_speed
        self._inertia = TIME_CONSTANT * self._damping

    @property
    def pull(self) -> float:
        """Pull of the tendon, m."""
        return self.tendon.pull(self.angle)

    @property
    def tension(self) -> float:
        """Tension of the tendon, N."""
        return self.tendon.tension_at(self.angle)

    def step(self, time: float, voltage: float, limit: float) -> None:
        """
        Advance by a short time (s).

        voltage: part of the full one, -1 to 1.  limit: largest torque, N m; 0 is switched off.
        """
        load = -self.tendon.sign * self.tendon.radius * self.tension
        friction = LOAD_FRICTION * abs(load) + OWN_FRICTION * self._stall
        driving, damping, mass = voltage * self._stall, self._damping, self._inertia / time
        if limit <= 0.0:
            driving, damping = 0.0, OFF_DAMPING * self._damping
        speed = (mass * self.speed + driving + load) / (mass + damping)
        self.torque = driving - damping * speed if limit > 0.0 else 0.0
        if abs(self.torque) > limit > 0.0:
            self.torque = copysign(limit, self.torque)
            speed = (mass * self.speed + self.torque + load) / (mass + OFF_DAMPING * damping)
        lost = (1.0 if self.speed else STICTION) * friction / mass
        stands = self.caught or abs(speed) <= lost + STANDSTILL
        self.speed = 0.0 if stands else speed - copysign(friction / mass, speed)
        if self.speed == 0.0 and limit > 0.0:  # nothing that turns weakens it
            self.torque = max(-limit, min(limit, driving))
        self.angle += self.speed * time


class Control:
    """Voltage and torque limit for a motor; values: the control table by names."""

    def __init__(self, motor: Motor, values: Mapping[str, int], model: EmulatedModel) -> None:
        """Stand."""
        self.profile = Profile(0.0)
        self.voltage = 0.0
        self._motor, self._values, self._model = motor, values, model
        self._sum = self._before = 0.0
        self._stopped = False

    def hold(self, position: float) -> None:
        """Keep a position (pulses)."""
        self.profile.hold(position)
        self._sum = self._before = 0.0
        self._stopped = False

    def stop(self, position: float) -> None:
        """Keep a position in every mode until there is a new goal."""
        self.hold(position)
        self._stopped = True

    def resume(self) -> None:
        """Follow the goals of the mode again after a stop."""
        self._stopped = False

    def begin(self, goal: int) -> None:
        """Go to a goal (pulses)."""
        values = self._values
        self.resume()
        if values['Drive Mode'] & 4:
            self.profile.begin_timed(goal, 1e-3 * values['Profile Velocity'],
                                     1e-3 * values['Profile Acceleration'])
        else:
            self.profile.begin(goal, values['Profile Velocity'] * VELOCITY_UNIT,
                               values['Profile Acceleration'] * ACCELERATION_UNIT)

    def step(self, time: float, position: float) -> None:
        """Advance by a short time (s); position: as the servo counts it, pulses."""
        values, model = self._values, self._model
        if not values['Torque Enable']:
            self.profile.hold(position)
            self._sum = self._before = self.voltage = 0.0
            self._motor.step(time, 0.0, 0.0)
            return
        mode, limit = values['Operating Mode'], 2.0 * model.stall_torque
        most = abs(values['Goal PWM']) / FULL_PWM
        sign = -1.0 if values['Drive Mode'] & 1 else 1.0
        if self._stopped and mode in (CURRENT, VELOCITY, PWM):
            voltage = self._of_position(time, position)
        elif mode == PWM:
            voltage = values['Goal PWM'] / FULL_PWM
        elif mode == CURRENT:
            limit = self._torque(values['Goal Current'])
            voltage = 1.0 if values['Goal Current'] > 0 else -1.0
        elif mode == VELOCITY:
            wanted = values['Goal Velocity'] * VELOCITY_UNIT * PULSE
            now = sign * self._motor.speed
            voltage = self._limited(wanted + 5.0 * (wanted - now), model.full_speed)
        else:
            self.profile.advance(time)
            voltage = self._of_position(time, position)
            if mode == CURRENT_POSITION:
                limit = self._torque(values['Goal Current'])
        self.voltage = sign * max(-most, min(most, voltage))
        # A torque of 0 would be a motor that is switched off.
        self._motor.step(time, self.voltage, max(limit, 1e-9))

    def _torque(self, current: int) -> float:
        return abs(current) * self._model.current_unit * self._model.torque_constant

    @staticmethod
    def _limited(speed: float, full_speed: float) -> float:
        return max(-1.0, min(1.0, speed / full_speed))

    def _of_position(self, time: float, position: float) -> float:
        """Return what the PID gives, as a part of the full voltage."""
        values = self._values
        error = self.profile.position - position
        steps = time / LOOP_TIME
        change, self._before = (error - self._before) / steps, error
        integral = values['Position I Gain'] * I_UNIT
        if integral:
            most = FULL_PWM / integral
            self._sum = max(-most, min(most, self._sum + error * steps))
        else:
            self._sum = 0.0
        return (values['Position P Gain'] * P_UNIT * error + integral * self._sum
                + values['Position D Gain'] * D_UNIT * change) / FULL_PWM


class Profile:
    """
    A desired position (pulses) and speed (pulses/s) on the way to ``goal``.

    A new goal starts from the present speed.
    """

    def __init__(self, position: float) -> None:
        """Stand."""
        self.hold(position)

    def hold(self, position: float) -> None:
        """End here, at once."""
        self.position = self.goal = position
        self.speed = 0.0
        self.kind = STEP
        self._limit = self._acceleration = inf

    @property
    def ongoing(self) -> bool:
        """Whether the goal has not been reached."""
        return self.position != self.goal

    def begin(self, goal: float, velocity: float, acceleration: float) -> None:
        """Go to ``goal``; velocity (pulses/s) 0 is a step, acceleration (pulses/s^2) 0 endless."""
        self.goal = goal
        self._limit = velocity or inf
        self._acceleration = acceleration or inf
        if not velocity:
            self.kind = STEP
        elif not acceleration:
            self.kind = RECTANGULAR
        else:
            reached = velocity**2 / acceleration < abs(goal - self.position)
            self.kind = TRAPEZOIDAL if reached else TRIANGULAR

    def begin_timed(self, goal: float, duration: float, ramp: float) -> None:
        """Go to ``goal`` in ``duration`` s (0: a step), of which ``ramp`` s each to start, end."""
        ramp = min(ramp, 0.5 * duration)
        velocity = abs(goal - self.position) / (duration - ramp) if duration else 0.0
        self.begin(goal, velocity, velocity / ramp if ramp else 0.0)

    def advance(self, time: float) -> None:
        """Let time (s) pass."""
        left = self.goal - self.position
        if self._limit == inf:
            self.position, self.speed = self.goal, 0.0
            return
        if self._acceleration == inf:
            wanted = min(self._limit, abs(left) / time)
            self.speed = wanted if left > 0.0 else -wanted
        else:
            change = self._acceleration * time
            # Of a braking in steps of time, so that it ends at the goal.
            wanted = min(self._limit, abs(left) / time,
                         sqrt(change**2 / 4.0 + 2.0 * self._acceleration * abs(left)) - change / 2)
            wanted = wanted if left > 0.0 else -wanted
            self.speed += max(-change, min(change, wanted - self.speed))
        self.position += self.speed * time
        if abs(self.goal - self.position) < NEAR and abs(self.speed) * time < 1.0:
            self.position, self.speed = self.goal, 0.0


class DynamixelServo:
    """
    A servo; times are s.

    motor: ground truth of spool and tendon.  values: the control table by names.  supply: V.
    temperature: degrees C.  hang: it does not reply, but goes on.  powered: it has power.
    """

    def __init__(self, model: EmulatedModel, device: int = 1,
                 tendon: SpringTendon | None = None, *, baud_code: int = 1, start: int = 1000
                 ) -> None:
        """Switch on; start: what the encoder reads, pulses."""
        self.model = model
        self.table = control_table(model)
        self.motor = Motor(model, tendon or SpringTendon())
        self._device = device
        self.values = {name: field.initial for name, field in self.table.items()}
        self.values.update({'ID': device, 'Baud Rate': baud_code})
        self.supply, self.temperature = model.voltage, ROOM_TEMPERATURE
        self.hang, self.powered = False, True
        self.broken = 0
        """Bits of hardware errors that stay until they are repaired."""
        self.time = self.heard = 0.0
        self._start = start
        self._random = random.Random(device)
        self._control = Control(self.motor, self.values, model)
        self._starts = {field.address: field for field in self.table.values()}
        self._bytes = {field.address + i: (field, 8 * i) for field in self.table.values()
                       for i in range(field.size)}
        self._indirect = {field.address: name.replace('Data', 'Address')
                          for name, field in self.table.items() if 'Indirect Data' in name}
        self._registered: tuple[int, bytes] | None = None
        self._turns = self._shut_down = 0
        self._overloaded = 0.0  # s
        self._boot()
        self._ready = 0.0

    # Power

    @property
    def answering(self) -> bool:
        """Whether it receives and replies."""
        return self.powered and not self.hang and self.time >= self._ready

    @property
    def torque(self) -> bool:
        """Whether its motor holds or moves."""
        return self.powered and self.values['Torque Enable'] == 1

    @property
    def resting(self) -> bool:
        """Whether only the tendon changes with time."""
        return (self.motor.speed == 0.0 and not self._control.profile.ongoing
                and self.time >= self._ready)

    def power_off(self) -> None:
        """Take its power: the motor is free."""
        self.powered = False

    def power_on(self) -> None:
        """Give it power again."""
        self.powered = True
        self._boot()

    def repair(self) -> None:
        """Clear lasting faults; a motor that was switched off stays off until a reboot."""
        self.hang, self.broken, self.motor.caught = False, 0, False
        self.supply, self.temperature = self.model.voltage, ROOM_TEMPERATURE
        self.motor.tendon.weight = 0.0
        self.values['ID'] = self._device

    def _boot(self) -> None:
        for field in self.table.values():
            if field.address >= EEPROM_END:
                self.values[field.name] = field.initial
        self._shut_down = 0
        self._registered = None
        self._booted, self._ready = self.time, self.time + BOOT_TIME
        self.heard = self._ready
        self._clear_turns()
        self._reset_goals()
        self.values['Torque Enable'] = self.values['Startup Configuration'] & 1

    def set_up(self, name: str, value: int) -> None:
        """Write an item of the control table as another program did before: unchecked."""
        torque, self.values['Torque Enable'] = self.values['Torque Enable'], 0
        self._change(name, value)
        self.values['Torque Enable'] = torque

    # Position

    @property
    def position(self) -> float:
        """Present Position with decimals, pulses."""
        return self._raw() + self._turns + self._offset()

    def _raw(self) -> float:
        pulses = self._start + self.motor.angle / PULSE
        return -pulses if self.values['Drive Mode'] & 1 else pulses

    def _offset(self) -> int:
        offset = self.values['Homing Offset']
        return 0 if self.values['Operating Mode'] == POSITION and abs(offset) > 1024 else offset

    def _clear_turns(self) -> None:
        """Keep of the position only where in its turn it is."""
        self._turns = -PULSES * floor(self._raw() / PULSES)
        self._hold()

    def _hold(self) -> None:
        self._control.hold(self.position)

    def _reset_goals(self) -> None:
        """Do what a change of the mode does (control_table_opmode_six_2.md)."""
        for name in ('Goal Velocity', 'Profile Velocity', 'Profile Acceleration'):
            self.values[name] = 0
        self.values['Goal PWM'] = self.values['PWM Limit']
        if self.model.current_unit:
            self.values['Goal Current'] = self.values['Current Limit']
        for name in self.values:
            if 'Gain' in name:
                self.values[name] = self.table[name].initial
        self.values['Goal Position'] = floor(self.position)

    # Time

    def advance(self, time: float) -> None:
        """Advance by a short time (s)."""
        self.time += time
        if not self.powered:
            self.motor.step(time, 0.0, 0.0)
            return
        values = self.values
        watchdog = values['Bus Watchdog']
        if (values['Torque Enable'] and 0 < watchdog < WATCHDOG_ERROR
                and self.time - self.heard > watchdog * WATCHDOG_UNIT):
            self.expire()
        self._watch_health(time)
        self._control.step(time, self.position)

    def expire(self) -> None:
        """Stop all motion, as the Bus Watchdog does: the torque stays on."""
        self.values['Bus Watchdog'] = WATCHDOG_ERROR
        self.values['Profile Velocity'] = self.values['Profile Acceleration'] = 0
        self._control.stop(self.position)

    def fail(self, error: int) -> None:
        """Notice a hardware error (its bits) for a moment; some errors switch the motor off."""
        self._shut_down |= error & self.values['Shutdown']
        if self._shut_down:
            self.values['Torque Enable'] = 0
        self.values['Hardware Error Status'] = self._shut_down | error

    def _watch_health(self, time: float) -> None:
        values = self.values
        volts, error = round(10.0 * self.supply), self.broken
        if not values['Min Voltage Limit'] <= volts <= values['Max Voltage Limit']:
            error |= VOLTAGE_ERROR
        if self.temperature > values['Temperature Limit']:
            error |= HEAT_ERROR
        most = OVERLOAD_SHARE * self.model.stall_torque
        self._overloaded = self._overloaded + time if abs(self.motor.torque) > most else 0.0
        if self._overloaded > OVERLOAD_TIME:
            error |= OVERLOAD_ERROR
        self.fail(error)

    # Instructions

    def execute(self, instruction: int, parameters: bytes) -> tuple[int, bytes] | None:
        """Carry out an instruction for it; return error and data, None for no answer."""
        error, data = self._execute(instruction, parameters)
        if self.values['Status Return Level'] < ANSWERED_AT_LEVEL.get(instruction, 2):
            return None
        alert = ALERT if self.values['Hardware Error Status'] else 0
        return error | alert, data if error == Error.NONE else b''

    def _execute(self, what: int, parameters: bytes) -> tuple[Error, bytes]:
        data, error = b'', Error.NONE
        number = int.from_bytes(parameters[:2], 'little')
        if what == Instruction.PING:
            data = self.model.number.to_bytes(2, 'little') + bytes([self.model.firmware])
        elif what == Instruction.READ and len(parameters) == 4:
            return self.read(number, int.from_bytes(parameters[2:], 'little'))
        elif what == Instruction.WRITE and len(parameters) > 2:
            error = self.write(number, parameters[2:])
        elif what == Instruction.REG_WRITE and len(parameters) > 2:
            error = self.write(number, parameters[2:], only_check=True)
            if error is Error.NONE:
                self._registered = number, parameters[2:]
                self.values['Registered Instruction'] = 1
        elif what == Instruction.ACTION and self._registered:
            error = self.write(*self._registered)
            self._registered = None
            self.values['Registered Instruction'] = 0
        elif what == Instruction.REBOOT:
            self._boot()
        elif what == Instruction.CLEAR and parameters == CLEAR_TURNS:
            if self.motor.speed:
                error = Error.RESULT_FAIL
            else:
                self._clear_turns()
        elif what == Instruction.FACTORY_RESET and parameters in (b'\xff', b'\1', b'\2'):
            self._reset_to_factory(keep={b'\1': ('ID',), b'\2': ('ID', 'Baud Rate')}.get(
                parameters, ()))
        else:
            error = Error.INSTRUCTION
        return error, data

    def _reset_to_factory(self, keep: tuple[str, ...]) -> None:
        for field in self.table.values():
            if field.name not in keep:
                self.values[field.name] = field.initial
        self._boot()

    def read(self, address: int, length: int) -> tuple[Error, bytes]:
        """Return bytes of the control table; what lies between its items is 0 (assumed)."""
        last = max(self._bytes)
        if length < 1 or address + length - 1 > last:
            return Error.ACCESS, b''
        self._refresh()
        values, places = self.values, self._bytes
        return Error.NONE, bytes(values[places[real][0].name] >> places[real][1] & 0xFF
                                 if real in places else 0 for real in self._real(address, length))

    def write(self, address: int, data: bytes, only_check: bool = False) -> Error:
        """Write items of the control table, all or none of them; return why not."""
        real, changes, i = self._real(address, len(data)), [], 0
        while i < len(real):
            field = self._starts.get(real[i])
            if field is None:
                return Error.DATA_LENGTH if real[i] in self._bytes else Error.ACCESS
            if field.low is None:
                return Error.ACCESS
            if real[i:i + field.size] != list(range(real[i], real[i] + field.size)):
                return Error.DATA_LENGTH
            value = int.from_bytes(data[i:i + field.size], 'little', signed=field.signed)
            error = self._why_not(field, value)
            if error is not Error.NONE:
                return error
            changes.append((field.name, value))
            i += field.size
        if not only_check:
            for name, value in changes:
                self._change(name, value)
        return Error.NONE

    def _real(self, address: int, length: int) -> list[int]:
        """Return what addresses stand for: of Indirect Data, what its Indirect Address says."""
        return [self.values[self._indirect[a]] if a in self._indirect else a
                for a in range(address, address + length)]

    def _why_not(self, field: Field, value: int) -> Error:
        values, name = self.values, field.name
        if field.address < EEPROM_END and values['Torque Enable']:
            return Error.ACCESS
        failed = values['Bus Watchdog'] == WATCHDOG_ERROR
        if failed and (name in GOALS or (name == 'Bus Watchdog' and value)):  # the latter assumed
            return Error.DATA_RANGE
        if not (field.low or 0) <= value <= field.high or (
                name == 'Operating Mode' and value not in self.model.modes) or (
                name == 'Protocol Type' and 2 < value < 20):
            return Error.DATA_RANGE
        if name in GOALS and not self._within_limits(name, value):
            return Error.DATA_LIMIT
        if name == 'Torque Enable' and value and self._shut_down:
            return Error.RESULT_FAIL  # that it stays off is said; the error is assumed
        return Error.NONE

    def _within_limits(self, name: str, value: int) -> bool:
        values = self.values
        if name != 'Goal Position':
            return abs(value) <= values[name.removeprefix('Goal ') + ' Limit']
        return (values['Operating Mode'] in (EXTENDED, CURRENT_POSITION)
                or values['Min Position Limit'] <= value <= values['Max Position Limit'])

    def _change(self, name: str, value: int) -> None:
        before, self.values[name] = self.values[name], value
        if name in GOALS and self.values['Drive Mode'] & 8 and not self.torque:
            self._change('Torque Enable', 1)
            self.values[name] = value
        if name == 'Torque Enable' and value and not before:
            if self.values['Operating Mode'] == POSITION:
                self._clear_turns()
            self._hold()
            self.values['Goal Position'] = floor(self.position)
        elif name in ('Operating Mode', 'Drive Mode') and value != before:
            if name == 'Drive Mode' or value == POSITION:
                self._clear_turns()
            if name == 'Operating Mode':
                self._reset_goals()
        elif name == 'Goal Position' and self.torque:
            self._control.begin(value)
        elif name in GOALS:
            self._control.resume()

    def _refresh(self) -> None:
        """Put what is measured into the table."""
        values, control, motor = self.values, self._control, self.motor
        sign = -1 if values['Drive Mode'] & 1 else 1
        speed = sign * motor.speed / PULSE
        profile = control.profile
        position = floor(self.position)
        values['Realtime Tick'] = int(1000.0 * (self.time - self._booted)) % 32768
        values['Moving'] = int(
            profile.ongoing or abs(speed) > values['Moving Threshold'] * VELOCITY_UNIT)
        values['Moving Status'] = (
            profile.kind << 4 | 8 * (abs(profile.position - position) > FOLLOWING)
            | 2 * profile.ongoing | (abs(profile.goal - position) < IN_POSITION))
        values['Present PWM'] = round(sign * control.voltage * FULL_PWM) if self.torque else 0
        if self.model.current_unit:
            current = sign * motor.torque / self.model.torque_constant / self.model.current_unit
            values['Present Current'] = round(self._random.gauss(current, CURRENT_NOISE))
        else:
            values['Present Current'] = round(1000.0 * sign * control.voltage)
        values['Present Velocity'] = round(speed / VELOCITY_UNIT)
        values['Present Position'] = position
        values['Velocity Trajectory'] = round(profile.speed / VELOCITY_UNIT)
        values['Position Trajectory'] = floor(profile.position)
        values['Present Input Voltage'] = round(10.0 * self.supply)
        values['Present Temperature'] = round(self.temperature)
        values['Backup Ready'] = 0
