# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
``measure``: sets shapes and measures the discs.  ``tags``: writes printable tags.

``measure`` writes the input of identify and validate.
"""

import argparse
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from time import sleep
from typing import TYPE_CHECKING

import numpy as np

from soft_continuum.client import ClientError
from soft_continuum.lab.analysis.verbs import (
    origin,
    reserve_outputs,
    ResultError,
    run_verb,
    write_rows,
)
from soft_continuum.parameters.arguments import FOR_ANALYSIS, number_in, Parser

if TYPE_CHECKING:
    from soft_continuum.client import Arm
    from soft_continuum.client.measured import MeasuredDisc
    from soft_continuum.mechanics import arm as mechanics

FILES = 'points.csv', 'pulls.csv'
SETTLING = 1.0  # s of holding before the measurement
CHECK = 1.5  # s within which a measurement must arrive before anything moves
Pulls = tuple[float, ...]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the verb; return the exit status."""
    parser = Parser('measure', 'Set shapes one after the other, each from the straight arm, and '
                    'measure the discs with disc_N/measured_pose (nodes camera and disc_sensors). '
                    f'Writes {" and ".join(FILES)} for identify and validate.', '--namespace',
                    '--timeout', '--output', '--force')
    parser.add_argument('shapes', nargs='*', metavar='SHAPE',
                        help='names in the shape library (default: all)')
    parser.add_argument('--duration', type=number_in(0.5, 60.0, 's'), default=2.0, metavar='S',
                        help='time for which each shape is measured (default: 2 s)')
    return run_verb(parser, _run, argv)


def _run(options: argparse.Namespace) -> None:
    if twice := [name for name, times in Counter(options.shapes).items() if times > 1]:
        raise ResultError(f'{twice[0]} is given twice; each shape is measured once')
    paths = reserve_outputs(options.output, FILES, options.force)
    from soft_continuum.client import Arm
    with Arm(options.namespace, timeout=options.timeout) as arm:
        known = arm.shapes
        for name in options.shapes:
            if name not in known:
                raise ResultError(f'no shape is called {name!r}; known: {", ".join(known)}')
        _with_position(arm.measure(max(CHECK, options.duration)))  # before anything moves
        _measure_all(arm, options.shapes or [n for n in known if any(known[n])], options, paths)
    print(f'written: {", ".join(map(str, paths))}')


def _measure_all(arm: 'Arm', names: Sequence[str], options: argparse.Namespace,
                 paths: Sequence[Path]) -> None:
    """Set and measure one shape after the other; write all of them after each."""
    title = origin('measure', arm.is_simulated, 'Measured')
    description, jamming = arm.description, arm.has_jamming
    points = [[title], ['shape', 'point', *(f'{axis} [mm]' for axis in description.axes),
                        'deviation [mm]']]
    pulls = [[title], ['shape', *(['segment'] if jamming else []),
                       *(f'{t} [mm]' for t in description.tendon_labels)]]
    for name in names:
        print(f'{name} ...', flush=True)
        steps, discs = _set_and_measure(arm, name, options.duration, jamming)
        pulls += [[name, *([str(segment)] if jamming else []),
                   *(f'{p * 1e3:.4f}' for p in pulled)] for segment, pulled in steps]
        points += _rows(name, discs, description)
        print(f'  {len(discs)} discs, each seen {min(d.samples for d in discs.values())} '
              'times or more', flush=True)
        for path, rows in zip(paths, (points, pulls), strict=True):
            write_rows(path, rows)


def _set_and_measure(arm: 'Arm', name: str, duration: float, jamming: bool
                     ) -> tuple[list[tuple[int, Pulls]], 'dict[int, MeasuredDisc]']:
    """
    Return each segment that was stiffened with its pulls, in order, and the measured discs.

    In closed loop a segment may be set more than once.  Without jamming, the pulls at the
    measurement count as those of segment 0.
    """
    from soft_continuum.sequencing import Phase
    arm.run([0.0] * len(arm.description.segments))
    steps: list[tuple[int, Pulls]] = []
    discs: dict[int, MeasuredDisc] = {}
    stiffens = None  # which segment
    running = arm.start(name, hold=SETTLING + duration + 0.5)
    for now in running.updates():
        before, stiffens = stiffens, now.segment if now.phase == Phase.STIFFENING else None
        if jamming and stiffens not in (None, before) and not discs:
            steps.append((now.segment, arm.state.pulls or ()))
        if now.phase == Phase.HOLDING and not discs:
            sleep(SETTLING)
            if not jamming:
                steps = [(0, arm.state.pulls or ())]
            seen = _with_position(arm.measure(duration))
            last = running.progress
            if last is not None and last.phase == Phase.HOLDING:  # not corrected meanwhile
                discs = seen
    running.result()
    if not discs or not steps or not all(pulls for _, pulls in steps):
        raise ClientError(f'{name} was set too quickly to be recorded, or corrected while it was '
                          'held; measure it again')
    return steps, discs


def _with_position(discs: 'dict[int, MeasuredDisc]') -> 'dict[int, MeasuredDisc]':
    """Return the discs with measured positions; raises ClientError without one that moves."""
    found = {n: disc for n, disc in discs.items() if disc.has_position}
    if not found:
        raise ClientError('only angles of the discs are measured; points need positions from a '
                          'camera or a tracker')
    if not any(found):
        raise ClientError('only the base disc is measured, which does not move; see camera/status '
                          'and disc_sensors/status')
    return found


def _rows(name: str, discs: 'dict[int, MeasuredDisc]', arm: 'mechanics.Arm'
          ) -> list[list[str]]:
    """Return the bottom and the top of each disc as rows; without orientation only the bottom."""
    rows = []
    axes = arm.pose_axes[:3]
    for n, disc in discs.items():
        stddev = float(np.linalg.norm(disc.stddev[:3])) * 1e3
        for point, place in enumerate(disc.points(arm.discs[n].height)[:, axes], 2 * n + 1):
            if np.isfinite(place).all():
                rows.append([name, str(point), *(f'{p * 1e3:.4f}' for p in place),
                             f'{stddev:.4f}'])
    return rows


# Tags.


def tags(argv: Sequence[str] | None = None) -> int:
    """Write the PDF; return the exit status."""
    parser = Parser('tags', 'Printable tags (36h11) for the described arm: one for each disc, or '
                    'a ring of tags for each disc of a spatial arm, fixed tags for the boards '
                    'behind it, a mounting drawing, and rulers. The parameters tags.* of the node '
                    'camera set their sizes and positions.',
                    *FOR_ANALYSIS)
    return run_verb(parser, _write_tags, argv, 'cv2', 'matplotlib')


def _write_tags(options: argparse.Namespace) -> None:
    from soft_continuum.estimation.sensing.layout import layout_of
    from soft_continuum.ros.description import load_description
    from soft_continuum.ros.names import CAMERA
    layout = layout_of(load_description(
        *options.params_file, node=CAMERA, namespace=options.namespace))
    path, = reserve_outputs(options.output, ['tags.pdf'], options.force)
    from soft_continuum.estimation.sensing.printing import write_tags
    write_tags(path, layout)
    on_discs = sum(len(layout.ring(n)) for n in range(len(layout.heights)))
    print(f'{on_discs} tags for discs and {len(layout.fixed)} fixed ones: {path}')
