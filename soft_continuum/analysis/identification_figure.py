# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What an identification found: the error of each shape, and how sure the values are."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure
import numpy as np

from soft_continuum.analysis.identification import Identification


@dataclass(frozen=True)
class ShapeResult:
    """
    Largest errors of one shape, m.

    described: of the arm as described.  identified: of the fit, to which the shape belonged unless
    it was held out.  held_out: of a fit without the shape; nan where there was none.
    """

    name: str
    described: float
    identified: float
    held_out: float


def identification_figure(path: str | Path, found: Identification, shapes: Sequence[ShapeResult]
                          ) -> None:
    """Write errors by shape (mm, logarithmic), and values against those described with 95 %."""
    figure = Figure(figsize=(5.0 + 0.6 * len(shapes) + 0.5 * len(found.unknowns), 4.2),
                    layout='constrained')
    left, right = figure.subplots(1, 2, width_ratios=[2 + len(shapes), 2 + len(found.unknowns)])
    at = np.arange(len(shapes))
    for offset, label, color, hatch, values in (
            (-0.27, 'as described', '0.8', '', [s.described for s in shapes]),
            (0.0, 'identified', '0.3', '', [s.identified for s in shapes]),
            (0.27, 'without this shape', '1.0', '////', [s.held_out for s in shapes])):
        left.bar(at + offset, 1e3 * np.array(values), width=0.25, label=label, color=color,
                 edgecolor='0.0', hatch=hatch, linewidth=0.7)
    left.set_yscale('log')
    left.set_ylabel('largest position error in mm')
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
    right.set_xlim(-0.6, len(start) - 0.4)
    right.set_xticks(np.arange(len(start)), [u.name for u in found.unknowns], rotation=40,
                     ha='right')
    right.set_ylabel('change from described in %\n(friction, tilt: of 0.1)')
    right.grid(axis='y', alpha=0.3)
    figure.savefig(path, dpi=120)
