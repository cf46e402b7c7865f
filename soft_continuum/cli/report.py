# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``report``: one HTML page from a recording."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from soft_continuum.analysis.report import report_html, shapes_table
from soft_continuum.analysis.results import reserve_outputs, text_table
from soft_continuum.cli.common import given_recording, recording_parser, run_verb
from soft_continuum.parameters.files import load_description
from soft_continuum.parameters.parameter import ParameterError, Value


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
