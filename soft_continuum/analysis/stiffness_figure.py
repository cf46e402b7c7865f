# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Force over displacement with its regression line, and what the line leaves (paper, Fig. 4)."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure
import numpy as np

from soft_continuum.analysis.characterisation import Characterisation
from soft_continuum.analysis.curves import Curve

GREYS = ('0.0', '0.4', '0.65')
DASHES = ('-', '--', ':', '-.')


@dataclass(frozen=True, eq=False)
class MeasuredState:
    """The curves of one state of a segment (soft or stiff), and what they say."""

    name: str
    curves: Sequence[Curve]
    result: Characterisation


def stiffness_figure(path: str | Path, states: Sequence[MeasuredState], title: str) -> None:
    """Write curves and residuals, one row of panels for each state; mm and N on the axes."""
    figure = Figure(figsize=(9.0, 3.6 * len(states) + 0.4), layout='constrained')
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
        over.set_ylabel('force in N')
        rest.set_ylabel('force less regression in N')
        over.set_title(f'{title}, {state.name}', parse_math=False)
        rest.set_title('residuals on the way up')
        if len(state.curves) <= 8:
            over.legend(frameon=False, fontsize='small')
        for axes in (over, rest):
            axes.set_xlabel('displacement in mm')
            axes.grid(alpha=0.3)
    figure.savefig(path, dpi=120)
