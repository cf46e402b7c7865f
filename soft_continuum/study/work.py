# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The work of a study in units, each of which any process computes alike."""

from dataclasses import dataclass
from time import perf_counter
from typing import Any

from soft_continuum.study.design import Design, Study

SHAPES, QUERIES = 'shapes', 'queries'
"""Kinds of work."""
UNIT_TIME = 0.5
"""How long the shapes of one unit take, roughly, s; in space more where many fall."""


@dataclass(frozen=True)
class Unit:
    """Some shapes, or one query, of a design, by number."""

    kind: str
    design: int
    first: int
    count: int

    @property
    def name(self) -> str:
        """Its name, in the order of design and number."""
        return f'{self.kind}-{self.design:06d}-{self.first:08d}'


def units(study: Study) -> list[Unit]:
    """Return the work of a study, in order."""
    found = []
    for design in study.designs:
        size = round(UNIT_TIME / design.arm.bend_time)
        found += [Unit(SHAPES, design.number, first, min(size, study.shapes - first))
                  for first in range(0, study.shapes, size)]
        found += [Unit(QUERIES, design.number, number, 1) for number in range(study.queries)]
    return found


def compute(design: Design, unit: Unit, seed: int) -> tuple[dict[str, list[Any]], float]:
    """Return the rows of a unit as columns, and how long that took (s)."""
    began = perf_counter()
    if unit.kind == SHAPES:  # here, so that who only counts units loads no mechanics
        from soft_continuum.study.sampling import shapes
        rows = shapes(design, unit.first, unit.count, seed)
    else:
        from soft_continuum.study.queries import query
        rows = [query(design, unit.first, seed)]
    return {name: [row[name] for row in rows] for name in rows[0]}, perf_counter() - began
