# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Measured shapes with what the models say, as in the paper's Fig. 5."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
import numpy as np

from soft_continuum.analysis.validation import (
    CONSTANT_CURVATURE,
    CORRECTED,
    Prediction,
    WITH_GRAVITY,
    WITHOUT_GRAVITY,
)

MARKERS = {CONSTANT_CURVATURE: ('s', 9.0, ''), WITHOUT_GRAVITY: ('+', 9.0, ''),
           WITH_GRAVITY: ('^', 6.0, '--'), CORRECTED: ('D', 6.0, '')}
MOST_COLUMNS = 4


def validation_figure(path: str | Path, predictions: Sequence[Prediction]) -> None:
    """Write one panel for each shape: measured points, and a series for each model; mm."""
    shapes = list(dict.fromkeys(p.shape for p in predictions))
    columns = min(MOST_COLUMNS, len(shapes))
    rows = -(-len(shapes) // columns)
    drawn = np.concatenate(
        [*(s.positions for s in shapes), *(p.points[:, :2] for p in predictions)])
    width, height = np.ptp(drawn, axis=0)
    tall = min(2.0, max(0.4, height / max(width, 1e-3)))
    figure = Figure(figsize=(3.9 * columns, (3.5 * tall + 1.0) * rows + 0.6),
                    layout=ConstrainedLayoutEngine(h_pad=0.1))
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
    for axes, shape in zip(panels, shapes, strict=False):
        axes.plot(*(1e3 * shape.positions.T), 'o-', color='0.0', markersize=4.5, linewidth=0.8,
                  label='measured')
        for prediction in predictions:
            if prediction.shape is shape:
                marker, size, line = MARKERS[prediction.model]
                axes.plot(*(1e3 * prediction.points[:, :2].T), marker=marker, linestyle=line,
                          color='0.35', markersize=size, markerfacecolor='none', linewidth=0.8,
                          label=prediction.model)
        axes.set_title(shape.name, parse_math=False)
        axes.set_aspect('equal')
        axes.grid(alpha=0.3)
        axes.set_xlabel('x in mm')
        axes.tick_params(labelbottom=True)
    for axes in panels[len(shapes):]:
        axes.set_visible(False)
    for axes in panels[::columns]:
        axes.set_ylabel('z in mm')
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc='outside lower center', frameon=False,
                  ncols=min(len(labels), 2 * columns))
    figure.savefig(path, dpi=120)
