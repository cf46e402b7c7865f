# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of the arm, of obstacles around it, and of an arm that was just described."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TYPE_CHECKING

import numpy as np
import scipy

from soft_continuum.colours import OBSTACLE
from soft_continuum.mechanics import constant_curvature
from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.chain import Equilibrium
from soft_continuum.mechanics.directions import bending_vectors
from soft_continuum.mechanics.orientations import matrices
from soft_continuum.mechanics.statics import Statics
from soft_continuum.obstacles import Box, Capsule, Mesh, Obstacle, Sphere

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

DPI = 120
RING = 41  # points of the rim of a disc
SOFT = 'tab:orange'
DASHES = ('-', '--')  # of two tendons
IN_SPACE = '3d'
ROUND = 24  # corners of a circle
OBSTACLE_COLOUR = tuple(channel / 255 for channel in OBSTACLE)
FLAT_OPACITY, OPACITY = 0.5, 0.2
LABELS = 1.45  # times the distance of a tendon from the backbone: where its name is


def projection_of(arm: Arm) -> str | None:
    """Return the projection of axes for an arm, as matplotlib names it: with y, or along it."""
    return IN_SPACE if 'y' in arm.axes else None


def draw_arm(axes: Any, state: Equilibrium, soft: Collection[int] | None = None) -> None:
    """
    Draw discs, segments, tendons and calculation points of a state in mm.

    axes: of IN_SPACE; into others it is drawn as seen along y.  soft: segments (0-based) in
    colour; by default those that are soft while others are stiff.
    """
    if soft is None:
        soft = [s for s, stiff in enumerate(state.stiff) if not stiff and any(state.stiff)]
    flat = axes.name != IN_SPACE
    seen = [0, 2] if flat else [0, 1, 2]
    chain, backbone = state.chain, 1e3 * state.backbone[:, seen]
    for s in range(chain.segments):
        first = s * chain.joints_per_segment
        axes.plot(*backbone[first:first + chain.joints_per_segment].T,
                  color=SOFT if s in soft else '0.55', linewidth=7 if flat else 4,
                  solid_capstyle='butt', label='' if s else 'segment')
    radii = [segment.outer_diameter / 2 for segment in chain.arm.segments]
    radii = [radii[0], *np.repeat(radii, 2), radii[-1]]  # a disc leads from segment to segment
    edges = [1e3 * rim(*each)[:, seen] for each in zip(state.poses, radii, strict=True)]
    if flat:
        for around in map(np.concatenate, zip(edges[::2], edges[1::2], strict=True)):
            outline = around[scipy.spatial.ConvexHull(around, qhull_options='QJ').vertices]
            axes.fill(*outline.T, color='0.8', edgecolor='0.3', linewidth=0.8)
    else:
        for edge in edges:
            axes.plot(*edge.T, color='0.3', linewidth=0.8)
    names = chain.arm.tendon_names
    named = len(names) == len(DASHES)
    for number, (name, guides) in enumerate(zip(names, state.tendon_points, strict=True)):
        axes.plot(*(1e3 * guides[:, seen]).T, DASHES[number] if named else '-', color='0.1',
                  linewidth=1.0, label=name.replace('_', ' ') if named else
                  '' if number else 'tendons')
    axes.plot(*(1e3 * state.poses[:, seen]).T, 'o', color='black', markersize=3.5,
              label='rigid chain, calculation points')
    if flat:
        axes.set(aspect='equal', xlabel='x in mm')
        axes.grid(alpha=0.3)
        return
    # A cube: a shape that is nearly flat would be drawn in axes as thin as itself.
    low, high = (of(np.vstack([backbone, np.zeros((1, 3))]), axis=0) for of in (np.min, np.max))
    middle, half = (low + high) / 2, (high - low).max() / 2
    for name, centre in zip('xyz', middle, strict=True):
        axes.set(**{f'{name}lim': (centre - half, centre + half), f'{name}label': f'{name} in mm'})
    axes.set_box_aspect((1.0, 1.0, 1.0), zoom=0.88)  # with room for the labels


def rim(pose: Array, radius: float) -> Array:
    """Return the edge of a disc, (RING, 3), m; pose (7,), radius in m."""
    edge: Array = pose[:3] + radius * _circle(RING) @ matrices(pose[None, 3:])[0].T
    return edge


