# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of the arm."""

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, TYPE_CHECKING

import numpy as np

from soft_continuum.mechanics import constant_curvature
from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.chain import Equilibrium
from soft_continuum.mechanics.orientations import matrices

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

DPI = 120
RING = 25  # points of the rim of a disc
SOFT = 'tab:orange'
DASHES = ('-', '--')  # of tendons as seen along y
IN_SPACE = '3d'


def projection_of(arm: Arm) -> str | None:
    """Return the projection of axes for an arm, as matplotlib names it: with y, or along it."""
    return IN_SPACE if 'y' in arm.axes else None


def draw_arm(axes: Any, state: Equilibrium, soft: Collection[int] | None = None) -> None:
    """
    Draw discs, segments and tendons of a state into axes in mm, along y or of IN_SPACE.

    soft: segments (0-based) in colour; by default those that are soft while others are stiff.
    """
    if soft is None:
        soft = [s for s, stiff in enumerate(state.stiff) if not stiff and any(state.stiff)]
    (_draw_3d if axes.name == IN_SPACE else _draw_along_y)(axes, state, soft)


def _draw_along_y(axes: 'Axes', state: Equilibrium, soft: Collection[int]) -> None:
    chain, points, backbone = state.chain, 1e3 * state.poses, 1e3 * state.backbone
    guides = [1e3 * tendon for tendon in state.tendon_points]
    for s in range(chain.segments):
        first = s * chain.joints_per_segment
        body = backbone[first:first + chain.joints_per_segment]
        axes.plot(body[:, 0], body[:, 2], color=SOFT if s in soft else '0.55', linewidth=7,
                  solid_capstyle='butt', label='segment' if s == 0 else None)
    for k in range(chain.segments + 1):
        corners = np.concatenate([guides[0][2 * k:2 * k + 2], guides[1][2 * k:2 * k + 2][::-1]])
        axes.fill(corners[:, 0], corners[:, 2], color='0.8', edgecolor='0.3', linewidth=0.8)
    for name, tendon, dash in zip(chain.arm.tendon_names, guides, DASHES, strict=False):
        axes.plot(tendon[:, 0], tendon[:, 2], dash, color='0.1', linewidth=1.0,
                  label=name.replace('_', ' '))
    axes.plot(points[:, 0], points[:, 2], 'o', color='black', markersize=3.5,
              label='rigid chain, calculation points')
    axes.set_aspect('equal')
    axes.set_xlabel('x in mm')
    axes.grid(alpha=0.3)


def _draw_3d(axes: Any, state: Equilibrium, soft: Collection[int]) -> None:
    backbone = np.vstack([np.zeros(3), state.backbone]) * 1e3
    axes.plot(*backbone.T, color='0.55', linewidth=4, label='rigid chain')
    count = state.chain.joints_per_segment
    for s in soft:  # from its lower disc to the upper
        axes.plot(*backbone[1 + s * count:1 + (s + 1) * count].T, color=SOFT, linewidth=4)
    for tendon, guides in enumerate(state.tendon_points):
        axes.plot(*(guides * 1e3).T, color='0.1', linewidth=0.8,
                  label='' if tendon else 'tendons')
    for k, pose in enumerate(state.poses):
        axes.plot(*(1e3 * rim(pose, state.chain.disc_radii[k // 2], RING)).T, color='0.3',
                  linewidth=0.8)
    # A cube: a shape that is nearly flat would be drawn in axes as thin as itself.
    middle, half = (backbone.max(axis=0) + backbone.min(axis=0)) / 2, np.ptp(backbone, axis=0) / 2
    for name, centre in zip('xyz', middle, strict=True):
        axes.set(**{f'{name}lim': (centre - half.max(), centre + half.max()),
                    f'{name}label': f'{name} in mm'})
    axes.set_box_aspect((1.0, 1.0, 1.0), zoom=0.88)  # with room for the labels


def rim(pose: Array, radius: float, count: int) -> Array:
    """Return the edge of a disc, (count, 3), m; pose (7,), radius in m."""
    around = np.linspace(0.0, 2.0 * np.pi, count)
    edge: Array = pose[:3] + radius * np.column_stack(
        [np.cos(around), np.sin(around), np.zeros(count)]) @ matrices(pose[None, 3:])[0].T
    return edge


def new_figure(width: float, height: float) -> 'Figure':
    """Return an empty figure (inches); the first one loads matplotlib, which takes 0.5 s."""
    from matplotlib.figure import Figure
    return Figure(figsize=(width, height), layout='constrained')


def new_panels(rows: int, columns: int, width: float, height: float,
               part: 'SubFigure | None' = None) -> 'tuple[Figure, list[Axes]]':
    """
    Return a figure (inches) and its panels of equal scale, row by row; axes in mm.

    part: of a figure, to draw them there and not in a new one.
    """
    figure = new_figure(width, height)
    panels = (part or figure).subplots(
        rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
    for axes in panels:
        axes.set_aspect('equal')
        axes.set_xlabel('x in mm')
        axes.grid(alpha=0.3)
    for axes in panels[::columns]:
        axes.set_ylabel('z in mm')
    return figure, list(panels)


def finish_panels(path: str | Path, figure: 'Figure', legend_columns: int) -> None:
    """Write a figure with one legend, that of its first panel, below all of them."""
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc='outside lower center', frameon=False,
                  ncols=min(len(labels), legend_columns))
    figure.savefig(path, dpi=DPI)


def shapes_figure(path: str | Path, shapes: Mapping[str, tuple[Equilibrium, Array]]) -> None:
    """
    Write a picture of shapes side by side, with constant curvature beside the rigid chain.

    shapes: by name, the state, and the bending (segments, 2), rad, that was asked for.
    """
    arm, count = next(iter(shapes.values()))[0].chain.arm, len(shapes)
    projection, panels = projection_of(arm), list[Any]()
    if projection is None:
        figure, panels = new_panels(1, count, 4.4 * count, 5.2)
        square: dict[str, Any] = {'markersize': 8, 'markeredgecolor': '0.1'}
    else:
        figure = new_figure(4.6 * count, 5.2)
        panels = [figure.add_subplot(1, count, number, projection=projection)
                  for number in range(1, count + 1)]
        square = {'markersize': 6, 'markeredgecolor': SOFT}
    for axes, (name, (state, bending)) in zip(panels, shapes.items(), strict=True):
        draw_arm(axes, state)
        arcs = 1e3 * constant_curvature.poses(arm, bending)[0][:, arm.pose_axes[:3]]
        axes.plot(*arcs.T, 's', markerfacecolor='none', label='constant curvature', **square)
        axes.set_title(name, y=None if projection is None else 0.96, parse_math=False)
    finish_panels(path, figure, 2 if count == 1 and projection is None else 5)
