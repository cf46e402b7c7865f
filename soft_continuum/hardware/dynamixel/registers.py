# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The registers of Dynamixel X servos that the driver uses, and the supported models.

Source: the control tables and specifications of the ROBOTIS e-Manual
(https://emanual.robotis.com/docs/en/dxl/x/, one page per model) and the model files of
github.com/ROBOTIS-GIT/dynamixel_hardware_interface.  All models below have these registers at
these addresses.
"""

from dataclasses import dataclass
from math import pi

PULSES_PER_TURN = 4096
MAX_POSITION = 1_048_575
"""Largest goal position to either side in mode 5, pulses: 256 turns."""
RADIANS_PER_PULSE = 2.0 * pi / PULSES_PER_TURN
VELOCITY_UNIT = 0.229 * 2.0 * pi / 60.0  # rad/s
CURRENT_BASED_POSITION = 5
P_GAIN_UNIT, FULL_PWM = 1.0 / 128.0, 885
"""Unit of Position P Gain, PWM steps per pulse of position error; PWM at full voltage."""
WATCHDOG_UNIT = 0.02  # s
WATCHDOG_TRIGGERED = 255
"""Bus Watchdog reads as -1 after it stopped the servo; goals are then refused until it is 0."""
DISABLED_ID = 253
"""Smallest value of Secondary ID that disables it."""


@dataclass(frozen=True)
class Register:
    """A value in the control table; size: bytes, little-endian."""

    address: int
    size: int
    name: str
    signed: bool = False

    @property
    def end(self) -> int:
        """Address after its last byte."""
        return self.address + self.size

    def encode(self, value: int) -> bytes:
        """Return the bytes of a value."""
        return value.to_bytes(self.size, 'little', signed=self.signed)

    def decode(self, data: bytes, start: int = -1) -> int:
        """Return the value in ``data``, which begins at the address ``start``: here if -1."""
        at = 0 if start < 0 else self.address - start
        return int.from_bytes(data[at:at + self.size], 'little', signed=self.signed)

    def __str__(self) -> str:
        """Name it as the e-Manual does."""
        return f'{self.name} ({self.address})'


FIRMWARE = Register(6, 1, 'Firmware Version')
BAUD_RATE = Register(8, 1, 'Baud Rate')
RETURN_DELAY = Register(9, 1, 'Return Delay Time')
DRIVE_MODE = Register(10, 1, 'Drive Mode')
OPERATING_MODE = Register(11, 1, 'Operating Mode')
SECONDARY_ID = Register(12, 1, 'Secondary ID')
HOMING_OFFSET = Register(20, 4, 'Homing Offset', signed=True)
PWM_LIMIT = Register(36, 2, 'PWM Limit')
CURRENT_LIMIT = Register(38, 2, 'Current Limit')
VELOCITY_LIMIT = Register(44, 4, 'Velocity Limit')
STARTUP = Register(60, 1, 'Startup Configuration')
SHUTDOWN = Register(63, 1, 'Shutdown')
TORQUE_ENABLE = Register(64, 1, 'Torque Enable')
STATUS_RETURN_LEVEL = Register(68, 1, 'Status Return Level')
HARDWARE_ERROR = Register(70, 1, 'Hardware Error Status')
POSITION_P_GAIN = Register(84, 2, 'Position P Gain')
BUS_WATCHDOG = Register(98, 1, 'Bus Watchdog')
GOAL_PWM = Register(100, 2, 'Goal PWM', signed=True)
GOAL_CURRENT = Register(102, 2, 'Goal Current', signed=True)
PROFILE_ACCELERATION = Register(108, 4, 'Profile Acceleration')
PROFILE_VELOCITY = Register(112, 4, 'Profile Velocity')
GOAL_POSITION = Register(116, 4, 'Goal Position', signed=True)
REALTIME_TICK = Register(120, 2, 'Realtime Tick')
PRESENT_CURRENT = Register(126, 2, 'Present Current', signed=True)
PRESENT_POSITION = Register(132, 4, 'Present Position', signed=True)
POSITION_TRAJECTORY = Register(140, 4, 'Position Trajectory', signed=True)
INPUT_VOLTAGE = Register(144, 2, 'Present Input Voltage')
TEMPERATURE = Register(146, 1, 'Present Temperature')
SPARE = Register(224, 4, 'Indirect Data')
"""
Four bytes of RAM without a function of their own, 0 after the servo was switched on or rebooted:
Indirect Data 1 to 4, in the XL330 and XC330 Indirect Data 17 to 20, as long as the Indirect
Addresses that belong to them are not changed.
"""
TICK_RANGE = 32768  # ms after which the Realtime Tick wraps around


@dataclass(frozen=True)
class ServoModel:
    """
    Data sheet values of a model with a current sensor.

    current_unit: A of one count of current.  stall_torque: N m, with which current: A, at the
    recommended voltage.  no_load_speed: rad/s there.
    """

    name: str
    current_unit: float
    stall_torque: float
    stall_current: float
    no_load_speed: float

    @property
    def torque_constant(self) -> float:
        """Torque of the horn over current, N m/A: at stall, so the losses of the gear are in."""
        return self.stall_torque / self.stall_current


def _model(name: str, milliamperes: float, torque: float, current: float, rpm: float
           ) -> ServoModel:
    return ServoModel(name, 1e-3 * milliamperes, torque, current, rpm * 2.0 * pi / 60.0)


MODELS = {
    1190: _model('XL330-M077', 1.0, 0.215, 1.47, 383.0),
    1200: _model('XL330-M288', 1.0, 0.52, 1.47, 103.0),
    1210: _model('XC330-T181', 1.0, 0.76, 0.80, 104.0),
    1220: _model('XC330-T288', 1.0, 0.92, 0.80, 65.0),
    1230: _model('XC330-M181', 1.0, 0.60, 1.80, 129.0),
    1240: _model('XC330-M288', 1.0, 0.93, 1.80, 81.0),
    1000: _model('XH430-W350', 2.69, 3.4, 1.3, 30.0),
    1010: _model('XH430-W210', 2.69, 2.5, 1.3, 50.0),
    1020: _model('XM430-W350', 2.69, 4.1, 2.3, 46.0),
    1030: _model('XM430-W210', 2.69, 3.0, 2.3, 77.0),
    1100: _model('XH540-W270', 2.69, 9.9, 4.9, 39.0),
    1110: _model('XH540-W150', 2.69, 7.1, 4.9, 70.0),
    1120: _model('XM540-W270', 2.69, 10.6, 4.4, 30.0),
    1130: _model('XM540-W150', 2.69, 7.3, 4.4, 53.0),
    1170: _model('XW540-T260', 2.69, 9.5, 4.9, 40.0),
    1180: _model('XW540-T140', 2.69, 6.9, 4.9, 72.0),
}
"""By model number."""
WITHOUT_CURRENT = {
    350: 'XL320', 1060: 'XL430-W250', 1070: 'XC430-W150', 1080: 'XC430-W240',
    1090: '2XL430-W250', 1160: '2XC430-W250'}
"""Models that cannot measure or limit their current."""

HARDWARE_ERRORS = {
    0x01: ('input voltage', 'the supply was outside Min/Max Voltage Limit: check it under load'),
    0x04: ('overheating', 'let it cool down; it holds too much tension for too long'),
    0x08: ('motor encoder', 'its encoder failed: have the servo repaired'),
    0x10: ('electrical shock', 'check its wiring, and that the supply gives enough current'),
    0x20: ('overload', 'find what blocks the tendon; lower dynamixel.tension_limits if it only '
                       'held a load'),
}
"""By bit of Hardware Error Status: the error and its remedy."""


def explain_hardware_error(status: int) -> str:
    """Return the bits of Hardware Error Status as text, with remedies."""
    known = [f'{name} ({remedy})' for bit, (name, remedy) in HARDWARE_ERRORS.items()
             if status & bit]
    return ', '.join(known) or f'an unknown error (status {status})'
