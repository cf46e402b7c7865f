# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Obstacles from YAML files, and meshes from STL, OBJ and PLY files."""

from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
import re
from typing import Any

import numpy as np

from soft_continuum.extras import needed
from soft_continuum.mechanics._checks import finite
from soft_continuum.parameters.files import read_yaml
from soft_continuum.parameters.parameter import degrees_hint, name_hint, ParameterError
from soft_continuum.planning.obstacles.mesh import Mesh, mesh_of_triangles
from soft_continuum.planning.obstacles.obstacle import Obstacle, Shape, turned_by
from soft_continuum.planning.obstacles.shapes import Box, Capsule, Cylinder, ObstacleError, Sphere
from soft_continuum.text import MAX_NAME, printable, read_bytes

MAX_OBSTACLES = 100
"""Of one arm: each state of a plan is compared with all."""
MAX_MESH_SIZE = 20_000_000  # bytes of a file
MESH_FILES = '.stl', '.obj', '.ply'
DECIMAL_COMMA = re.compile(rb'\s-?\d+,\d')
UNITS = {'m': 1.0, 'mm': 1e-3}
PLACE = 'name', 'shape', 'position', 'rpy'
SIZES = {'sphere': ('radius',), 'box': ('size',), 'cylinder': ('radius', 'length'),
         'capsule': ('radius', 'length'), 'mesh': ('file', 'scale')}
EXAMPLE = '{name: post, shape: cylinder, radius: 0.02, length: 0.3, position: [0.15, 0.0, 0.15]}'


def load_obstacles(path: str | Path) -> tuple[Obstacle, ...]:
    """
    Return the obstacles of a YAML file, in m.

    Raises ObstacleError that names the file and the obstacle if they cannot be read or used.
    """
    try:
        document = read_yaml(path)
        return obstacles_of(document, Path(path).parent)
    except OSError as error:
        raise ObstacleError(f'{path}: cannot be read: {error.strerror}') from None
    except ParameterError as error:
        raise ObstacleError(str(error)) from None
    except ObstacleError as error:
        raise ObstacleError(f'{path}: {error}') from None


def obstacles_of(document: Any, directory: Path) -> tuple[Obstacle, ...]:
    """Return the obstacles of a file's content; directory: base for paths of meshes."""
    if not isinstance(document, Mapping) or not {'obstacles'} <= set(document) <= {
            'obstacles', 'unit'}:
        raise ObstacleError('a file of obstacles has the keys obstacles, a list such as '
                            f'[{EXAMPLE}], and, where that is not in metres, unit: mm')
    unit, given = document.get('unit', 'm'), document['obstacles']
    if unit not in UNITS:
        raise ObstacleError(f'unit is {printable(repr(unit), MAX_NAME)}; allowed: '
                            f'{" or ".join(UNITS)}')
    if not isinstance(given, list) or len(given) > MAX_OBSTACLES:
        raise ObstacleError(f'obstacles must be a list of {MAX_OBSTACLES} at most, such as '
                            f'[{EXAMPLE}]; [] for none')
    found: list[Obstacle] = []
    for number, one in enumerate(given, start=1):
        try:
            found.append(_obstacle(one, UNITS[unit], directory))
        except ObstacleError as error:
            raise ObstacleError(f'obstacle {number}{_name_of(one)}: {error}') from None
        if found[-1].name in (other.name for other in found[:-1]):
            raise ObstacleError(
                f'two obstacles are named {found[-1].name}; give each its own name')
    return tuple(found)


