# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Dynamixel servos: their required settings, how they are found and checked, and their state.

The settings are in the EEPROM of the servos, which is locked while their torque is on.  Only
``write_settings`` changes anything.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import hypot, pi
from typing import Any, Self

from soft_continuum.hardware.dynamixel import RADIUS_RANGE
from soft_continuum.hardware.dynamixel.bus import (
    DamagedReplyError,
    DynamixelBus,
    NoReplyError,
    Reply,
    ServoRejectedError,
)
from soft_continuum.hardware.dynamixel.registers import (
    BUS_WATCHDOG,
    CURRENT_BASED_POSITION,
    CURRENT_LIMIT,
    DISABLED_ID,
    DRIVE_MODE,
    explain_hardware_error,
    FIRMWARE,
    FULL_PWM,
    GOAL_CURRENT,
    GOAL_POSITION,
    HARDWARE_ERROR,
    HOMING_OFFSET,
    INPUT_VOLTAGE,
    MODELS,
    OPERATING_MODE,
    P_GAIN_UNIT,
    POSITION_P_GAIN,
    PRESENT_CURRENT,
    PRESENT_POSITION,
    PROFILE_VELOCITY,
    PWM_LIMIT,
    RADIANS_PER_PULSE,
    REALTIME_TICK,
    Register,
    SECONDARY_ID,
    ServoModel,
    SHUTDOWN,
    STARTUP,
    STATUS_RETURN_LEVEL,
    TEMPERATURE,
    TICK_RANGE,
    TORQUE_ENABLE,
    VELOCITY_LIMIT,
    VELOCITY_UNIT,
    WITHOUT_CURRENT,
)
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.hardware.serial_tendons import check_per_tendon
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.parameter import ParameterError

BAUD_RATES = 57600, 1000000, 115200, 2000000, 3000000, 4000000, 9600
"""Baud rates of the search when no servo replies; 57600 is the factory setting."""
PINGS = 3
"""Requests to each servo: two of the same ID rarely damage each other's replies always alike."""
MAX_MISSED = 1  # of them, where the computer is busy
BUSY_TIME = 0.1  # s to the next request after one without a reply
MIN_PWM_LIMIT = 443  # half of what the supply gives
OVERHEATING = 0x04
STOP_SHARE = 0.6  # of the lag: best of 0 to 1 with the emulated servos
ARRIVAL_TOLERANCE = 1e-4  # m, but at least two pulses
FRICTION_SHARE, FRICTION_OF_STALL = 0.3, 0.02  # of tension, and of the one at stall
RAM_RESTORE = 0x02
EEPROM_END, TABLE_END = 64, 147
CALIBRATE = 'soft_continuum calibrate servos'
BLOCK = TORQUE_ENABLE.address, PRESENT_POSITION.end
TICK_TOLERANCE = 0.1
"""Largest advance of a servo's clock over the computer's between two replies, s."""
ATTEMPTS = 5  # to read all servos, and to write what they must have or keep


