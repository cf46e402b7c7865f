# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Models of the Dynamixel X series, and their control tables.

Addresses, ranges, initial values and what a model can do are from its page of the ROBOTIS e-Manual
(https://emanual.robotis.com/docs/en/dxl/x/, files docs/en/dxl/x/*.md and _includes/en/dxl/x/*.md
of github.com/ROBOTIS-GIT/emanual), model numbers also from param/dxl_model of
github.com/ROBOTIS-GIT/dynamixel_hardware_interface.  The emulator and the driver interpret them
independently, so that each checks the other.
"""

from dataclasses import dataclass
from functools import cache
from math import pi

PULSES = 4096
"""Pulses per turn of the output."""
PULSE = 2.0 * pi / PULSES  # rad
VELOCITY_UNIT = 0.229 * PULSES / 60.0  # pulses/s: 0.229 rev/min
ACCELERATION_UNIT = 214.577 * PULSES / 3600.0  # pulses/s^2: 214.577 rev/min^2
FULL_PWM = 885
WATCHDOG_UNIT = 0.02  # s
RETURN_DELAY_UNIT = 2e-6  # s
BAUD_RATES = (9600, 57600, 115200, 1000000, 2000000, 3000000, 4000000, 4500000)
EEPROM_END = 64
MAX_TURNS = 256 * PULSES - 1  # pulses, in the modes with more than one turn

CURRENT, VELOCITY, POSITION, EXTENDED, CURRENT_POSITION, PWM = 0, 1, 3, 4, 5, 16


@dataclass(frozen=True)
class EmulatedModel:
    """
    A model; torque and currents at ``voltage``, as its page gives them.

    stall_torque: N m.  stall_current: A.  no_load_speed: rev/min.  current_unit: A of one step of
    Goal Current and Present Current; 0: the model measures no current.  Limits are initial values
    in the units of the table; voltages: V x 10, range and initial values of the limits.
    old_protocol: whether it can be set to Protocol 1.0.  gains: Velocity I, P, Position D, I, P.
    """

    name: str
    number: int
    firmware: int
    voltage: float
    stall_torque: float
    stall_current: float
    no_load_speed: float
    current_unit: float
    current_limit: int
    velocity_limit: int
    max_velocity_limit: int
    temperature_limit: int
    voltage_range: tuple[int, int]
    voltage_limits: tuple[int, int]
    shutdown: int
    gains: tuple[int, int, int, int, int]
    old_protocol: bool
    indirect: tuple[tuple[int, int, int], ...]
    """Addresses of the first Indirect Address and Indirect Data of a block, and how many."""

    @property
    def torque_constant(self) -> float:
        """Torque per current, N m/A, of the stalled servo."""
        return self.stall_torque / self.stall_current

    @property
    def full_speed(self) -> float:
        """Speed without load, rad/s."""
        return self.no_load_speed * pi / 30.0

    @property
    def modes(self) -> tuple[int, ...]:
        """The operating modes that it has."""
        modes = CURRENT, VELOCITY, POSITION, EXTENDED, CURRENT_POSITION, PWM
        return modes if self.current_unit else tuple(
            mode for mode in modes if mode not in (CURRENT, CURRENT_POSITION))


_SMALL_INDIRECT = ((168, 208, 20),)
_LARGE_INDIRECT = ((168, 224, 28), (578, 634, 28))

MODELS = {model.name: model for model in (
    EmulatedModel(
        'XL330-M288', 1200, 52, 5.0, 0.52, 1.47, 103.0, 1e-3, 1750, 445, 2047, 70, (31, 70),
        (35, 70), 53, (1600, 180, 0, 0, 400), False, _SMALL_INDIRECT),
    EmulatedModel(
        'XC330-T288', 1220, 52, 11.1, 0.92, 0.80, 65.0, 1e-3, 910, 320, 2047, 70, (55, 140),
        (55, 140), 52, (1200, 40, 0, 0, 900), False, _SMALL_INDIRECT),
    EmulatedModel(
        'XM430-W350', 1020, 48, 12.0, 4.1, 2.3, 46.0, 2.69e-3, 1193, 200, 1023, 80, (95, 160),
        (95, 160), 52, (1920, 100, 0, 0, 800), True, _LARGE_INDIRECT),
    EmulatedModel(
        'XM540-W270', 1120, 48, 12.0, 10.6, 4.4, 30.0, 2.69e-3, 2047, 128, 1023, 80, (95, 160),
        (95, 160), 52, (1920, 100, 0, 0, 800), True, _LARGE_INDIRECT),
    EmulatedModel(
        'XL430-W250', 1060, 48, 11.1, 1.4, 1.3, 57.0, 0.0, 0, 265, 1023, 72, (60, 140),
        (60, 140), 52, (1000, 100, 4000, 0, 640), True, _LARGE_INDIRECT),
)}


@dataclass(frozen=True)
class Field:
    """An item of a control table; low and high: what may be written, or None for read only."""

    name: str
    address: int
    size: int
    initial: int = 0
    low: int | None = None
    high: int = 0

    @property
    def signed(self) -> bool:
        """Whether negative values are meant."""
        return self.name in _SIGNED or (self.low is not None and self.low < 0)


_SIGNED = frozenset((
    'Present PWM', 'Present Current', 'Present Velocity', 'Present Position',
    'Velocity Trajectory', 'Position Trajectory'))


@cache
def control_table(model: EmulatedModel) -> dict[str, Field]:
    """Return the items of a model by their names, in the order of their addresses."""
    low_voltage, high_voltage = model.voltage_range
    vi, vp, pd, pi_, pp = model.gains
    small = model.indirect is _SMALL_INDIRECT
    protocols = (1, 2) if model.old_protocol else (2, 22)
    fields = [
        Field('Model Number', 0, 2, model.number),
        Field('Model Information', 2, 4),
        Field('Firmware Version', 6, 1, model.firmware),
        Field('ID', 7, 1, 1, 0, 252),
        Field('Baud Rate', 8, 1, 1, 0, 6 if small else 7),
        Field('Return Delay Time', 9, 1, 250, 0, 254),
        Field('Drive Mode', 10, 1, 0, 0, 13),
        Field('Operating Mode', 11, 1, POSITION, 0, 16),
        Field('Secondary ID', 12, 1, 255, 0, 255),
        Field('Protocol Type', 13, 1, 2, *protocols),
        Field('Homing Offset', 20, 4, 0, -1044479, 1044479),
        Field('Moving Threshold', 24, 4, 10, 0, 1023),
        Field('Temperature Limit', 31, 1, model.temperature_limit, 0, 100),
        Field('Max Voltage Limit', 32, 2, model.voltage_limits[1], low_voltage, high_voltage),
        Field('Min Voltage Limit', 34, 2, model.voltage_limits[0], low_voltage, high_voltage),
        Field('PWM Limit', 36, 2, FULL_PWM, 0, FULL_PWM),
        Field('Velocity Limit', 44, 4, model.velocity_limit, 0, model.max_velocity_limit),
        Field('Max Position Limit', 48, 4, PULSES - 1, 0, PULSES - 1),
        Field('Min Position Limit', 52, 4, 0, 0, PULSES - 1),
        Field('Startup Configuration', 60, 1, 0, 0, 3),
        Field('Shutdown', 63, 1, model.shutdown, 0, 63),
        Field('Torque Enable', 64, 1, 0, 0, 1),
        Field('LED', 65, 1, 0, 0, 1),
        Field('Status Return Level', 68, 1, 2, 0, 2),
        Field('Registered Instruction', 69, 1),
        Field('Hardware Error Status', 70, 1),
        Field('Velocity I Gain', 76, 2, vi, 0, 16383),
        Field('Velocity P Gain', 78, 2, vp, 0, 16383),
        Field('Position D Gain', 80, 2, pd, 0, 16383),
        Field('Position I Gain', 82, 2, pi_, 0, 16383),
        Field('Position P Gain', 84, 2, pp, 0, 16383),
        Field('Feedforward 2nd Gain', 88, 2, 0, 0, 16383),
        Field('Feedforward 1st Gain', 90, 2, 0, 0, 16383),
        Field('Bus Watchdog', 98, 1, 0, 0, 127),
        Field('Goal PWM', 100, 2, FULL_PWM, -FULL_PWM, FULL_PWM),
        Field('Goal Velocity', 104, 4, 0, -model.max_velocity_limit, model.max_velocity_limit),
        Field('Profile Acceleration', 108, 4, 0, 0, 32767),
        Field('Profile Velocity', 112, 4, 0, 0, 32767),
        Field('Goal Position', 116, 4, 0, -MAX_TURNS, MAX_TURNS),
        Field('Realtime Tick', 120, 2),
        Field('Moving', 122, 1),
        Field('Moving Status', 123, 1),
        Field('Present PWM', 124, 2),
        Field('Present Current', 126, 2),  # Present Load of models without
        Field('Present Velocity', 128, 4),
        Field('Present Position', 132, 4),
        Field('Velocity Trajectory', 136, 4),
        Field('Position Trajectory', 140, 4),
        Field('Present Input Voltage', 144, 2),
        Field('Present Temperature', 146, 1),
        Field('Backup Ready', 147, 1),
    ]
    if small:
        fields.append(Field('PWM Slope', 62, 1, 140 if model.number == 1200 else 255, 1, 255))
    if model.current_unit:
        limit = model.current_limit
        fields += [Field('Current Limit', 38, 2, limit, 0, limit),
                   Field('Goal Current', 102, 2, limit, -limit, limit)]
    last = model.indirect[-1][1] + model.indirect[-1][2] - 1
    number = 0
    for address, data, count in model.indirect:
        for i in range(count):
            number += 1
            fields += [Field(f'Indirect Address {number}', address + 2 * i, 2, data + i,
                             EEPROM_END, last),
                       Field(f'Indirect Data {number}', data + i, 1, 0, 0, 255)]
    return {field.name: field for field in sorted(fields, key=lambda field: field.address)}
