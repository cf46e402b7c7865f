# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of the results of commands, in grey."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TYPE_CHECKING

import numpy as np
import scipy

from soft_continuum.analysis.characterisation import Characterisation
from soft_continuum.analysis.convergence import Convergence
from soft_continuum.analysis.curves import Curve
from soft_continuum.analysis.figures import DPI, finish_panels, new_figure, new_panels
from soft_continuum.analysis.identification import Identification
from soft_continuum.analysis.validation import (
    CONSTANT_CURVATURE,
    CORRECTED,
    Prediction,
    WITH_GRAVITY,
    WITHOUT_GRAVITY,
)
from soft_continuum.analysis.workspace import Reach, tips_in_common
from soft_continuum.mechanics.arm import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

GREYS = ('0.0', '0.4', '0.65')
DASHES = ('-', '--', ':', '-.')
MARKERS = 'o^sDvP*X'
MODEL_STYLES = {CONSTANT_CURVATURE: ('s', 9.0, ''), WITHOUT_GRAVITY: ('+', 9.0, ''),
                WITH_GRAVITY: ('^', 6.0, '--'), CORRECTED: ('D', 6.0, '')}
"""Marker, its size and the line of each model."""
MAX_PANELS = 4


@dataclass(frozen=True, eq=False)
class MeasuredState:
    """The curves of one state of a segment (soft or stiff), and their results."""

    name: str
    curves: Sequence[Curve]
    result: Characterisation


def stiffness_figure(path: str | Path, states: Sequence[MeasuredState], title: str) -> None:
    """Write curves and residuals, one row of panels for each state; mm and N on the axes."""
    figure = new_figure(9.0, 3.6 * len(states) + 0.4)
    panels = figure.subplots(len(states), 2, squeeze=False)
    for (over, rest), state in zip(panels, states, strict=True):
        line = state.result.regression
        for k, (curve, residual) in enumerate(zip(state.curves, line.residuals, strict=True)):
            style = {'color': GREYS[k % len(GREYS)], 'linestyle': DASHES[k % len(DASHES)],
                     'linewidth': 1.0, 'label': f'repetition {k + 1}'}
            over.plot(1e3 * curve.displacement, curve.force, **style)
            rest.plot(1e3 * curve.loading[0], residual, **style)
        ends = np.array([0.0, max(c.displacement.max() for c in state.curves)])
        over.plot(1e3 * ends, line.slope * ends + line.intercept, color='0.0', linewidth=2.2,
                  alpha=0.6, label=f'regression, k = {line.slope * 1e-3:.4g} N/mm')
        if state.result.table_curve is not None:
            displacement, force = state.result.table_curve
            over.plot(1e3 * displacement, force, 'o', color='0.0', markersize=4, markevery=10,
                      markerfacecolor='none', label='moment-curvature table')
        rest.axhline(0.0, color='0.0', linewidth=2.2, alpha=0.6)
        over.set_title(f'{title}, {state.name}', parse_math=False)
        rest.set_title('residuals on the way up')
        if len(state.curves) <= 8:
            over.legend(frameon=False, fontsize='small')
        for axes, label in ((over, 'force in N'), (rest, 'force less regression in N')):
            axes.set(xlabel='displacement in mm', ylabel=label)
            axes.grid(alpha=0.3)
    figure.savefig(path, dpi=DPI)


