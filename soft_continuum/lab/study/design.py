# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Variations of a study: a YAML file, read into designs, each a complete description of an arm.

Its keys are::

    description: my_arm.yaml       # beside the file; without it the paper's arm
    vary:                          # parameters of the description
      arm.mounting_angle: [0.0, 3.14159265]                # these values
      arm.segment_masses: {from: [0.05], to: [0.15], steps: 3}
      arm.bending_stiffnesses: {times: [0.5, 1.0, 2.0]}    # factors of the described values
      segments:                    # any other name: several parameters at a time
        - {arm.segment_lengths: [0.105, 0.105], arm.outer_diameters: [0.05, 0.035], ...}
        - {arm.segment_lengths: [0.07, 0.07, 0.07], arm.outer_diameters: [0.05, 0.04, 0.03], ...}
    sample: 50                     # random designs instead of every combination
    obstacles: [null, wall.yaml]   # files beside it, each taken with every design
    shapes: 500                    # random shapes of each design
    queries: 20                    # tips to plan to, of each design
    seed: 1

With ``sample``, ranges are drawn from evenly.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
import hashlib
from itertools import product
from math import prod
from pathlib import Path
import pickle
from typing import Any

import numpy as np

from soft_continuum.mechanics.arm import Arm
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.files import read_yaml
from soft_continuum.parameters.parameter import name_hint, Parameter, ParameterError, Value
from soft_continuum.planning.obstacles import CollisionScene, Obstacle, ObstacleError
from soft_continuum.planning.obstacles.files import load_obstacles
from soft_continuum.ros.description import load_description
from soft_continuum.ros.parameter_table import ALL_PARAMETERS
from soft_continuum.text import printable

KEYS = ('description', 'vary', 'sample', 'obstacles', 'shapes', 'queries', 'seed')
RANGE = ('from', 'to', 'steps')
MAX_DESIGNS, MAX_SHAPES, MAX_QUERIES, MAX_SEED = 100_000, 1_000_000, 10_000, 2**31 - 1
OBSTACLES = 'obstacles'
"""Key of the obstacle file among the variations."""
DEFAULT_SHAPES = 500
PARAMETERS = {p.name: p for p in ALL_PARAMETERS}


@dataclass(frozen=True)
class Design:
    """
    One arm of a study: its number from 0, the varied values, and the whole description.

    For several parameters at a time ``varied`` has the number of the row, from 1.
    """

    number: int
    varied: Mapping[str, Value]
    values: Mapping[str, Value]
    obstacles: tuple[Obstacle, ...] = ()

    @cached_property
    def arm(self) -> Arm:
        """The arm."""
        return arm_from_parameters(self.values)


@dataclass(frozen=True)
class Study:
    """Designs, and the number of random shapes and queries of each."""

    designs: tuple[Design, ...]
    shapes: int
    queries: int
    seed: int

    @property
    def fingerprint(self) -> str:
        """A text that identifies this study."""
        what = [[(sorted(d.values.items()), d.obstacles) for d in self.designs], self.shapes,
                self.queries, self.seed]
        return hashlib.sha256(pickle.dumps(what, protocol=5)).hexdigest()


def read_study(path: str | Path) -> Study:
    """Return the study of a file; raises ParameterError that names file and key."""
    path = Path(path)
    try:
        return _study(path, read_yaml(path))
    except OSError as error:
        raise ParameterError(f'{path}: cannot be read: {error.strerror}') from None


def _study(path: Path, given: Any) -> Study:
    if not isinstance(given, Mapping) or not isinstance(given.get('vary'), Mapping):
        raise ParameterError(f'{path}: a study has the key vary with parameters below it; keys: '
                             + ', '.join(KEYS))
    for key in given:
        if key not in KEYS:
            raise ParameterError(f'{path}: unknown key {printable(str(key))}'
                                 f'{name_hint(str(key), KEYS)}; known: {", ".join(KEYS)}')
    base = given.get('description')
    if base is not None and not isinstance(base, str):
        raise ParameterError(f'{path}: description is {base!r}; the path of a file is needed')
    values = load_description(*([path.parent / base] if base else []))
    seed = _whole(path, given, 'seed', 0, MAX_SEED, 1)
    try:
        varied = {name: _candidates(name, how, values) for name, how in given['vary'].items()}
        choices = (_drawn(varied, _whole(path, given, 'sample', 1, MAX_DESIGNS, 1), seed)
                   if 'sample' in given else _grid(varied))
        obstacle_sets = _obstacle_sets(path.parent, given)
        several = [dict(zip(varied, choice, strict=True)) for choice in choices]
        if len(several) * len(obstacle_sets) > MAX_DESIGNS:
            raise ParameterError(f'{len(several)} designs with each of {len(obstacle_sets)} sets '
                                 f'of obstacles; allowed: {MAX_DESIGNS} in all')
        designs = tuple(_design(n, choice, varied, values, file, obstacle_sets[file])
                        for n, (choice, file) in enumerate(product(several, obstacle_sets)))
    except (ParameterError, ObstacleError) as error:
        raise ParameterError(f'{path}: {error}') from None
    return Study(designs, _whole(path, given, 'shapes', 1, MAX_SHAPES, DEFAULT_SHAPES),
                 _whole(path, given, 'queries', 0, MAX_QUERIES, 0), seed)


