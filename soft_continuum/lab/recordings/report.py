# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Report of a recorded run as one self-contained HTML page."""

import argparse
import base64
from collections.abc import Iterable, Mapping, Sequence
from html import escape
import io
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from soft_continuum import version
from soft_continuum.lab.analysis.verbs import (
    new_figure,
    new_panels,
    reserve_outputs,
    run_verb,
    text_table,
)
from soft_continuum.lab.recordings.tables import (
    given_recording,
    HeldShape,
    Recording,
    recording_parser,
)
from soft_continuum.parameters.arm import ARM_PARAMETERS
from soft_continuum.parameters.parameter import ParameterError, Value
from soft_continuum.parameters.scalars import as_yaml
from soft_continuum.ros.description import load_description

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STYLE = """
body { font-family: sans-serif; max-width: 62em; margin: 2em auto; padding: 0 1em; color: #222 }
table { border-collapse: collapse; margin: 1em 0 } img { max-width: 100% }
th, td { padding: 0.2em 0.8em; border-bottom: 1px solid #ccc; text-align: right }
th:first-child, td:first-child, .text td { text-align: left }
"""
LINES = ('-', '--', '-.', ':')
MAX_PANELS = 12
IN_PLANE = 1e-3  # mm beside the plane of x and z: there is nothing to see over y
MAX_SHAPES = 200
MAX_EVENTS = 1000


def report_html(recording: Recording, title: str, parameters: Mapping[str, Value]) -> str:
    """
    Return the page; the data of its figures are also in its tables or in the files.

    parameters: of the arm, by name; empty if unknown.
    """
    held = recording.held_shapes()
    parts = [f'<h1>{escape(title)}</h1>', _summary(recording)]
    if held:
        parts += ['<h2>Shapes held</h2>', _first(held, MAX_SHAPES, 'shapes'),
                  _image(_shapes(held[:MAX_PANELS]), 'the first shapes, described below'),
                  _table(*shapes_table(recording))]
    parts += ['<h2>Over time</h2>',
              _image(_over_time(recording), 'pulls, tensions and pressures over time')]
    parts += ['<h2>Events</h2>', _first(recording.events, MAX_EVENTS, 'events'), _table(
        ['time, s', 'source', 'event'],
        [[f'{time:.2f}', source, text] for time, source, text in recording.events[:MAX_EVENTS]],
        'text')]
    arm = [[p.name, as_yaml(parameters[p.name], digits=6), p.unit, p.meaning]
           for p in ARM_PARAMETERS if p.name in parameters]
    parts += ['<h2>Arm</h2>', _table(['parameter', 'value', 'unit', 'meaning'], arm, 'text') if arm
              else '<p>The recording does not contain the parameters of the arm.</p>']
    return ('<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
            f'<title>{escape(title)}</title><style>{STYLE}</style></head><body>'
            + '\n'.join(parts) + '</body></html>\n')


def _summary(recording: Recording) -> str:
    rows = [['recorded by', recording.about or 'not known'],
            ['reported by', f'soft_continuum {version()}']]
    if len(recording.tendons):
        pulls = recording.tendons[:, 1:]
        rows.append(['pulls, mm', ', '.join(
            f'{name} {low:.2f} to {high:.2f}' for name, low, high in zip(
                recording.tendon_names, pulls.min(axis=0), pulls.max(axis=0), strict=True))])
        rows.append(['duration, s', f'{recording.tendons[-1, 0]:.1f}'])
    known = [(name, tensions[np.isfinite(tensions)]) for name, tensions in zip(
        recording.tendon_names, recording.tensions[:, 1:].T, strict=True)]
    largest = ', '.join(f'{name} {values.max():.2f}' for name, values in known if values.size)
    if largest:
        rows.append(['largest tension predicted by the model, N', largest])
    for segment in np.unique(recording.stiff[:, 1]):
        flags = recording.stiff[recording.stiff[:, 1] == segment, 2]
        rows.append([f'segment {segment:.0f} softened', f'{np.sum(np.diff(flags) < 0)} times'])
    return _table(['', ''], rows, 'text')


def shapes_table(recording: Recording) -> tuple[list[str], list[list[str]]]:
    """Return the names of the columns, and the ends of the segments of every held shape."""
    rows = []
    for shape in recording.held_shapes()[:MAX_SHAPES]:
        ends = np.column_stack([shape.points[:, :3], shape.tangents])
        labels = [*(f'segment {n + 1}' for n in range(len(ends[2::2]))), 'tip']
        rows += [[shape.shape, f'{shape.time:.1f}', label, *(f'{v:.2f}' for v in values),
                  *(f'{pull:.3f}' for pull in shape.pulls)]
                 for label, values in zip(labels, [*ends[2::2], ends[-1]], strict=True)]
    return ['shape', 'time, s', 'end of', 'x, mm', 'y, mm', 'z, mm', 'tangent, degrees',
            *(f'{name} pull, mm' for name in recording.tendon_names)], rows


