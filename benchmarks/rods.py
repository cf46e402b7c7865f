# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Rods under wrenches and gravity that SoRoSim solved, as spatial arms without tendons."""

from collections.abc import Iterator
import csv
from dataclasses import dataclass
from math import pi
from pathlib import Path

import numpy as np

from soft_continuum.mechanics.arm import Arm, Array, Disc, SECOND_ORDER, Segment, Wrench
from soft_continuum.mechanics.chain import Equilibrium

DATA = Path(__file__).parents[1] / 'data' / 'sorosim'
AXES = [1, 2, 0]  # x of the file is along the rod, as z is here
ROWS = 6  # of one shape


@dataclass(frozen=True)
class Rod:
    """A round rod: length and radius in m, E in Pa, Poisson's ratio, density in kg/m^3."""

    name: str
    length: float
    radius: float
    elasticity: float
    poisson: float
    density: float

    def segment(self) -> Segment:
        """Return half of it."""
        area = pi * self.radius**2
        bending = self.elasticity * area * self.radius**2 / 4.0
        return Segment(
            self.length / 2.0, bending, bending, bending / (1.0 + self.poisson),
            self.density * area * self.length / 2.0)


STEEL = Rod('SpringSteelRod', 0.6, 0.0008, 200e9, 0.33, 7870.0)
TPU = Rod('TPURod', 0.4, 0.005, 70e6, 0.4, 1200.0)


@dataclass(frozen=True)
class Shape:
    """gravity (3,) m/s^2, wrenches in the middle and at the tip, stations (14, 3) m at arc, m."""

    gravity: Array
    wrenches: tuple[Wrench, Wrench]
    stations: Array
    arc: Array

    def arm(self, rod: Rod, bodies: int) -> Arm:
        """Return the rod of so many bodies under this load."""
        gravity = tuple(self.gravity.tolist())
        return Arm((rod.segment(),) * 2, (Disc(),) * 3, (), bodies // 2, 0,
                          SECOND_ORDER, wrenches=self.wrenches, gravity=gravity)

    def errors(self, state: Equilibrium) -> Array:
        """Return how far each station is off, (14,), m; bodies are straight."""
        chain, ends = state.chain, state.chain.ends(state.rotations)
        along = np.concatenate([[0.0], np.cumsum(chain.body_lengths)])
        there = np.column_stack([np.interp(self.arc, along, ends[:, i]) for i in range(3)])
        errors: Array = np.linalg.norm(there - self.stations, axis=1)
        return errors


def shapes(rod: Rod) -> Iterator[Shape]:
    """Read the shapes of a rod."""
    with open(DATA / f'{rod.name}MuJoCo_dataStatics.csv', newline='', encoding='ascii') as file:
        rows = list(csv.reader(file))[1:]
    parts = np.array(rows[0][4:], dtype=float)
    half = len(parts) // 2
    arc = np.concatenate([parts[:half], 1.0 + parts[half:]]) * rod.length / 2.0
    for begin in range(1, len(rows), ROWS):
        values = np.array([row[1:] for row in rows[begin:begin + ROWS]], dtype=float)
        turn, place = values[:3][AXES], values[3:][AXES]
        middle, tip = (Wrench(disc, tuple(place[:, disc].tolist()), tuple(turn[:, disc].tolist()))
                       for disc in (1, 2))
        yield Shape(place[:, 0], (middle, tip), place[:, 3:].T, arc)