@dataclass(frozen=True)
class Spools:
    """
    The servos and spools, one per tendon.

    tendons: their names.  ids: of the servos.  radii: of the spools to the middle of the tendon,
    m.  signs: 1 where a turn to larger positions (counter-clockwise, looking at the horn) pulls.
    tension_limits: N, kept by the servo.  torque_constants: N m/A of the horn, 0 for that of the
    data sheet.  speed_limit: m/s.  acceleration_limit: m/s^2.  pull_limits: m.  take_up_tension:
    N to which reference pulls each tendon; 0: it takes the present position.
    """

    tendons: tuple[str, ...]
    ids: tuple[int, ...]
    radii: tuple[float, ...]
    signs: tuple[float, ...]
    tension_limits: tuple[float, ...]
    torque_constants: tuple[float, ...]
    speed_limit: float
    acceleration_limit: float
    pull_limits: tuple[float, float]
    take_up_tension: float = 0.0

    def __post_init__(self) -> None:
        """Raise ParameterError when a list has not one value for each tendon, or a wrong one."""
        check_per_tendon(
            'dynamixel', self.tendons, signs=self.signs, ids=self.ids, spool_radii=self.radii,
            tension_limits=self.tension_limits, torque_constants=self.torque_constants)
        if len(set(self.ids)) < len(self.ids):
            raise ParameterError(f'parameter dynamixel.ids is {list(self.ids)}; every servo needs '
                                 'an ID of its own')
        low, high = RADIUS_RANGE
        for radius in self.radii:
            if not low <= radius <= high:
                hint = (f'; {radius:g} mm are {1e-3 * radius:g} m'
                        if low <= 1e-3 * radius <= high else '')
                raise ParameterError(
                    f'parameter dynamixel.spool_radii has {radius:g} m; allowed: {low:g} to '
                    f'{high:g} m{hint}')
        if self.take_up_tension >= min(self.tension_limits):
            raise ParameterError(
                f'parameter dynamixel.take_up_tension is {self.take_up_tension:g} N; it must be '
                f'less than each of dynamixel.tension_limits, {min(self.tension_limits):g} N')

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> Self:
        """Return what the parameters of the node describe; raises ParameterError."""
        return cls(arm_from_parameters(values).tendon_names, *(
            values[name] for name in (
                'dynamixel.ids', 'dynamixel.spool_radii', 'dynamixel.signs',
                'dynamixel.tension_limits', 'dynamixel.torque_constants', 'speed_limit',
                'acceleration_limit', 'pull_limits', 'dynamixel.take_up_tension')))

    @property
    def pull_per_pulse(self) -> tuple[float, ...]:
        """Pull of each tendon when its servo turns by one pulse, m."""
        return tuple(sign * radius * RADIANS_PER_PULSE
                     for sign, radius in zip(self.signs, self.radii, strict=True))

    @property
    def arrival_tolerances(self) -> tuple[float, ...]:
        """Position tolerance of each tendon, m, limited by friction."""
        return tuple(max(2.0 * abs(pulse), ARRIVAL_TOLERANCE) for pulse in self.pull_per_pulse)


@dataclass(frozen=True)
class FoundServo:
    """One servo as it was found; table: its registers from address 0 to TABLE_END."""

    id: int
    tendon: str
    model: ServoModel
    torque_constant: float
    radius: float
    tension_limit: float
    table: bytes

    def get(self, register: Register) -> int:
        """Return a register as it was then."""
        return register.decode(self.table, 0)

    def __str__(self) -> str:
        """Name it for a person."""
        return f'servo {self.id} ({self.tendon})'

    def current(self, tension: float) -> int:
        """Return the current (counts) that holds a tension (N)."""
        amperes = tension * self.radius / self.torque_constant
        return round(amperes / self.model.current_unit)

    def tension(self, counts: int) -> float:
        """Return the tension (N) of a current (counts) that pulls."""
        return counts * self.model.current_unit * self.torque_constant / self.radius

    def stddev(self, tension: float) -> float:
        """
        Return the standard deviation (N) with which a tension (N) is known from the current.

        The gear rubs: at rest it carries a part of the load that the motor does not feel, and in
        motion the motor feels its friction too.  The maker gives no figure, and none was measured
        here: the shares are assumptions for gears of four or five stages.
        """
        return hypot(FRICTION_SHARE * tension, self.least_stddev)

    @property
    def least_stddev(self) -> float:
        """Standard deviation of a tension near 0, N."""
        return FRICTION_OF_STALL * self.model.stall_torque / self.radius

    @property
    def stop_time(self) -> float:
        """
        Return the lead of the goal at which a turning servo stops soonest, as time, s.

        It lags behind a moving goal by its speed over the gain of its position loop.  Half of that
        leaves the least swing, whatever the delay of the motor; with some more none comes back.
        """
        return STOP_SHARE * self.lag_time

    @property
    def full_error(self) -> float:
        """Position error at which the servo applies the full voltage, pulses."""
        return FULL_PWM / max(self.get(POSITION_P_GAIN) * P_GAIN_UNIT, 1e-9)

    @property
    def lag_time(self) -> float:
        """Lag of a turning servo behind its goal, s."""
        return self.full_error * RADIANS_PER_PULSE / self.model.no_load_speed

    @property
    def homing_offset(self) -> int:
        """Offset that the servo adds to its position, pulses."""
        return self.get(HOMING_OFFSET)

    @property
    def goal_current(self) -> int:
        """Current that tension_limit allows, counts."""
        return self.current(self.tension_limit)

    def describe(self) -> str:
        """Return model, firmware, supply and temperature for a person."""
        return (f'{self.model.name}, firmware {self.get(FIRMWARE)}, '
                f'{0.1 * self.get(INPUT_VOLTAGE):.1f} V, {self.get(TEMPERATURE)} °C')


