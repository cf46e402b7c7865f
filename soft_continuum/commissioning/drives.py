# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Tendon driver settings that calibration corrects: signs, scales, temporary zeros."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any

from soft_continuum.commissioning.calibration import CalibrationError
from soft_continuum.hardware.dynamixel.bus import DynamixelBus
from soft_continuum.hardware.dynamixel.reference import ZeroFile
from soft_continuum.hardware.dynamixel.setup import Spools
from soft_continuum.hardware.dynamixel.start import clear_marks
from soft_continuum.hardware.grbl.link import GrblLink, SOFT_RESET
from soft_continuum.hardware.grbl.setup import find_controller
from soft_continuum.hardware.serial_ports import open_serial
from soft_continuum.user_files import dynamixel_zeros

MAX_STEPS_FACTOR = 10.0
"""Largest error factor of a scale; beyond it the measured value counts as a typing error."""


@dataclass(frozen=True)
class Drive:
    """
    Parameter names of signs and scale in a driver; inverse: a larger scale turns less.

    zeros: name of the positions at zero pull, if they are only set by a parameter.
    """

    signs: str
    scale: str
    inverse: bool
    zeros: str = ''


DRIVES = {'grbl': Drive('grbl.signs', 'grbl.steps_per_mm', inverse=False),
          'dynamixel': Drive('dynamixel.signs', 'dynamixel.spool_radii', inverse=True),
          'ros_topics': Drive('ros_tendons.scales', 'ros_tendons.scales', inverse=True,
                              zeros='ros_tendons.zeros')}


def _mm(length: float) -> str:
    return f'{1e3 * length:.2f} mm'


def corrected_steps(steps_per_mm: float, commanded: float, measured: float) -> float:
    """
    Return the steps/mm with which ``commanded`` (m) would have been the travel ``measured`` (m).

    Raises CalibrationError when the two differ by more than MAX_STEPS_FACTOR.
    """
    low, high = commanded / MAX_STEPS_FACTOR, commanded * MAX_STEPS_FACTOR
    if not (isfinite(measured) and low <= measured <= high):
        raise CalibrationError(
            f'{_mm(measured)} measured for {_mm(commanded)} commanded; allowed: {_mm(low)} to '
            f'{_mm(high)}. Give mm; if the value is right, first correct steps/mm roughly in '
            'controller and configuration')
    return round(steps_per_mm * commanded / measured, 3)  # as many digits as GRBL keeps


def corrected_scale(drive: Drive, scale: float, commanded: float, measured: float) -> float:
    """Return the scale with which ``commanded`` (m) would have been ``measured`` (m)."""
    if drive.inverse:  # the radius of a spool, m
        corrected_steps(1.0, commanded, measured)  # raises for what cannot be
        return float(f'{scale * measured / commanded:.6g}')
    return corrected_steps(scale, commanded, measured)


def clear_zero(values: Mapping[str, Any]) -> None:
    """Clear the temporary zero of the tendon device; nothing moves."""
    if values['tendon_driver'] == 'grbl':
        for port in values['grbl.port'].split():
            clear_reference(port, values['grbl.baud_rate'])
    elif values['tendon_driver'] == 'dynamixel':
        spools, port = Spools.from_parameters(values), values['dynamixel.port']
        bus = DynamixelBus.from_parameters(values)
        try:
            clear_marks(bus, spools.ids, ZeroFile(dynamixel_zeros(), port))
        finally:
            bus.close()


def clear_reference(port: str, baud_rate: int) -> None:
    """
    Clear the temporary zero of a GRBL controller at rest; nothing moves.

    Raises HardwareError when it cannot be reached.
    """
    link = GrblLink(open_serial(port, baud_rate))
    try:
        find_controller(link)
        link.write(SOFT_RESET)
        find_controller(link)
    finally:
        link.close()
