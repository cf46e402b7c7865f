# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A first look at a described arm: straight, and bent by the statics."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from soft_continuum.analysis.figures import draw_arm, finish_panels, new_panels, rim
from soft_continuum.mechanics.arm import Arm
from soft_continuum.mechanics.chain import Equilibrium
from soft_continuum.mechanics.directions import bending_vectors
from soft_continuum.mechanics.statics import Statics

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LABELS = 1.45  # times the distance of a tendon from the backbone: where its name is


def bent(arm: Arm, bending_angles: Sequence[float], directions: Sequence[float],
         jamming: bool) -> Equilibrium:
    """
    Return the arm in a shape, by the statics.

    bending_angles, directions: (segments,) rad; no directions: all 0.  jamming: whether segments
    are set one after the other, or all at once.  Raises StaticsError where no tendons hold it.
    """
    from soft_continuum.mechanics.inverse import set_shape
    state: Equilibrium = set_shape(Statics(arm), bending_vectors(arm, bending_angles, directions),
                             jamming=jamming)
    return state


def preview_figure(path: str | Path, states: Sequence[tuple[str, Equilibrium]]) -> None:
    """Write states by their titles as seen from the side, and the tendons at the base; in mm."""
    figure, panels = new_panels(1, len(states) + 1, 3.6 * (len(states) + 1), 5.0)
    for axes, (title, state) in zip(panels, states, strict=False):
        draw_arm(axes, state, ())
        axes.set_title(title)
    figure.delaxes(panels[-1])  # the tendons have a scale of their own
    _draw_tendons(figure.add_subplot(1, len(panels), len(panels)), states[0][1])
    finish_panels(path, figure, 4)


def _draw_tendons(axes: 'Axes', state: Equilibrium) -> None:
    """Draw where the tendons pass the base, as seen from the tip."""
    edge = 1e3 * rim(state.poses[0], state.chain.disc_radii[0])
    axes.plot(edge[:, 0], edge[:, 1], color='0.6', linewidth=1.2)
    for name, guides in zip(state.chain.arm.tendon_names, state.tendon_points, strict=True):
        x, y = 1e3 * guides[0, :2]
        axes.plot(x, y, 'o', color='0.0', markersize=4)
        axes.annotate(name, (x, y), (LABELS * x, LABELS * y), ha='center', va='center',
                      fontsize=7, parse_math=False)
    axes.set_aspect('equal')
    axes.margins(0.35)
    axes.set_title('tendons at the base, from the tip')
    axes.set_xlabel('x in mm')
    axes.set_ylabel('y in mm')
    axes.grid(alpha=0.3)