@dataclass(frozen=True)
class Written:
    """What the driver wrote to a servo: Bus Watchdog, Goal Current, Profile Velocity, goal."""

    watchdog: int
    current: int
    velocity: int
    goal: int


def profile_speed(written: Written) -> float:
    """Return the largest speed of a servo with the written values, pulses/s."""
    return written.velocity * VELOCITY_UNIT / RADIANS_PER_PULSE


@dataclass(frozen=True)
class ServoState:
    """
    One servo at a time between asked and time (s), when its reply was received.

    position: pulses.  current: counts.  tick: ms.  alert: whether it has a hardware error.
    torque: whether it is on.
    """

    asked: float
    time: float
    written: Written
    position: int
    current: int
    tick: int
    alert: bool
    torque: bool = True

    @classmethod
    def from_reply(cls, reply: Reply, asked: float, time: float) -> 'ServoState':
        """Return the state in a reply to a sync read of BLOCK."""
        def get(register: Register) -> int:
            return register.decode(reply.data, BLOCK[0])

        return cls(asked, time, Written(get(BUS_WATCHDOG), get(GOAL_CURRENT),
                                        get(PROFILE_VELOCITY),
                                        get(GOAL_POSITION)),
                   get(PRESENT_POSITION), get(PRESENT_CURRENT), get(REALTIME_TICK), reply.alert,
                   bool(get(TORQUE_ENABLE)))

    def follows(self, earlier: 'ServoState', fastest: float) -> bool:
        """Whether this state is plausible after ``earlier``; fastest: pulses/s."""
        elapsed = self.time - earlier.asked  # at most: a busy computer sees a reply late
        ticks = (self.tick - earlier.tick) % TICK_RANGE
        new = ticks > 0 or self.time - earlier.time < 0.002
        return (new and 1e-3 * ticks <= elapsed + TICK_TOLERANCE
                and abs(self.position - earlier.position) <= fastest * (elapsed + 0.02) + 20)


def read_states(bus: DynamixelBus, servos: Sequence[FoundServo]) -> list[ServoState]:
    """Return the state of all servos, by the fastest read instruction that they support."""
    ids = [servo.id for servo in servos]
    fast = bus.fast is not False
    for attempt in range(ATTEMPTS):
        bus.fast = fast and attempt < 2  # older firmware has no Fast Sync Read
        asked = bus.clock()
        try:
            replies = bus.sync_read(ids, *BLOCK)
        except (NoReplyError, DamagedReplyError) as error:
            reason = error
            continue
        return [ServoState.from_reply(reply, asked, bus.clock()) for reply in replies]
    raise HardwareError(f'the servos reply individually, but not together: {reason}')


def find_servos(bus: DynamixelBus, spools: Spools) -> list[FoundServo]:
    """
    Return the servos of all tendons; change nothing.

    Raises HardwareError for one that is missing, that is not alone with its ID, or that cannot
    measure its current, with what to do.
    """
    servos = []
    for i, (number, tendon) in enumerate(zip(spools.ids, spools.tendons, strict=True)):
        name = f'servo {number} ({tendon})'
        model = _model(name, _ping(bus, number, name, spools.ids))
        table = _table(bus, number, name)
        servos.append(FoundServo(
            number, tendon, model, spools.torque_constants[i] or model.torque_constant,
            spools.radii[i], spools.tension_limits[i], table))
    return servos


