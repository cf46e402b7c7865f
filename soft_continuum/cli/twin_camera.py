# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``twin_camera``: a simulated camera in front of the twin, with the usual topics."""

from argparse import ArgumentTypeError
from collections.abc import Sequence
from contextlib import ExitStack
from math import degrees, radians
import re

from soft_continuum.arguments import number_in, Parser
from soft_continuum.cli.twin import add_preset_options, chosen_model_errors, serve
from soft_continuum.extras import require
from soft_continuum.parameters.parameter import ParameterError

RATE = 10.0  # Hz
DIRECTION = 165.0  # degrees, from where every disc of the shipped shapes is seen best
NAME = re.compile(r'[a-z]\w{0,30}', re.ASCII)


def main(argv: Sequence[str] | None = None) -> int:
    """Publish images until Ctrl-C; return the exit status."""
    parser = Parser('twin_camera', 'A simulated camera in front of the twin: draws the arm and '
                    'its tags, and publishes NAME/image_raw and NAME/camera_info for the node '
                    'camera of that name.',
                    '--params-file', '--namespace')
    add_preset_options(parser)
    parser.add_argument('--rate', type=number_in(0.1, 60.0, 'Hz'), default=RATE, metavar='HZ',
                        help=f'images per second (default: {RATE:g}); drawing one takes about '
                        '0.05 s of a core')
    parser.add_argument('--name', type=_name, default='camera',
                        help='name of the camera (default: camera)')
    parser.add_argument('--direction', type=number_in(-360.0, 360.0, 'degrees'), metavar='DEGREES',
                        help='direction from the arm to the camera, for a spatial arm: angle '
                        'about z from x; fixed tags must be in view '
                        f'(default: {DIRECTION:g})')
    options = parser.parse_args(argv)
    require('cv2')
    from soft_continuum.parameters.files import load_description
    from soft_continuum.ros.names import CAMERA
    from soft_continuum.sensing.layout import FRONT, layout_of, RingLayout
    from soft_continuum.twin.camera import TwinCamera
    from soft_continuum.twin.pictures import Pictures
    from soft_continuum.user_files import description_file

    def begin(running: ExitStack) -> None:
        layout = layout_of(load_description(
            *options.params_file or [description_file()], node=CAMERA,
            namespace=options.namespace))
        rings, direction = isinstance(layout, RingLayout), options.direction
        if direction is not None and not rings:
            raise ParameterError('--direction is for spatial arms; a planar arm is seen from -y')
        if direction is None:
            direction = DIRECTION if rings else degrees(FRONT)
        camera = TwinCamera(layout, chosen_model_errors(options), radians(direction))
        running.enter_context(Pictures(camera, options.rate, options.namespace, options.name))
        print(f'Simulated pictures on {options.name}/image_raw. Ctrl-C ends it.', flush=True)

    return serve(parser, begin)


def _name(text: str) -> str:
    if not NAME.fullmatch(text):
        raise ArgumentTypeError(f'{text!r} is not a valid camera name; allowed: letters, digits '
                                'and _, such as camera_2')
    return text
