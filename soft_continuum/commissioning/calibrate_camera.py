# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``calibrate camera``: the lens of a camera, from images of the printed board."""

import argparse
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from time import monotonic

from soft_continuum.estimation.sensing.pictures import is_device, Picture, pictures
from soft_continuum.lab.analysis.verbs import reserve_outputs, run_verb
from soft_continuum.parameters.arguments import FOR_ANALYSIS, Parser

FILE = 'camera.yaml'
SECONDS, PERIOD = 30.0, 0.5  # s for which a device is looked at, and between two pictures
EVERY = 15  # picture of a video is looked at
SIZE = 1280, 960  # px that a device is asked for


def main(argv: Sequence[str] | None = None) -> int:
    """Calibrate; return the exit status."""
    parser = Parser('calibrate camera', 'Find focal length, centre and distortion of a camera '
                    'from images of the board that `tags` prints, held at many angles and in all '
                    f'corners. Writes {FILE}; set camera.calibration to it.',
                    *FOR_ANALYSIS)
    parser.add_argument('source', help='a folder of images, a video file, or a device such as '
                        '/dev/video0, which is recorded for 30 s')
    return run_verb(parser, _run, argv, 'cv2')


def _run(options: argparse.Namespace) -> None:
    from soft_continuum.estimation.sensing.lens import calibrate
    path, = reserve_outputs(options.output, [FILE], options.force)
    if is_device(options.source):
        print(f'{SECONDS:g} s of {options.source}: tilt the board slowly in all directions, hold '
              'it in all corners ...', flush=True)
    made = calibrate(_spread(pictures(options.source, SIZE), options.source))
    path.write_text(made.lens.text('camera'), encoding='utf-8')
    focal = (made.lens.matrix[0, 0] + made.lens.matrix[1, 1]) / 2.0
    print(f'focal length {focal:.1f} px, corners off by {made.residual:.3f} px RMS in '
          f'{made.pictures} pictures of {made.lens.size[0]} x {made.lens.size[1]}: {path}')


def _spread(found: Iterator[Picture], source: str) -> Iterator[Picture]:
    """Yield all images of a folder, two per second of a device, every fifteenth of a video."""
    if Path(source).is_dir():
        yield from found
    elif not is_device(source):
        yield from islice(found, 0, None, EVERY)
    else:
        begin = shown = monotonic()
        for picture in found:
            now = monotonic()
            if now - begin > SECONDS:
                return
            if now - shown >= PERIOD:
                shown = now
                yield picture