def _table(bus: DynamixelBus, number: int, name: str) -> bytes:
    """Return the registers of a servo that answered a ping."""
    damaged = 0
    for _ in range(PINGS):
        try:
            return bus.read_bytes(number, 0, TABLE_END).data
        except DamagedReplyError:
            damaged += 1
        except NoReplyError:
            continue
    if damaged:
        raise _doubled(number, name, damaged)
    raise HardwareError(f'{name} answers pings but not reads: its {STATUS_RETURN_LEVEL} is 0 '
                        '(switch it off and on), or its cable is bad')


def _ping(bus: DynamixelBus, number: int, name: str, ids: Sequence[int]) -> int:
    """Return the model number of a servo that answers every time, alone."""
    damaged = missed = 0
    model, late = -1, False
    for _ in range(PINGS):
        try:
            model, late = bus.ping(number), False
        except NoReplyError:
            missed, late = missed + 1, True
            bus.clock.sleep(BUSY_TIME)
        except DamagedReplyError:  # to a computer that is busy, the last reply may come with this
            damaged, late = damaged + (not late), False
    if damaged:
        raise _doubled(number, name, damaged)
    if missed == PINGS:
        raise HardwareError(_why_missing(bus, number, name, ids))
    if missed > MAX_MISSED:
        raise HardwareError(f'{name} answered {PINGS - missed} of {PINGS} requests; check its '
                            'cable and its supply')
    return model


def _doubled(number: int, name: str, damaged: int) -> HardwareError:
    return HardwareError(
        f'{damaged} of {PINGS} replies of {name} are damaged or duplicated: two servos may have '
        f'the ID {number} (connect one of them alone and give it another ID), or the baud rate or '
        'the line is wrong')


def _why_missing(bus: DynamixelBus, number: int, name: str, ids: Sequence[int]) -> str:
    """Look for a servo that does not reply as configured, and return what was found."""
    baud_rate = bus.baud_rate
    missing = f'{name} does not answer at {baud_rate} baud'
    others = sorted({*bus.find(ids), *bus.find_all()} - {number})
    if others:
        answering = ('servo {} does' if len(others) == 1 else 'servos {} do').format(
            ', '.join(map(str, others)))
        return (f'{missing}, but {answering}; check its cable, its supply and its ID '
                '(dynamixel.ids)')
    try:
        for rate in (baud_rate, *(rate for rate in BAUD_RATES if rate != baud_rate)):
            try:
                bus.baud_rate = rate
            except HardwareError:
                continue
            if bus.pings_in_protocol_1(number):
                return (f'{name} answers in Protocol 1.0 at {rate} baud; this driver needs '
                        'Protocol 2.0: set its Protocol Type (13) to 2 (with DYNAMIXEL Wizard), '
                        'if its model has that')
            if rate != baud_rate and bus.find(ids):
                return (f'{missing}, but at {rate} baud: set dynamixel.baud to {rate}, or the '
                        'Baud Rate (8) of the servos')
    finally:
        bus.baud_rate = baud_rate
    return (f'{missing}, and neither does any other servo; check dynamixel.port, dynamixel.ids, '
            'the cable and the power of the servos')


def _model(name: str, number: int) -> ServoModel:
    if number in WITHOUT_CURRENT:
        raise HardwareError(
            f'{name} is an {WITHOUT_CURRENT[number]}, which can neither measure nor limit its '
            'current, so nothing would limit the tension; use a model that can: '
            + ', '.join(sorted(model.name for model in MODELS.values())))
    if number not in MODELS:
        raise HardwareError(
            f'{name} has the model number {number}, which this driver does not support; it '
            'supports: '
            + ', '.join(sorted(model.name for model in MODELS.values())))
    return MODELS[number]


@dataclass(frozen=True)
class RegisterMismatch:
    """A register that must be different; needed: the value that calibrate servos writes."""

    register: Register
    value: int
    needed: int
    why: str

    def __str__(self) -> str:
        """Return the present and the needed value as text."""
        return f'{self.register} is {self.value}, needed: {self.needed}, {self.why}'


