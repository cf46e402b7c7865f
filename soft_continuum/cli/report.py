# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``report``: one HTML page from a recording."""

import argparse
from collections.abc import Sequence
import os
from pathlib import Path

from soft_continuum.analysis.recording import DESCRIPTION, read_recording
from soft_continuum.analysis.report import MAX_SHAPES, report_html
from soft_continuum.analysis.results import reserve_outputs, text_table
from soft_continuum.arguments import Parser
from soft_continuum.cli.common import run_verb
from soft_continuum.parameters.files import load_description

IN_RECORDING = Path('RECORDING')


def main(argv: Sequence[str] | None = None) -> int:
    """Run the verb; return the exit status."""
    parser = Parser('report', 'Write a page with the figures and tables of a recording.',
                    '--output', '--force')
    parser.add_argument('recording', type=Path, metavar='RECORDING',
                        help='directory that record wrote')
    parser.add_argument('--title', default='', help='title of the page')
    parser.set_defaults(output=IN_RECORDING)
    return run_verb(parser, _run, argv)


def _run(options: argparse.Namespace) -> None:
    recording = read_recording(options.recording)
    described = options.recording / DESCRIPTION
    values = load_description(described) if os.path.lexists(described) else {}
    folder = options.recording if options.output is IN_RECORDING else options.output
    page, = reserve_outputs(folder, ['report.html'], options.force)
    title = options.title or f'Run in {options.recording.resolve().name}'
    page.write_text(report_html(recording, title, values), encoding='utf-8')
    print(text_table(
        ['shape', 'time s', 'tip x mm', 'tip y mm', 'tip z mm', 'tangent deg',
         *(f'{name} mm' for name in recording.tendon_names)],
        [[h.shape, f'{h.time:.1f}', *(f'{v:.2f}' for v in (*h.points[-1, :3], h.tangents[-1])),
          *(f'{p:.3f}' for p in h.pulls)] for h in recording.held_shapes()[:MAX_SHAPES]]))
    print(f'Page: {page}')
