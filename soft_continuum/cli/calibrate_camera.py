# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``calibrate camera``: the lens of a camera, from pictures of the printed board."""

import argparse
from collections.abc import Iterable, Sequence
from itertools import islice
from math import ceil
from typing import TYPE_CHECKING

from soft_continuum.analysis.results import reserve_outputs
from soft_continuum.arguments import FOR_ANALYSIS, Parser, WRONG_USAGE
from soft_continuum.cli.common import run_verb

if TYPE_CHECKING:
    from soft_continuum.sensing.corners import Picture

FILE = 'camera.yaml'
FRAMES = 600  # that are taken from a device, 20 s at 30 Hz
EVERY = 15  # of them is looked at
SIZE = 1280, 960  # px that a device is asked for


def main(argv: Sequence[str] | None = None) -> int:
    """Calibrate; return the exit status."""
    parser = Parser('calibrate camera', 'Find focal length, centre and distortion of a camera '
                    'from pictures of the board that `tags` prints, held at all angles and into '
                    f'all corners. Writes {FILE}, which camera.calibration names.',
                    *FOR_ANALYSIS)
    parser.add_argument('source', help='a folder of pictures, a video file, or a device such as '
                        '/dev/video0, of which 20 s are taken')
    from soft_continuum.sensing.lens import LensError
    try:
        return run_verb(parser, _run, argv)
    except LensError as error:
        return parser.fail(error, WRONG_USAGE)
    except ImportError:
        return parser.fail("OpenCV is not installed; install it with: pip install "
                           "'soft_continuum[camera]'")


def _run(options: argparse.Namespace) -> None:
    from soft_continuum.sensing.lens import LensError
    from soft_continuum.sensing.lens_calibration import calibrate
    from soft_continuum.sensing.sources import is_live, pictures, SourceError
    path, = reserve_outputs(options.output, [FILE], options.force)
    found: Iterable[Picture] = pictures(options.source, SIZE)
    if is_live(options.source):
        print(f'{ceil(FRAMES / 30)} s of {options.source}: turn the board slowly to all sides, '
              'hold it into all corners ...', flush=True)
        found = islice(found, 0, FRAMES, EVERY)
    try:
        made = calibrate(found)
    except SourceError as error:
        raise LensError(str(error)) from None
    path.write_text(made.lens.text('camera'), encoding='utf-8')
    focal = (made.lens.matrix[0, 0] + made.lens.matrix[1, 1]) / 2.0
    print(f'focal length {focal:.1f} px, corners off by {made.residual:.3f} px RMS in '
          f'{made.pictures} pictures of {made.lens.size[0]} x {made.lens.size[1]}: {path}')
