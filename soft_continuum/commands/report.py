# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Turn a recording into one HTML page."""

import argparse
from pathlib import Path
import sys

from soft_continuum.analysis.recording import read_recording
from soft_continuum.analysis.report import report_html
from soft_continuum.analysis.results import claim, text_table
from soft_continuum.commands.common import guarded

NAME = 'report'


def main(argv: list[str] | None = None) -> int:
    """Run the command; return the exit status."""
    parser = argparse.ArgumentParser(
        prog=NAME, description='Write a page with the figures and tables of a recording.',
        allow_abbrev=False)
    parser.add_argument('recording', type=Path, help='directory that the command record wrote')
    parser.add_argument('--title', default='', help='title of the page')
    parser.add_argument('--output', type=Path, default=Path(), metavar='DIR',
                        help='where report.html is written (default: here)')
    parser.add_argument('--force', action='store_true', help='overwrite a report that exists')
    return guarded(NAME, _run, parser.parse_args(argv))


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


if __name__ == '__main__':
    sys.exit(main())
