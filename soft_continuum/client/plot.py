# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The present shape of the arm, drawn with matplotlib."""

from collections.abc import Sequence
from typing import Any, TYPE_CHECKING

from matplotlib import pyplot

from soft_continuum.analysis.figures import draw_arm, draw_in_space
from soft_continuum.analysis.obstacle_figures import draw_around, draw_patches, patches
from soft_continuum.client.errors import ClientError
from soft_continuum.client.observed import KINEMATICS_STATE, ObservedArm
from soft_continuum.mechanics.chain import RigidChain
from soft_continuum.mechanics.either import AnyArm, chain_of
from soft_continuum.obstacles import Obstacle
from soft_continuum.ros.conversions import equilibrium_from_ros

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def plot(observed: ObservedArm, arm: AnyArm, axes: 'Axes | None',
         obstacles: Sequence[Obstacle] = ()) -> 'Axes':
    """Draw the shape that kinematics has, and obstacles around it, as Arm.plot."""
    chain, message = chain_of(arm), observed.message(KINEMATICS_STATE)
    state = None if message is None else equilibrium_from_ros(message, chain)
    if state is None:
        raise ClientError('kinematics publishes no shape of the arm that it describes; was it '
                          'started anew?')
    if isinstance(chain, RigidChain):
        axes = pyplot.subplots()[1] if axes is None else axes
        soft = [i for i, stiff in enumerate(observed.snapshot().stiff) if stiff is False]
        draw_arm(axes, chain, state.joint_angles, soft)
        draw_around(axes, obstacles, arm.length)
        axes.set_ylabel('z in mm')
        return axes
    if axes is None:
        axes = pyplot.figure().add_subplot(projection='3d')
    if axes.name != '3d':
        raise ClientError("a spatial arm is drawn into axes with projection='3d', or leave them "
                          'out')
    in_space: Any = axes
    draw_in_space(in_space, state)
    draw_patches(in_space, patches(obstacles, planar=False), planar=False)
    return axes