def unfit_settings(servo: FoundServo, speed_limit: float) -> list[RegisterMismatch]:
    """Return the EEPROM values of a servo to change; speed_limit: m/s of the tendon."""
    def unless(register: Register, fits: bool, needed: int, why: str) -> list[RegisterMismatch]:
        value = servo.get(register)
        return [] if fits else [RegisterMismatch(register, value, needed, why)]

    get = servo.get
    velocity = round(1.1 * speed_limit / servo.radius / VELOCITY_UNIT) + 1
    return [
        *unless(OPERATING_MODE, get(OPERATING_MODE) == CURRENT_BASED_POSITION,
                CURRENT_BASED_POSITION, 'current-based position control'),
        *unless(DRIVE_MODE, get(DRIVE_MODE) == 0, 0,
                'not reversed (give dynamixel.signs), no slave, profile by velocity, and no '
                'torque by a goal alone'),
        *unless(SECONDARY_ID, get(SECONDARY_ID) >= DISABLED_ID, 255,
                'none: it would obey another servo'),
        *unless(STARTUP, not get(STARTUP) & RAM_RESTORE, get(STARTUP) & ~RAM_RESTORE,
                'or a loss of power could not be detected'),
        *unless(SHUTDOWN, bool(get(SHUTDOWN) & OVERHEATING), 52,
                'or it would not protect itself from overheating'),
        *unless(PWM_LIMIT, get(PWM_LIMIT) >= MIN_PWM_LIMIT, 885,
                f'at least {MIN_PWM_LIMIT}, to hold tension'),
        *unless(CURRENT_LIMIT, get(CURRENT_LIMIT) >= servo.goal_current, servo.goal_current,
                f'at least, for dynamixel.tension_limits of {servo.tension_limit:g} N'),
        *unless(VELOCITY_LIMIT, get(VELOCITY_LIMIT) >= velocity, velocity,
                f'at least, for speed_limit of {speed_limit:g} m/s'),
    ]


def problems(servo: FoundServo, speed_limit: float) -> list[str]:
    """Return why a servo cannot be used, each with a remedy; empty if it can."""
    found = []
    if status := servo.get(HARDWARE_ERROR):
        found.append(
            f'{servo} has shut down, so its tendon has no tension: '
            f'{explain_hardware_error(status)}; then pay out the tendons that load it and reboot '
            f'it with {CALIBRATE}')
    if unfit := unfit_settings(servo, speed_limit):
        found.append(f'{servo}: {"; ".join(map(str, unfit))}; with slack tendons {CALIBRATE} sets '
                     'this (EEPROM is locked while torque is on)')
    if servo.goal_current < 1:
        found.append(
            f'{servo}: dynamixel.tension_limits of {servo.tension_limit:g} N is less than one '
            f'count of its current, {servo.tension(1):.2g} N; give more, or use a larger spool')
    speed = servo.model.no_load_speed * servo.radius
    if speed_limit > speed:
        found.append(
            f'{servo}: speed_limit is {speed_limit:g} m/s, but an {servo.model.name} turns at '
            f'{servo.model.no_load_speed * 30.0 / pi:.0f} rev/min at most, {speed:.3g} m/s on its '
            'spool; lower speed_limit')
    stall = servo.model.stall_torque / servo.radius
    if servo.tension_limit > stall:
        found.append(
            f'{servo}: dynamixel.tension_limits is {servo.tension_limit:g} N, but an '
            f'{servo.model.name} stalls at {stall:.3g} N on its spool; check '
            'dynamixel.spool_radii (m)')
    return found


def write_settings(bus: DynamixelBus, servo: FoundServo, unfit: Sequence[RegisterMismatch]
                   ) -> None:
    """
    Switch the torque of a servo off and write its EEPROM; the tendon must be slack.

    Raises HardwareError for a rejected value.
    """
    bus.write(servo.id, TORQUE_ENABLE, 0)
    for item in unfit:
        try:
            bus.write(servo.id, item.register, item.needed)
        except ServoRejectedError as error:
            raise HardwareError(f'{servo} does not accept {item.register} {item.needed}: {error}'
                                ) from None
        if (value := bus.read(servo.id, item.register)) != item.needed:
            raise HardwareError(f'{servo}: {item.register} is {value} after {item.needed} was '
                                'written')