def _obstacle_sets(directory: Path, given: Mapping[str, Any]) -> dict[str, tuple[Obstacle, ...]]:
    """Return the sets of obstacles by the names of their files; '' without the key."""
    if OBSTACLES not in given:
        return {'': ()}
    files = given[OBSTACLES]
    if not isinstance(files, list) or not files or not all(
            file is None or isinstance(file, str) for file in files):
        raise ParameterError(f'obstacles is {printable(repr(files))}; allowed: a list of files, '
                             'with null for none')
    return {file or 'none': load_obstacles(directory / file) if file else () for file in files}


def _whole(path: Path, given: Mapping[str, Any], key: str, low: int, high: int, usual: int
           ) -> int:
    value = given.get(key, usual)
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise ParameterError(f'{path}: {key} is {printable(repr(value))}; allowed: a whole number '
                             f'from {low} to {high}')
    return value


def _known(name: Any) -> Parameter:
    if name not in PARAMETERS:
        raise ParameterError(f'vary: unknown parameter {printable(str(name))}'
                             f'{name_hint(str(name), PARAMETERS)}')
    return PARAMETERS[name]


@dataclass(frozen=True, eq=False)
class _Range:
    """Values from one number, or array of numbers, to another."""

    low: Any
    high: Any
    steps: int

    def at(self, part: float) -> Any:
        return ((1.0 - part) * self.low + part * self.high).tolist()


def _candidates(name: Any, how: Any, values: Mapping[str, Value]) -> 'Sequence[Any] | _Range':
    """
    Return the values that a parameter has in the grid, or the range to draw from.

    For other names they are mappings, each of several parameters.
    """
    if isinstance(how, list) and how and all(isinstance(item, Mapping) for item in how):
        for inner in (inner for item in how for inner in item):
            _known(inner)
        return how
    base = values[_known(name).name]
    if not isinstance(how, Mapping) or set(how) != {'times'}:
        return _listed(name, how)
    factors, numbers = _listed(name, how['times']), np.asarray(base)
    if numbers.dtype.kind not in 'if' or not numbers.any():
        raise ParameterError(f'vary: {name} is {base!r} in the description, which no factor '
                             'changes; list the values themselves')
    if isinstance(factors, _Range):
        return _Range(factors.low * numbers, factors.high * numbers, factors.steps)
    for factor in factors:
        if isinstance(factor, bool) or not isinstance(factor, int | float):
            raise ParameterError(f'vary: {name}: times has {factor!r}; numbers are needed')
    return [(factor * numbers).tolist() for factor in factors]


def _listed(name: str, how: Any) -> 'Sequence[Any] | _Range':
    """Return the values of a list, or the range of a mapping."""
    if isinstance(how, list) and how:
        return how
    if not isinstance(how, Mapping):
        raise ParameterError(f'vary: {name} is {printable(repr(how))}; allowed: a list of the '
                             'values to take, {from, to, steps}, or {times: either of these}')
    steps = how.get('steps', 2)
    try:
        low, high = (np.asarray(how.get(key), dtype=float) for key in RANGE[:2])
        fits = low.shape == high.shape and np.isfinite([low, high]).all()
    except (TypeError, ValueError):
        fits = False
    if (not fits or set(how) - set(RANGE) or isinstance(steps, bool)
            or not isinstance(steps, int) or not 2 <= steps <= MAX_DESIGNS):
        raise ParameterError(f'vary: {name} is {printable(repr(dict(how)))}; allowed: from and '
                             'to, numbers or lists of as many numbers, and steps, 2 or more')
    return _Range(low, high, steps)


def _grid(varied: Mapping[str, 'Sequence[Any] | _Range']) -> Iterator[tuple[Any, ...]]:
    columns = [[one.at(part) for part in np.linspace(0.0, 1.0, one.steps)]
               if isinstance(one, _Range) else one for one in varied.values()]
    count = prod(len(column) for column in columns)
    if count > MAX_DESIGNS:
        raise ParameterError(f'{count} combinations; allowed: {MAX_DESIGNS}; vary fewer values, '
                             'or draw some with the key sample')
    return product(*columns)


def _drawn(varied: Mapping[str, 'Sequence[Any] | _Range'], count: int, seed: int
           ) -> Iterator[tuple[Any, ...]]:
    draw = np.random.default_rng(seed)
    for _ in range(count):
        yield tuple(one.at(draw.random()) if isinstance(one, _Range)
                    else one[int(draw.integers(len(one)))] for one in varied.values())


def _design(number: int, chosen: Mapping[str, Any], rows: Mapping[str, Any],
            base: Mapping[str, Value], file: str, obstacles: tuple[Obstacle, ...]) -> Design:
    given: dict[str, Any] = {}
    for name, value in chosen.items():
        given |= value if isinstance(value, Mapping) else {name: value}
    checked = {name: PARAMETERS[name].check(value) for name, value in given.items()}
    varied = {name: rows[name].index(value) + 1 if isinstance(value, Mapping) else checked[name]
              for name, value in chosen.items()}
    if file:
        varied[OBSTACLES] = file
    design = Design(number, varied, {**base, **checked}, obstacles)
    try:  # raises here, before any work is done
        CollisionScene(design.arm, design.obstacles)
    except (ParameterError, ObstacleError) as error:
        raise ParameterError(f'design {number + 1} ({varied_text(varied)}): {error}') from None
    return design


def varied_text(varied: Mapping[str, Value]) -> str:
    """Return the varied values as one line."""
    return ', '.join(f'{name.removeprefix("arm.")} {_short(value)}'
                     for name, value in varied.items())


def _short(value: Value) -> str:
    if isinstance(value, tuple):
        return ' '.join(map(_short, value[:1] if len(set(value)) == 1 else value))
    return f'{value:.4g}' if isinstance(value, float) else str(value)