def _circle(corners: int, endpoint: bool = True) -> Array:
    """Return corners of the unit circle, (corners, 3), in the plane of x and y."""
    around = np.linspace(0.0, 2.0 * np.pi, corners, endpoint=endpoint)
    return np.column_stack([np.cos(around), np.sin(around), np.zeros(corners)])


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
        axes.set(aspect='equal', xlabel='x in mm')
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
    if (projection := projection_of(arm)) is None:
        figure, panels = new_panels(1, count, 4.4 * count, 5.2)
    else:
        figure = new_figure(4.6 * count, 5.2)
        panels = [figure.add_subplot(1, count, number, projection=projection)
                  for number in range(1, count + 1)]
    for axes, (name, (state, bending)) in zip(panels, shapes.items(), strict=True):
        draw_arm(axes, state)
        arcs = 1e3 * constant_curvature.poses(arm, bending)[0][:, arm.pose_axes[:3]]
        axes.plot(*arcs.T, 's', markersize=8, markerfacecolor='none', markeredgecolor='0.1',
                  label='constant curvature')
        axes.set_title(name, y=None if projection is None else 0.96, parse_math=False)
    finish_panels(path, figure, 2 if count == 1 else 5)


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
    axes, state = figure.add_subplot(1, len(panels), len(panels)), states[0][1]
    edge = 1e3 * rim(state.poses[0], state.chain.disc_radii[0])
    axes.plot(edge[:, 0], edge[:, 1], color='0.6', linewidth=1.2)
    for name, guides in zip(state.chain.arm.tendon_names, state.tendon_points, strict=True):
        x, y = 1e3 * guides[0, :2]
        axes.plot(x, y, 'o', color='0.0', markersize=4)
        axes.annotate(name, (x, y), (LABELS * x, LABELS * y), ha='center', va='center',
                      fontsize=7, parse_math=False)
    axes.set(aspect='equal', title='tendons at the base, from the tip', xlabel='x in mm',
             ylabel='y in mm')
    axes.margins(0.35)
    axes.grid(alpha=0.3)
    finish_panels(path, figure, 4)


def draw_obstacles(axes: Any, obstacles: Iterable[Obstacle], reach: float | None = None) -> None:
    """
    Draw obstacles into axes in mm, of 3d or behind an arm that is seen along y.

    reach: such axes then show those within m of the arm; without it their limits stay.
    """
    if axes.name == IN_SPACE:
        if triangles := faces(obstacles):
            corners = np.vstack(triangles)
            axes.plot_trisurf(*corners.T, triangles=np.arange(len(corners)).reshape(-1, 3),
                              color=OBSTACLE_COLOUR, alpha=OPACITY)
    elif polygons := outlines(obstacles):
        from matplotlib.collections import PolyCollection
        axes.add_collection(PolyCollection(
            polygons, facecolor=OBSTACLE_COLOUR, alpha=FLAT_OPACITY, edgecolor='none', zorder=0.5),
            autolim=False)
        if reach is not None:
            axes.update_datalim(np.clip(np.vstack(polygons), -1e3 * reach, 1e3 * reach))
            axes.autoscale_view()


def outlines(obstacles: Iterable[Obstacle]) -> list[Array]:
    """Return obstacles as seen along y: polygons (n, 2), x and z, mm."""
    return [_outline(part[:, ::2]) for one in obstacles for part in _convex_parts(one)]


def faces(obstacles: Iterable[Obstacle]) -> list[Array]:
    """Return the triangles of the surfaces of obstacles, (3, 3) each, mm."""
    return [points[s] for one in obstacles for points in _convex_parts(one)
            for s in ([[0, 1, 2]] if len(points) == 3
                      else scipy.spatial.ConvexHull(points).simplices)]


def _convex_parts(obstacle: Obstacle) -> list[Array]:
    """Return convex parts of an obstacle as points of them, (n, 3), mm."""
    shape, place = obstacle.shape, np.array(obstacle.position)
    if isinstance(shape, Mesh):
        parts = list(np.asarray(shape.vertices)[shape.triangles])
    elif isinstance(shape, Box):
        parts = [np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5)
                           for z in (-0.5, 0.5)]) * shape.size]
    else:
        corners = _circle(ROUND, endpoint=False)
        ball = np.vstack([np.cos(t) * corners + [0.0, 0.0, np.sin(t)]
                          for t in np.linspace(-np.pi / 2, np.pi / 2, ROUND // 2)])
        if isinstance(shape, Sphere):
            parts = [shape.radius * ball]
        else:
            edge = shape.radius * (ball if isinstance(shape, Capsule) else corners)
            half = np.array([0.0, 0.0, shape.length / 2])
            parts = [np.vstack([edge - half, edge + half])]
    return [1e3 * (part @ obstacle.rotation.T + place) for part in parts]


def _outline(points: Array) -> Array:
    """Return the corners of the convex hull of points in a plane, in their order."""
    if len(points) == 3:
        return points
    outline: Array = points[scipy.spatial.ConvexHull(points).vertices]
    return outline
