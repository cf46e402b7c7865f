# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Change of the bending angles with the number of bodies, and their error."""

from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from soft_continuum.analysis.convergence import Convergence

MARKERS = 'o^sDvP*X'


def convergence_figure(path: str | Path, found: Convergence, tolerance: float) -> None:
    """Write change from n to n + 1 and error against the continuum over n, in percent."""
    figure = Figure(figsize=(9.0, 3.9), layout='constrained')
    left, right = figure.subplots(1, 2, sharex=True)
    for axes, values, label in ((left, found.change, 'change of angle from n to n + 1 in %'),
                                (right, found.error, 'error of angle in %')):
        for segment in range(values.shape[1]):
            axes.plot(found.bodies, 100.0 * values[:, segment],
                      marker=MARKERS[segment % len(MARKERS)], color=f'{0.25 * (segment % 3):.2f}',
                      markersize=4, markerfacecolor='none', linewidth=0.8,
                      label=f'segment {segment + 1}')
        axes.set_yscale('log')
        axes.yaxis.set_major_formatter('{x:g}')
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.set_xlabel('bodies per segment n')
        axes.set_ylabel(label)
        axes.grid(alpha=0.3, which='both')
    left.axhline(100.0 * tolerance, color='0.0', linestyle='--', linewidth=0.9,
                 label=f'{100 * tolerance:g} %')
    if found.converged is not None:
        left.axvline(found.converged, color='0.0', linestyle=':', linewidth=0.9,
                     label=f'n = {found.converged}')
    left.legend(frameon=False, fontsize='small')
    figure.savefig(path, dpi=120)
