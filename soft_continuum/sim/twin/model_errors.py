# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Model errors of the twin against the description of the arm: config/twin.yaml."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, MISSING
from pathlib import Path
from typing import Any

from soft_continuum.parameters.files import read_yaml
from soft_continuum.parameters.parameter import Value

PRESETS = ('ideal', 'typical', 'severe')
"""Those of config/twin.yaml."""
DEFAULT_PRESET = 'typical'


class TwinError(ValueError):
    """A file of model errors, or an arm, cannot be used for a twin."""


def _in(low: float, high: float, default: Any = MISSING) -> Any:
    """Return a field for numbers in a range."""
    return field(default=default, metadata={'range': (low, high)})


@dataclass(frozen=True)
class CylinderObstacle:
    """A smooth rigid cylinder along y: its axis at x, z in base_link, and its radius, m."""

    x: float = _in(-10.0, 10.0)
    z: float = _in(-10.0, 10.0)
    radius: float = _in(0.001, 10.0)


@dataclass(frozen=True)
class ModelErrors:
    """
    One preset; see config/twin.yaml for what each means.

    stiffness_factors: one per segment, or one for all.  mass_factor: of all masses.  stiff_ratio:
    K at full vacuum.  soft_below: part of full vacuum without any jam.  yield_moment: N m of each
    joint's jam at full vacuum.  lock_in_shift: rad by which a segment bends at most when it is
    stiffened.  damping_time: s, of the springs.  guide_friction: coefficient at every guide.
    tendon_compliance: m/N.  slip_tension: N beyond which a tendon slips in its clamp.
    backlash: m between motor and tendon when it turns back.  zero_offset: m by which each tendon
    is pulled in at zero.  obstacles: what the arm can touch.

    Load cells: tension_noise (N, of every value), load_cell_zero (N) and load_cell_scale
    (relative), standard deviations.  IMUs: accelerometer_noise and accelerometer_bias
    (m/s^2), gyro_noise and gyro_bias (rad/s), standard deviations of every value, and of what is
    added to all values of an axis.

    picture_noise: grey values of 255, standard deviation.  picture_blur: px, standard deviation.
    shade: 0 to 1, how dark a corner is.  occluders: number of dark bars that move through the
    picture.  lens_distortion: k1.  calibration_error: of focal length and distortion, relative,
    standard deviation.  camera_shift, camera_tilt: m and rad, largest misalignment of the camera.
    tag_offset: m, standard deviation of the positions of disc tags; divided by their size, rad, of
    their rotations.  fixed_offset, depth_offset: m, standard deviations of the positions of the
    fixed tags, and of the depth.  seed: of everything random.

    Of spatial arms, and they may be left out: lateral_stiffness_factor, of bending about x
    besides; angle_error, rad, standard deviation of the angles of the tendons.
    """

    obstacles: tuple[CylinderObstacle, ...]
    stiffness_factors: tuple[float, ...] = _in(0.2, 5.0)
    mass_factor: float = _in(0.0, 5.0)
    stiff_ratio: float = _in(1.1, 1e5)
    soft_below: float = _in(0.0, 0.9)
    yield_moment: float = _in(1e-6, 1e6)
    lock_in_shift: float = _in(0.0, 0.2)
    damping_time: float = _in(0.005, 1.0)
    guide_friction: float = _in(0.0, 1.0)
    tendon_compliance: float = _in(0.0, 0.01)
    slip_tension: float = _in(0.1, 1e6)
    backlash: float = _in(0.0, 0.01)
    zero_offset: float = _in(-0.01, 0.01)
    tension_noise: float = _in(0.0, 100.0)
    load_cell_zero: float = _in(0.0, 100.0)
    load_cell_scale: float = _in(0.0, 0.5)
    accelerometer_noise: float = _in(0.0, 10.0)
    accelerometer_bias: float = _in(0.0, 10.0)
    gyro_noise: float = _in(0.0, 10.0)
    gyro_bias: float = _in(0.0, 10.0)
    picture_noise: float = _in(0.0, 100.0)
    picture_blur: float = _in(0.0, 20.0)
    shade: float = _in(0.0, 1.0)
    occluders: int = _in(0, 20)
    lens_distortion: float = _in(-0.25, 0.25)
    calibration_error: float = _in(0.0, 0.2)
    camera_shift: float = _in(0.0, 1.0)
    camera_tilt: float = _in(0.0, 0.5)
    tag_offset: float = _in(0.0, 0.01)
    fixed_offset: float = _in(0.0, 0.05)
    depth_offset: float = _in(0.0, 0.05)
    seed: int = _in(0, 2**31)
    lateral_stiffness_factor: float = _in(0.2, 5.0, 1.0)
    angle_error: float = _in(0.0, 0.5, 0.0)


