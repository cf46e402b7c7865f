# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Reachable tips, and the outline of those without gravity."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure
import numpy as np
from scipy.spatial import ConvexHull

from soft_continuum.analysis.workspace import Reach


def workspace_figure(path: str | Path, reaches: Sequence[tuple[str, Reach]], base: Reach,
                     height: float) -> None:
    """
    Write one panel for each set of tips; mm.

    base: the tips whose outline is drawn in every panel.  height: of the straight arm, m.
    """
    figure = Figure(figsize=(4.2 * len(reaches), 3.9), layout='constrained')
    panels = figure.subplots(1, len(reaches), squeeze=False, sharex=True, sharey=True)[0]
    for axes, (title, reach) in zip(panels, reaches, strict=True):
        axes.plot(*(1e3 * reach.tips.T), '.', color='0.45', markersize=2.5, label='tips')
        if base.area > 0.0:
            hull = ConvexHull(base.tips).vertices
            outline = 1e3 * base.tips[np.append(hull, hull[0])]
            axes.plot(*outline.T, '--', color='0.0', linewidth=0.9,
                      label='outline without gravity')
        axes.plot([0.0, 0.0], [0.0, 1e3 * height], color='0.0', linewidth=2.5,
                  label='straight arm')
        axes.set_title(title)
        axes.set_aspect('equal')
        axes.grid(alpha=0.3)
        axes.set_xlabel('x in mm')
    panels[0].set_ylabel('z in mm')
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc='outside lower center', frameon=False, ncols=len(labels))
    figure.savefig(path, dpi=120)
