# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""How IMUs are mounted: which of their axes point along x, y and z of the disc."""

from collections.abc import Sequence

import numpy as np

from soft_continuum.mechanics.arm import Array
from soft_continuum.parameters.parameter import ParameterError

AXES = {sign + name: float(f'{sign}1') * np.eye(3)[i]
        for i, name in enumerate('xyz') for sign in '+-'}
"""By name; with a sign always, since ROS reads y in a parameter file as true."""


def imu_rotations(axes: Sequence[str], discs: int) -> tuple[Array, ...]:
    """
    Return by disc the rotation (3, 3) from coordinates in its IMU to those in the disc.

    axes: names of those of the IMU along x, y and z of the disc, such as +x, -z, +y; three for all
    discs, or three for each.  Raises ParameterError for what is no such thing.
    """
    if len(axes) not in (3, 3 * discs):
        raise ParameterError(f'parameter imu.axes has {len(axes)} entries; needed: the axes of '
                             f'the IMU along x, y and z of the disc, for all or each of {discs}')
    if unknown := [axis for axis in axes if axis not in AXES]:
        raise ParameterError(
            f'parameter imu.axes has {unknown[0]!r}; allowed: {", ".join(AXES)}')
    found = []
    for i in range(0, len(axes), 3):
        rotation = np.array([AXES[axis] for axis in axes[i:i + 3]])
        if round(float(np.linalg.det(rotation))) != 1:
            raise ParameterError(f'parameter imu.axes has {list(axes[i:i + 3])}: these are not '
                                 'the axes of a right-handed frame, in this order')
        found.append(rotation)
    return tuple(found) if len(found) == discs else tuple(found * discs)