def load_cell_parameters(tendons: int) -> dict[str, Value]:
    """Return the parameters of nodes that use the load cells of the twin."""
    return {'load_cells.enabled': True, 'load_cells.zeros': (0.0,) * tendons,
            'load_cells.scales': (1.0,) * tendons}


RANGES = {one.name: one.metadata['range'] for one in fields(ModelErrors) if one.metadata}
"""Smallest and largest value of each number."""
MAX_OBSTACLES = 100


def read_model_errors(path: str | Path, preset: str) -> ModelErrors:
    """
    Return a preset of a file.

    Raises OSError for a file that cannot be read, ParameterError for one that is not YAML,
    TwinError for other contents.
    """
    presets = read_yaml(path)
    if not isinstance(presets, dict):
        raise TwinError(f'{path}: it must be a mapping from names to presets')
    if preset not in presets:
        raise TwinError(f'{path} has no preset {preset}; it has: {", ".join(map(str, presets))}')
    values = presets[preset]
    names = {field.name: field.default is MISSING for field in fields(ModelErrors)}
    needed = {name for name, is_needed in names.items() if is_needed}
    if not isinstance(values, dict) or not needed <= set(values) <= set(names):
        raise TwinError(f'{path}: preset {preset} must hold these and nothing else: '
                        f'{", ".join(names)}')
    return ModelErrors(**{name: _checked(path, name, values) for name in values})


def _checked(path: str | Path, name: str, values: Mapping[str, Any]) -> Any:
    """Return a value within its range."""
    value = values[name]
    if name == 'obstacles':
        return _obstacles(path, value)
    several = name == 'stiffness_factors' and isinstance(value, list) and value
    for one in value if several else [value]:
        _check(path, name, one, RANGES[name])
    return tuple(value if several else [value]) if name == 'stiffness_factors' else value


def _obstacles(path: str | Path, value: Any) -> tuple[CylinderObstacle, ...]:
    """Return the obstacles of a list of mappings."""
    if not isinstance(value, list) or len(value) > MAX_OBSTACLES or not all(
            isinstance(one, dict) and set(one) == {part.name for part in fields(CylinderObstacle)}
            for one in value):
        raise TwinError(f'{path}: obstacles must be a list, in m, of {MAX_OBSTACLES} at most, '
                        'such as [{x: 0.08, z: 0.2, radius: 0.02}]; [] for none')
    for number, one in enumerate(value, start=1):
        for part in fields(CylinderObstacle):
            _check(path, f'{part.name} of obstacle {number}', one[part.name],
                   part.metadata['range'])
    return tuple(CylinderObstacle(**one) for one in value)


def _check(path: str | Path, name: str, value: Any, allowed: tuple[float, float]) -> None:
    """Raise TwinError for what is no number in a range; a whole one if that begins with one."""
    low, high = allowed
    if isinstance(value, bool) or not isinstance(value, int | float) or not (
            low <= value <= high) or (isinstance(low, int) and not isinstance(value, int)):
        raise TwinError(f'{path}: {name} is {value!r}; allowed: {low:g} to {high:g}')
