# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``export``: the tables of a recording for spreadsheets, MATLAB and pandas."""

import argparse
from collections.abc import Sequence
from pathlib import Path
import re

import numpy as np

from soft_continuum.extras import require
from soft_continuum.lab.analysis.recording import (
    DESCRIPTION,
    FILES,
    recorded_tables,
    Recording,
    TABLES,
    write_tables,
)
from soft_continuum.lab.analysis.results import reserve_outputs
from soft_continuum.lab.analysis.verbs import given_recording, recording_parser, run_verb

FORMATS = ('csv', 'mat', 'parquet')


def main(argv: Sequence[str] | None = None) -> int:
    """Run the verb; return the exit status."""
    parser = recording_parser('export', 'Write pulls, tensions, points, pressures, stiffness and '
                              'events of a recording as tables.')
    parser.add_argument('--format', choices=FORMATS, default='csv',
                        help='csv for spreadsheets, mat for MATLAB, parquet for pandas '
                        '(default: %(default)s)')
    return run_verb(parser, _run, argv)


def _run(options: argparse.Namespace) -> None:
    if options.format == 'parquet':
        require('pyarrow')
    recording, folder = given_recording(options, 'is exported')
    names = {'csv': FILES, 'mat': ('recording.mat',),
             'parquet': tuple(f'{name}.parquet' for name in TABLES)}[options.format]
    *paths, described = reserve_outputs(folder, [*names, DESCRIPTION], options.force)
    {'csv': write_tables, 'mat': _write_mat, 'parquet': _write_parquet}[options.format](
        recording, paths)
    if recording.description:
        described.write_text(recording.description, encoding='utf-8')
    print(f'Written: {", ".join(map(str, paths))}')


def _write_mat(recording: Recording, paths: Sequence[Path]) -> None:
    """Write a struct of columns for each table: pressures.time_s, pressures.pressure_kPa."""
    from scipy.io import savemat
    savemat(paths[0], {
        name: {field: _column([row[k] for row in rows])
               for k, field in enumerate(_fields(header))}
        for name, (header, rows) in recorded_tables(recording).items()},
        oned_as='column', long_field_names=True)


def _fields(columns: Sequence[str]) -> list[str]:
    """Return names for columns as MATLAB allows them: 63 letters, digits and underscores."""
    found: list[str] = []
    for column in columns:
        name = re.sub(r'[^A-Za-z0-9]+', '_', column).strip('_')
        name = (name if name[:1].isalpha() else f'x{name}')[:60]
        found.append(f'{name}_{len(found)}' if name in found else name)
    return found


def _column(values: Sequence[object]) -> np.ndarray:
    return np.array(values, dtype=object if any(isinstance(v, str) for v in values) else float)


def _write_parquet(recording: Recording, paths: Sequence[Path]) -> None:
    import pyarrow as arrow
    from pyarrow import parquet
    for path, (header, rows) in zip(paths, recorded_tables(recording).values(), strict=True):
        columns = {column: [row[k] for row in rows] for k, column in enumerate(header)}
        parquet.write_table(arrow.table(columns), path)
