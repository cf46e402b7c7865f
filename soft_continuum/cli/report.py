# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``report``: one HTML page from a recording."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from soft_continuum.analysis.recording import read_recording
from soft_continuum.analysis.report import report_html
from soft_continuum.analysis.results import claim, text_table
from soft_continuum.arguments import Parser
from soft_continuum.cli.common import run_verb


def main(argv: Sequence[str] | None = None) -> int:
    """Run the verb; return the exit status."""
    parser = Parser('report', 'Write a page with the figures and tables of a recording.',
                    '--output', '--force')
    parser.add_argument('recording', type=Path, help='directory that record wrote')
    parser.add_argument('--title', default='', help='title of the page')
    return run_verb(parser, _run, argv)


def _run(options: argparse.Namespace) -> None:
    recording = read_recording(options.recording)
    page, = claim(options.output, ['report.html'], options.force)
    page.write_text(report_html(recording, options.title or f'Run in {options.recording.name}'),
                    encoding='utf-8')
    print(text_table(
        ['shape', 'time s', 'tip x mm', 'tip y mm', 'tip z mm', 'tangent deg',
         *(f'{name} mm' for name in recording.tendon_names)],
        [[h.shape, f'{h.time:.1f}', *(f'{v:.2f}' for v in (*h.points[-1, :3], h.tangents[-1])),
          *(f'{p:.3f}' for p in h.pulls)] for h in recording.held_shapes()]))
    print(f'Page: {page}')
