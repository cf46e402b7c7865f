# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The present shape of the arm, drawn with matplotlib."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from matplotlib import pyplot

from soft_continuum.client.errors import ClientError
from soft_continuum.client.observed import KINEMATICS_STATE, ObservedArm
from soft_continuum.mechanics.arm import Arm
from soft_continuum.mechanics.chain import Chain
from soft_continuum.mechanics.drawing import draw_arm, projection_of
from soft_continuum.planning.obstacles import Obstacle
from soft_continuum.planning.obstacles.drawing import draw_obstacles
from soft_continuum.ros.conversions import equilibrium_from_ros

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def plot(observed: ObservedArm, arm: Arm, axes: 'Axes | None',
         obstacles: Sequence[Obstacle] = ()) -> 'Axes':
    """Draw the shape from kinematics, and the obstacles; see Arm.plot."""
    chain, message = Chain(arm), observed.message(KINEMATICS_STATE)
    state = None if message is None else equilibrium_from_ros(message, chain)
    if state is None:
        raise ClientError('kinematics publishes no shape of the arm that it describes; was it '
                          'restarted?')
    projection = projection_of(arm)
    if axes is None:
        axes = pyplot.figure().add_subplot(projection=projection)
    if projection and axes.name != projection:
        raise ClientError(f'a spatial arm needs axes with projection={projection!r}, or leave '
                          'them out')
    draw_arm(axes, state)
    draw_obstacles(axes, obstacles, arm.length)
    if not projection:
        axes.set_ylabel('z in mm')
    return axes