def load_mesh(path: str | Path, scale: Sequence[float] = (1.0, 1.0, 1.0)) -> Mesh:
    """
    Return the mesh of an STL, OBJ or PLY file.

    scale: m over the file's unit along x, y and z.  Files that it refers to are not read.  Raises
    ObstacleError if it cannot be read or used.
    """
    kind = Path(path).suffix.lower()
    if kind not in MESH_FILES:
        raise ObstacleError(f'the mesh {path} ends in {kind or "nothing"!r}; allowed: '
                            f'{", ".join(MESH_FILES)}')
    with needed(ObstacleError):
        import trimesh
    try:
        data = read_bytes(path, MAX_MESH_SIZE)
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise ObstacleError(f'the mesh {path} cannot be read: {why}') from None
    try:
        loaded = trimesh.load_mesh(BytesIO(data), file_type=kind[1:], process=False)
        corners = np.asarray(loaded.vertices, dtype=float)[loaded.faces] * np.asarray(scale)
    except Exception as error:  # whatever a parser raises for a file that is not of its kind
        commas = ('. It has decimal commas: export it with points'
                  if DECIMAL_COMMA.search(data[:4096]) else '')
        raise ObstacleError(f'the mesh {path} is no {kind[1:].upper()} file: '
                            f'{printable(error)}{commas}') from None
    if not len(corners):
        raise ObstacleError(f'the mesh {path} has no triangle; is it a {kind[1:].upper()} file?')
    if not np.all(np.isfinite(corners)):
        raise ObstacleError(f'the mesh {path} has numbers that are not finite; export it again')
    try:
        return mesh_of_triangles(corners)
    except ObstacleError as error:
        raise ObstacleError(f'{path}: {error}') from None


def _obstacle(given: Any, unit: float, directory: Path) -> Obstacle:
    if not isinstance(given, Mapping):
        raise ObstacleError(f'it is {printable(repr(given), MAX_NAME)}; give a mapping, such as '
                            f'{EXAMPLE}')
    kind = given.get('shape')
    if not isinstance(kind, str) or kind not in SIZES:
        raise ObstacleError(f'shape is {printable(repr(kind), MAX_NAME)}; allowed: '
                            f'{", ".join(SIZES)}')
    known = (*PLACE, *SIZES[kind])
    for key in given:
        if key not in known:
            raise ObstacleError(f'unknown key {printable(key, MAX_NAME)}' + (
                name_hint(str(key), known) or f'; a {kind} has {", ".join(known)}'))
    needed = ('name', *(key for key in SIZES[kind] if key != 'scale'))
    if missing := [key for key in needed if key not in given]:
        raise ObstacleError(f'{" and ".join(missing)} is missing; a {kind} has {", ".join(known)}')
    position = _numbers('position', given.get('position', [0.0, 0.0, 0.0]))
    rpy = _numbers('rpy', given.get('rpy', [0.0, 0.0, 0.0]))
    if large := [angle for angle in rpy if abs(angle) > 2.0 * np.pi]:
        raise ObstacleError(
            f'rpy is {list(rpy)}; allowed: up to 2 pi, in rad'
            + degrees_hint(large[0], -2.0 * np.pi, 2.0 * np.pi))
    x, y, z = (unit * part for part in position)
    shape = _shape(kind, given, unit, directory)
    return Obstacle(given['name'], shape, (x, y, z), turned_by(*rpy))


def _shape(kind: str, given: Mapping[str, Any], unit: float, directory: Path) -> Shape:
    if kind == 'mesh':
        file, scale = given['file'], _number('scale', given.get('scale', 1.0))
        if not isinstance(file, str) or not file:
            raise ObstacleError(f'file is {printable(repr(file), MAX_NAME)}; give the path of a '
                                'mesh, from the folder of this file')
        if not 1e-6 <= scale <= 1e6:
            raise ObstacleError(f'scale is {scale:g}; allowed: 1e-6 to 1e6')
        return load_mesh(directory / file, (unit * scale,) * 3)
    if kind == 'box':
        x, y, z = (unit * length for length in _numbers('size', given['size']))
        return Box((x, y, z))
    radius = unit * _number('radius', given['radius'])
    if kind == 'sphere':
        return Sphere(radius)
    length = unit * _number('length', given['length'])
    return Capsule(radius, length) if kind == 'capsule' else Cylinder(radius, length)


def _numbers(name: str, given: Any) -> tuple[float, float, float]:
    """Return three numbers; raise ObstacleError for anything else."""
    if not isinstance(given, list) or len(given) != 3:
        raise ObstacleError(f'{name} is {printable(repr(given), MAX_NAME)}; give three numbers, '
                            'such as [0.1, 0.0, 0.2]')
    x, y, z = (_number(name, part) for part in given)
    return x, y, z


def _number(name: str, given: Any) -> float:
    if not finite(given):
        raise ObstacleError(f'{name} is {printable(repr(given), MAX_NAME)}; give finite numbers')
    return float(given)


def _name_of(given: Any) -> str:
    name = given.get('name') if isinstance(given, Mapping) else None
    return f' ({printable(name, MAX_NAME)})' if isinstance(name, str) else ''