def _shapes(held: Sequence[HeldShape]) -> 'Figure':
    columns = min(4, len(held))
    rows = -(-len(held) // columns)
    figure, panels = new_panels(rows, columns, 3.2 * columns, 3.8 * rows)
    for axes in panels[len(held):]:
        axes.set_visible(False)
    for axes, shape in zip(panels, held, strict=False):
        axes.plot(shape.points[:, 0], shape.points[:, 2], 'o-', color='black', markersize=4,
                  label='z over x')
        if np.abs(shape.points[:, 1]).max() > IN_PLANE:
            axes.plot(shape.points[:, 1], shape.points[:, 2], 's--', color='0.5', markersize=3,
                      label='z over y')
            axes.set_xlabel('x, y in mm')
            axes.legend(loc='lower right', frameon=False)
        axes.set_title(shape.shape, parse_math=False)
    return figure


def _over_time(recording: Recording) -> 'Figure':
    figure = new_figure(9.0, 7.5)
    pulls, tensions, pressures = figure.subplots(3, 1, sharex=True)
    for axes, rows, label in ((pulls, recording.tendons, 'pull in mm'),
                              (tensions, recording.tensions, 'tension in N\n(model)')):
        for column, name in enumerate(recording.tendon_names, start=1):
            axes.plot(rows[:, 0], rows[:, column], LINES[(column - 1) % len(LINES)],
                      color='black', label=name)
        axes.set_ylabel(label)
    for n in np.unique(recording.pressures[:, 1]):
        rows = recording.pressures[recording.pressures[:, 1] == n]
        pressures.plot(rows[:, 0], rows[:, 2], LINES[(int(n) - 1) % len(LINES)], color='black',
                       label=f'segment {n:.0f}')
    pressures.set(xlabel='time in s', ylabel='pressure in kPa\n(absolute)')
    for axes in (pulls, tensions, pressures):
        axes.grid(alpha=0.3)
        if axes.lines:
            axes.legend(loc='upper left', frameon=False, ncols=3)
    return figure


def _first(items: Sequence[object], most: int, what: str) -> str:
    return ('' if len(items) <= most else
            f'<p>The first {most} of {len(items)} {what}; the files have all of them.</p>')


def _image(figure: 'Figure', alternative: str) -> str:
    data = io.BytesIO()
    figure.savefig(data, format='png', dpi=110)
    encoded = base64.b64encode(data.getvalue()).decode('ascii')
    return f'<img alt="{escape(alternative)}" src="data:image/png;base64,{encoded}">'


def _table(head: Sequence[str], rows: Iterable[Sequence[str]], kind: str = '') -> str:
    lines = ['<tr>' + ''.join(f'<t{cell}>{escape(text)}</t{cell}>' for text in row) + '</tr>'
             for cell, some in (('h', [head]), ('d', rows)) for row in some]
    return f'<table class="{kind}">' + '\n'.join(lines) + '</table>'


# The verb.


def main(argv: Sequence[str] | None = None) -> int:
    """Run the verb; return the exit status."""
    parser = recording_parser('report', 'Write a page with the figures and tables of a recording.')
    parser.add_argument('--title', default='', help='title of the page')
    return run_verb(parser, _run, argv, 'matplotlib')


def description_in(text: str, recording: Path) -> dict[str, Value]:
    """Return the parameters of a recorded arm, none if unknown; raises ParameterError."""
    if not text:
        return {}
    with TemporaryDirectory() as directory:
        path = Path(directory, 'description.yaml')
        path.write_text(text, encoding='utf-8')
        try:
            return load_description(path)
        except ParameterError as error:
            raise ParameterError(str(error).replace(
                str(path), f'the description in {recording}')) from None


def _run(options: argparse.Namespace) -> None:
    recording, folder = given_recording(options, 'is reported')
    values = description_in(recording.description, options.recording)
    page, = reserve_outputs(folder, ['report.html'], options.force)
    title = options.title or f'Run in {options.recording.resolve().name}'
    page.write_text(report_html(recording, title, values), encoding='utf-8')
    print(text_table(*shapes_table(recording)))
    print(f'Page: {page}')