def convergence_figure(path: str | Path, found: Convergence, tolerance: float) -> None:
    """Write change to the next n and error against the continuum over n, in percent."""
    from matplotlib.ticker import LogLocator, NullFormatter
    figure = new_figure(9.0, 3.9)
    left, right = figure.subplots(1, 2, sharex=True)
    for axes, values, label in ((left, found.change, 'change of angle to the next n in %'),
                                (right, found.error, 'error of angle in %')):
        for segment in range(values.shape[1]):
            axes.plot(found.bodies, 100.0 * values[:, segment],
                      marker=MARKERS[segment % len(MARKERS)], color=f'{0.25 * (segment % 3):.2f}',
                      # Where series coincide, every marker is seen around the one before it.
                      markersize=3 + 3 * (segment % 5), markerfacecolor='none', linewidth=0.8,
                      label=f'segment {segment + 1}')
        axes.set(yscale='log', xlabel='bodies per segment n', ylabel=label)
        axes.yaxis.set_major_formatter('{x:g}')
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.grid(alpha=0.3, which='both')
    left.axhline(100.0 * tolerance, color='0.0', linestyle='--', linewidth=0.9,
                 label=f'{100 * tolerance:g} %')
    if found.converged is not None:
        left.axvline(found.converged, color='0.0', linestyle=':', linewidth=0.9,
                     label=f'n = {found.converged}')
    left.legend(frameon=False, fontsize='small')
    figure.savefig(path, dpi=DPI)


