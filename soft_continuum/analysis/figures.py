# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of the arm."""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, TYPE_CHECKING

import numpy as np

from soft_continuum.mechanics import constant_curvature
from soft_continuum.mechanics.chain import Array, LEFT, RIGHT, RigidChain
from soft_continuum.mechanics.spatial.chain import SpatialEquilibrium

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

DPI = 120
RING = 25  # points of the rim of a disc
SOFT = 'tab:orange'
TENDON_STYLE = {RIGHT: ('right tendon', '-'), LEFT: ('left tendon', '--')}


def draw_arm(axes: 'Axes', chain: RigidChain, joint_angles: Array,
             soft: Collection[int] = ()) -> None:
    """Draw discs, segments (0-based; soft ones in colour) and tendons of one state; axes in mm."""
    points = chain.points(joint_angles) * [1e3, 1e3, 1.0]
    guides = chain.guide_points(joint_angles) * 1e3
    backbone = chain.backbone(joint_angles) * 1e3
    for s in range(chain.segments):
        first = s * chain.joints_per_segment
        body = backbone[first:first + chain.joints_per_segment]
        axes.plot(body[:, 0], body[:, 1], color=SOFT if s in soft else '0.55', linewidth=7,
                  solid_capstyle='butt', label='segment' if s == 0 else None)
    for k in range(chain.segments + 1):
        corners = np.concatenate([guides[0, 2 * k:2 * k + 2], guides[1, 2 * k:2 * k + 2][::-1]])
        axes.fill(corners[:, 0], corners[:, 1], color='0.8', edgecolor='0.3', linewidth=0.8)
    for side, (label, style) in TENDON_STYLE.items():
        axes.plot(guides[side, :, 0], guides[side, :, 1], style, color='0.1', linewidth=1.0,
                  label=label)
    axes.plot(points[:, 0], points[:, 1], 'o', color='black', markersize=3.5,
              label='rigid chain, calculation points')
    axes.set_aspect('equal')
    axes.set_xlabel('x in mm')
    axes.grid(alpha=0.3)


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


def shapes_figure(path: str | Path, chain: RigidChain,
                  shapes: Mapping[str, tuple[Array, Sequence[float]]]) -> None:
    """
    Write a picture of shapes side by side, with constant curvature beside the rigid chain.

    shapes: by name, joint angles (joints,) rad and the bending angles (segments,) rad asked for.
    """
    figure, panels = new_panels(1, len(shapes), 4.4 * len(shapes), 5.2)
    for axes, (name, (joint_angles, bending_angles)) in zip(panels, shapes.items(), strict=True):
        draw_arm(axes, chain, joint_angles)
        arcs = constant_curvature.poses(chain.arm, bending_angles) * 1e3
        axes.plot(arcs[:, 0], arcs[:, 1], 's', markersize=8, markerfacecolor='none',
                  markeredgecolor='0.1', label='constant curvature')
        axes.set_title(name, parse_math=False)
    finish_panels(path, figure, 2 if len(shapes) == 1 else 5)


def draw_in_space(axes: Any, state: SpatialEquilibrium) -> None:
    """
    Draw backbone, discs and tendons of a spatial arm, in mm, into axes (an Axes3D).

    Segments that are soft while others are stiff are in colour.
    """
    backbone = np.vstack([np.zeros(3), state.backbone]) * 1e3
    axes.plot(*backbone.T, color='0.55', linewidth=4, label='rigid chain')
    count = state.chain.joints_per_segment
    for s, stiff in enumerate(state.stiff):
        if not stiff and any(state.stiff):
            soft = backbone[1 + s * count:1 + (s + 1) * count]  # from its lower disc to the upper
            axes.plot(*soft.T, color=SOFT, linewidth=4)
    for tendon, guides in enumerate(state.tendon_points):
        axes.plot(*(guides * 1e3).T, color='0.1', linewidth=0.8,
                  label='' if tendon else 'tendons')
    around = np.linspace(0.0, 2.0 * np.pi, RING)
    rim = np.column_stack([np.cos(around), np.sin(around), np.zeros(RING)])
    for k, place in enumerate(state.points):
        ring = place + state.chain.disc_radii[k // 2] * rim @ state.orientations[k // 2].T
        axes.plot(*(ring * 1e3).T, color='0.3', linewidth=0.8)
    # A cube: a shape that is nearly flat would be drawn in axes as thin as itself.
    middle, half = (backbone.max(axis=0) + backbone.min(axis=0)) / 2, np.ptp(backbone, axis=0) / 2
    for name, centre in zip('xyz', middle, strict=True):
        axes.set(**{f'{name}lim': (centre - half.max(), centre + half.max()),
                    f'{name}label': f'{name} in mm'})
    axes.set_box_aspect((1.0, 1.0, 1.0), zoom=0.88)  # with room for the labels


def spatial_shapes_figure(path: str | Path,
                          shapes: Mapping[str, tuple[SpatialEquilibrium, Array]]) -> None:
    """
    Write a picture of shapes of a spatial arm side by side.

    shapes: by name, the state, and the discs by constant curvature, (2 * discs, 3), m.
    """
    figure = new_figure(4.6 * len(shapes), 5.2)
    for number, (name, (state, arcs)) in enumerate(shapes.items(), start=1):
        axes = figure.add_subplot(1, len(shapes), number, projection='3d')
        draw_in_space(axes, state)
        axes.plot(*(arcs * 1e3).T, 's', markersize=6, markerfacecolor='none',
                  markeredgecolor='tab:orange', label='constant curvature')
        axes.set_title(name, y=0.96, parse_math=False)
    finish_panels(path, figure, 5)
