# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of an arm and its shapes."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from soft_continuum.mechanics import constant_curvature, Equilibrium
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.drawing import draw_arm, projection_of, rim

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

DPI = 120
LABELS = 1.45  # times the distance of a tendon from the backbone: where its name is


def new_figure(width: float, height: float) -> 'Figure':
    """Return an empty figure (inches); the first one loads matplotlib, which takes 0.5 s."""
    from matplotlib.figure import Figure
    return Figure(figsize=(width, height), layout='constrained')


def new_panels(rows: int, columns: int, width: float, height: float,
               part: 'SubFigure | None' = None, projection: str | None = None
               ) -> 'tuple[Figure, list[Axes]]':
    """
    Return a figure (inches) and its panels, row by row; flat ones have equal scale, axes in mm.

    part: subfigure to draw into, instead of a new figure.  projection: from projection_of.
    """
    figure, flat = new_figure(width, height), projection is None
    panels = (part or figure).subplots(rows, columns, squeeze=False, sharex=flat, sharey=flat,
                                       subplot_kw={'projection': projection}).ravel()
    if not flat:
        return figure, list(panels)
    for axes in panels:
        axes.set(aspect='equal', xlabel='x in mm')
        axes.grid(alpha=0.3)
    for axes in panels[::columns]:
        axes.set_ylabel('z in mm')
    return figure, list(panels)


def finish_panels(path: str | Path, figure: 'Figure', legend_columns: int) -> None:
    """Write a figure with the legend of its first panel below all panels."""
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc='outside lower center', frameon=False,
                  ncols=min(len(labels), legend_columns))
    figure.savefig(path, dpi=DPI)


def shapes_figure(path: str | Path, shapes: Mapping[str, tuple[Equilibrium, Array]]) -> None:
    """
    Write a figure of shapes side by side, by constant curvature and by the rigid chain.

    shapes: by name, the state, and the commanded bending (segments, 2), rad.
    """
    arm, count = next(iter(shapes.values()))[0].chain.arm, len(shapes)
    projection = projection_of(arm)
    figure, panels = new_panels(1, count, 4.4 * count, 5.2, projection=projection)
    for axes, (name, (state, bending)) in zip(panels, shapes.items(), strict=True):
        draw_arm(axes, state)
        arcs = 1e3 * constant_curvature.poses(arm, bending)[0][:, arm.pose_axes[:3]]
        axes.plot(*arcs.T, 's', markersize=8, markerfacecolor='none', markeredgecolor='0.1',
                  label='constant curvature')
        axes.set_title(name, y=None if projection is None else 0.96, parse_math=False)
    finish_panels(path, figure, 2 if count == 1 else 5)


def preview_figure(path: str | Path, states: Sequence[tuple[str, Equilibrium]]) -> None:
    """Write a side view of states by their titles, and the tendons at the base; in mm."""
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