def validation_figure(path: str | Path, predictions: Sequence[Prediction]) -> None:
    """Write a panel for each shape from the side, and the error of each model; mm."""
    shapes = list(dict.fromkeys(p.shape for p in predictions))
    columns = min(MAX_PANELS, len(shapes))
    rows = -(-len(shapes) // columns)
    drawn = np.concatenate([*(s.positions for s in shapes), *(p.points for p in predictions)])
    width, _, height = np.ptp(drawn, axis=0)
    tall = min(2.0, max(0.4, height / max(width, 1e-3)))
    width, height = 3.9 * columns, (3.5 * tall + 1.0) * rows
    figure = new_figure(width, height + 3.6)
    above, below = figure.subfigures(2, 1, squeeze=False, height_ratios=[height, 3.0]).ravel()
    panels = new_panels(rows, columns, width, height, above)[1]
    errors = below.subplots()
    starts = np.cumsum([0, *(len(shape.moving) + 1 for shape in shapes)])
    for axes, shape, start in zip(panels, shapes, starts.tolist(), strict=False):
        axes.plot(*(1e3 * shape.positions[:, ::2].T), 'o-', color='0.0',
                  markersize=4.5, linewidth=0.8, label='measured')
        for prediction in (p for p in predictions if p.shape is shape):
            marker, size, line = MODEL_STYLES[prediction.model]
            style: dict[str, Any] = {'marker': marker, 'markersize': size, 'color': '0.35',
                                     'markerfacecolor': 'none'}
            axes.plot(*(1e3 * prediction.points[:, ::2].T), linestyle=line, linewidth=0.8,
                      label=prediction.model, **style)
            errors.plot(start + np.arange(len(shape.moving)), 1e3 * prediction.errors,
                        linewidth=0.5, **style)
        axes.set_title(shape.name, parse_math=False)
        axes.tick_params(labelbottom=True)
    for axes in panels[len(shapes):]:
        axes.set_visible(False)
    errors.set_xticks(starts[:-1], [f'{s.name}, base' for s in shapes], parse_math=False,
                      rotation=30 if len(shapes) > MAX_PANELS else 0, ha='left')
    errors.set_ylabel('error of each point in mm')
    errors.grid(alpha=0.3)
    finish_panels(path, figure, 2 * columns)


@dataclass(frozen=True)
class ShapeResult:
    """
    Largest errors of one shape, m.

    described: of the described arm.  identified: of the fit, which includes the shape unless it
    was held out.  held_out: of a fit without the shape; nan without one.
    """

    name: str
    described: float
    identified: float
    held_out: float


def identification_figure(path: str | Path, found: Identification,
                          shapes: Sequence[ShapeResult]) -> None:
    """Write errors by shape (mm, logarithmic), and values against those described with 95 %."""
    figure = new_figure(5.0 + 0.6 * len(shapes) + 0.5 * len(found.unknowns), 4.2)
    left, right = figure.subplots(1, 2, width_ratios=[2 + len(shapes), 2 + len(found.unknowns)])
    at = np.arange(len(shapes))
    for offset, label, color, hatch, values in (
            (-0.27, 'as described', '0.8', '', [s.described for s in shapes]),
            (0.0, 'identified', '0.3', '', [s.identified for s in shapes]),
            (0.27, 'without this shape', '1.0', '////', [s.held_out for s in shapes])):
        left.bar(at + offset, 1e3 * np.array(values), width=0.25, label=label, color=color,
                 edgecolor='0.0', hatch=hatch, linewidth=0.7)
    left.set(yscale='log', ylabel='largest position error in mm')
    left.set_xticks(at, [s.name for s in shapes], rotation=40, ha='right', parse_math=False)
    left.legend(frameon=False, fontsize='small', loc='upper center',
                bbox_to_anchor=(0.5, 1.14), ncols=3)
    left.grid(axis='y', alpha=0.3)
    start = np.array([u.start for u in found.unknowns])
    percent = 100.0 / np.array([u.scale for u in found.unknowns])
    right.errorbar(np.arange(len(start)), percent * (found.values - start),
                   yerr=percent * found.half_widths, fmt='o', color='0.0', capsize=5,
                   markersize=4)
    right.axhline(0.0, color='0.0', linestyle='--', linewidth=0.8)
    right.set(xlim=(-0.6, len(start) - 0.4),
              ylabel='change from described in %\n(friction, tilt: of 0.1)')
    right.set_xticks(np.arange(len(start)), [u.name for u in found.unknowns], rotation=40,
                     ha='right')
    right.grid(axis='y', alpha=0.3)
    figure.savefig(path, dpi=DPI)


def workspace_figure(path: str | Path, reaches: Sequence[tuple[str, Reach]], base: Reach,
                     height: float) -> None:
    """
    Write a figure of tips, a panel for each set, and their displacement by gravity; mm.

    For planar arms it shows their density, with the displacement below; for spatial arms side and
    top views, darker for larger displacements.  base: the tips whose outline is drawn in every
    panel.  height: of the straight arm, m.
    """
    flat, count = base.tips.shape[1] == 2, len(reaches)
    figure, panels = new_panels(2, count, 4.2 * count, 6.8 if flat else 8.4)
    for column, (title, reach) in enumerate(reaches):
        above, below = panels[column::count]
        pairs = np.array(tips_in_common(reach, base)).reshape(-1, 2, base.tips.shape[1]) * 1e3
        moves = reach is not base and len(pairs) > 0
        if flat:
            if reach.tips.size:
                tips = above.hexbin(*(1e3 * reach.tips.T), gridsize=30, mincnt=1, cmap='Greys',
                                    vmin=0.0, linewidths=0.1)
                figure.colorbar(tips, ax=above, label='tips in a cell', shrink=0.6)
            _outline(above, base.tips, base.hull)
            below.set_visible(moves)
            views = [(below, 0, 1)] if moves else []
        else:
            views = [(above, 0, 2), (below, 0, 1)]
        moved = np.linalg.norm(pairs[:, 1] - pairs[:, 0], axis=1)
        order = np.argsort(moved)  # the furthest on top
        for axes, i, j in views:
            points = axes.scatter(pairs[order, 0, i], pairs[order, 0, j], c=moved[order], s=7,
                                  cmap='Greys', vmin=0.0, edgecolors='0.6', linewidths=0.3,
                                  label='tip' if not column else None)
            if not flat:
                _outline(axes, base.tips[:, [i, j]], base.hull)
                axes.set_ylabel(f'{"xyz"[j]} in mm')
        if moves:
            figure.colorbar(points, ax=[axes for axes, *_ in views], label='moved by gravity, mm',
                            shrink=0.6)
        above.plot([0.0, 0.0], [0.0, 1e3 * height], color='0.0', linewidth=2.5,
                   label='straight arm')
        above.set_title(title)
    finish_panels(path, figure, 3)


def _outline(axes: 'Axes', tips: Array, hull: float) -> None:
    """Draw the outline of tips (n, 2), m, unless their hull is nothing."""
    if hull > 0.0:
        around = scipy.spatial.ConvexHull(tips).vertices
        outline = 1e3 * tips[np.append(around, around[0])]
        axes.plot(*outline.T, '--', color='0.0', linewidth=0.9, label='outline without gravity')
