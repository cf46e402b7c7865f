# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Shared by the procedures of ``calibrate``: options, parameters corrected so far, results."""

import argparse
from dataclasses import dataclass, field
from typing import Any

from soft_continuum.commissioning.calibration import CalibrationError
from soft_continuum.hardware.commissioning import Drive
from soft_continuum.hardware.drivers import commissioning, TENDON_DRIVERS
from soft_continuum.hardware.grbl.commissioning import DRIVE
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.scalars import as_yaml

MM = 1e3  # per m
PER_TENDON = 'measured', 'seen', 'take_up'
"""Options with a value for each tendon."""


@dataclass
class Job:
    """
    The options, the parameters corrected so far, the results and the failures.

    names: of the tendons, as they are typed.  family: the module COMMISSIONING of the tendon
    driver, or None.
    """

    options: argparse.Namespace
    values: dict[str, Any]
    results: dict[str, tuple[float, ...] | float] = field(default_factory=dict)
    failures: list[str] = field(default_factory=list)
    names: tuple[str, ...] = field(init=False)
    family: Any = field(init=False)

    def __post_init__(self) -> None:
        """Find these; raises CalibrationError if an option lacks a value, and HardwareError."""
        self.family = commissioning(TENDON_DRIVERS, self.values['tendon_driver'])
        tendons = arm_from_parameters(self.values).tendon_names
        self.names = tuple(name.removesuffix('_tendon') for name in tendons)
        for option in PER_TENDON:
            given = getattr(self.options, option)
            if given is not None and len(given) != len(self.names):
                raise CalibrationError(
                    f'--{option.replace("_", "-")} has {len(given)} values; needed: one for each '
                    f'of {", ".join(self.names)}')

    @property
    def jamming(self) -> bool:
        """Whether the arm has segments that can be stiffened."""
        return bool(self.values['arm.jamming'])

    def per_tendon(self, name: str) -> tuple[float, ...]:
        """Return a parameter with a value for each tendon; raises CalibrationError."""
        values: tuple[float, ...] = self.values[name]
        if len(values) == 1 and self.drive.shared:
            return values * len(self.names)
        if len(values) != len(self.names):
            raise CalibrationError(f'parameter {name} is {as_yaml(values)}; needed: one value for '
                                   f'each of {", ".join(self.names)}; begin with estimates')
        return values

    @property
    def own_drive(self) -> Drive | None:
        """The parameters of the tendon driver; None where it has none to correct."""
        return getattr(self.family, 'DRIVE', None)

    @property
    def drive(self) -> Drive:
        """The parameters of the tendon driver; those of grbl where it has none."""
        return self.own_drive or DRIVE

    def one(self, tendon: int, distance: float) -> tuple[float, ...]:
        """Return the distances (m) of all tendons that move only one, by ``distance`` in mm."""
        return tuple(distance / MM if i == tendon else 0.0 for i in range(len(self.names)))
