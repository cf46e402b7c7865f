# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
How many rigid bodies a segment needs (paper, III-B).

As in the paper: every segment is bent in turn by a tendon that is pulled by the same length for
all n, and the relative change of its bending angle from n to n + 1 bodies is evaluated.  The error
relative to the continuum is not from the paper.  For spatial arms several tendons are pulled, and
n are multiples of the number of spans between guides.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from soft_continuum.lab.analysis.verbs import (
    described_arm,
    DPI,
    new_figure,
    progress,
    reserve_outputs,
    run_verb,
    text_table,
)
from soft_continuum.mechanics import Arm, ArmError, Equilibrium, SECOND_ORDER, SLACK, Statics
from soft_continuum.mechanics.arm import Array
from soft_continuum.parameters.arguments import FOR_ANALYSIS, number_in, Parser, whole_number_in
from soft_continuum.parameters.arm import check_actuation

CONTINUUM_BODIES = 100  # of the second-order chain, which is then within 1e-5 of the rod
Step = tuple[tuple[bool, ...], Array]
"""Soft segments, and the pull of each tendon, m; nan: slack."""
MARKERS = 'o^sDvP*X'
NAME = 'converge'
USUAL_BODIES, USUAL_SPANS = 16, 4


@dataclass(frozen=True, eq=False)
class Convergence:
    """
    Bending angles over the number of bodies.

    bodies: (m,).  angles: (m, segments) rad.  change: (m, segments), relative, from n to the next
    n; nan in the last row.  error: (m, segments), relative to the continuum.  converged: the first
    n from which on every change is below the tolerance; None if there is none.
    """

    bodies: NDArray[np.int64]
    angles: Array
    change: Array
    error: Array
    converged: int | None


def converge(arm: Arm, bending_angles: Sequence[float], tolerance: float, most: int,
             jamming: bool = True) -> Convergence:
    """
    Return the convergence analysis for 2 to ``most`` bodies per segment.

    bending_angles: (segments,) rad, not zero, for the described number of bodies; for spatial arms
    towards x.  tolerance: of the relative change.  jamming: whether segments are bent in turn, or
    all at once.  Raises StaticsError when no tendon holds the arm, ArmError when there are no two
    numbers of bodies to compare.
    """
    every = arm.spacers + 1
    bodies = np.arange(max(2, every), most + 1, every)
    if len(bodies) < 2:
        raise ArmError(f'with {every - 1} spacers the bodies of a segment are multiples of '
                       f'{every}, so up to {most} bodies there is nothing to compare; needed: '
                       f'{2 * every} and more')
    steps = _steps(arm, bending_angles, jamming)
    angles = np.array([_angles(arm.with_bodies(n), steps)
                       for n in progress(bodies.tolist(), 'bodies per segment')])
    rod = _angles(replace(arm, discretisation=SECOND_ORDER,
                          bodies_per_segment=max(1, CONTINUUM_BODIES // every) * every), steps)
    change = np.full_like(angles, np.nan)
    change[:-1] = np.abs(np.diff(angles, axis=0) / angles[:-1])
    below = np.all(change[:-1] < tolerance, axis=1)
    above = np.flatnonzero(~below)
    first = 0 if not above.size else int(above[-1]) + 1
    return Convergence(bodies, angles, change, np.abs(angles / rod - 1.0),
                       int(bodies[first]) if first < below.size else None)


def _steps(arm: Arm, bending_angles: Sequence[float], jamming: bool) -> list[Step]:
    """Return the pulls that bend the segments, in turn or all at once."""
    statics: Statics = Statics(arm)
    segments = range(len(arm.segments))
    state: Equilibrium = statics.chain.straight()
    steps: list[Step] = []
    wanted = np.column_stack([np.zeros(len(segments)), bending_angles])
    for soft in ([tuple(i == s for i in segments) for s in segments] if jamming
                 else [(True,) * len(segments)]):
        held = statics.hold(state, wanted, soft)
        steps.append((soft, np.where(held.pulls == SLACK, np.nan, held.pulls - state.pulls)))
        state = held.state
    return steps


def _angles(arm: Arm, steps: Sequence[Step]) -> Array:
    """Return the bending angles after each step of pulls."""
    statics: Statics = Statics(arm)
    state: Equilibrium = statics.chain.straight()
    for soft, lengths in steps:
        state = statics.solve(
            state, np.where(np.isnan(lengths), SLACK, state.pulls + lengths), soft)
    return state.bending_angles


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


# The verb.


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return the exit status."""
    parser = Parser(NAME, 'Convergence analysis: relative change of the bending angles from n '
                    'to n + 1 bodies per segment at constant pulls.', *FOR_ANALYSIS)
    parser.add_argument('--angle', type=number_in(1.0, 120.0, 'degrees'), default=36.0,
                        metavar='DEGREES', help='bending angle of every segment (default: 36)')
    parser.add_argument('--tolerance', type=number_in(1e-6, 0.1, ''), default=1e-3, metavar='PART',
                        help='relative change that counts as converged (default: 0.001)')
    parser.add_argument('--most', type=whole_number_in(3, 200), metavar='N',
                        help=f'largest number of bodies (default: {USUAL_BODIES}, or with spacers '
                        f'{USUAL_SPANS} for each span if that is more)')
    parser.add_argument('--gravity', action='store_true',
                        help='include the weight of the arm (default: without, as in the paper)')
    return run_verb(parser, _run, argv, 'matplotlib')


def _run(options: argparse.Namespace) -> None:
    values, arm = described_arm(options)
    check_actuation(arm, values)
    figure, = reserve_outputs(options.output, [f'{NAME}.png'], options.force)
    if not options.gravity:
        arm = arm.without_gravity()
    most = options.most or max(USUAL_BODIES, USUAL_SPANS * (arm.spacers + 1))
    jamming = bool(values['arm.jamming'])
    found = converge(arm, [np.radians(options.angle)] * len(arm.segments), options.tolerance,
                     most, jamming)
    segments = range(1, len(arm.segments) + 1)
    print(f'Constant pulls: those that bend every segment to {options.angle:g} degrees with n = '
          f'{arm.bodies_per_segment}, {"with" if options.gravity else "without"} gravity.\n')
    rows = [[f'{n}{" *" if n == found.converged else ""}',
             *(f'{np.degrees(a):.3f}' for a in angles),
             *(f'{100 * c:.4f}' if np.isfinite(c) else '' for c in change),
             *(f'{100 * e:.3f}' for e in error)]
            for n, angles, change, error in zip(
                found.bodies, found.angles, found.change, found.error, strict=True)]
    print(text_table(['n', *(f'angle {s}, deg' for s in segments),
                      *(f'change {s}, %' for s in segments),
                      *(f'error {s}, %' for s in segments)], rows))
    print('\nChange: from n to the next. Error: against the continuum; it is not the change.')
    if found.converged is None:
        print(f'Not converged: no change stays below {100 * options.tolerance:g} % up to '
              f'n = {most}; raise --most or --tolerance.')
    else:
        print(f'Converged at n = {found.converged}: every change is below '
              f'{100 * options.tolerance:g} % from there on.')
    convergence_figure(figure, found, options.tolerance)
    print(f'Figure: {figure}')
