# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``twin_camera``: a simulated camera before the twin, on the topics of any camera driver."""

from collections.abc import Sequence
from contextlib import ExitStack

from soft_continuum.arguments import number_in, Parser
from soft_continuum.cli.twin import add_preset_options, chosen_differences, serve
from soft_continuum.sensing.opencv import OpenCVError, require_opencv

RATE = 10.0  # Hz


def main(argv: Sequence[str] | None = None) -> int:
    """Publish pictures until Ctrl-C; return the exit status."""
    parser = Parser('twin_camera', 'A simulated camera before the twin: draws the arm and its '
                    'tags, and publishes camera/image_raw and camera/camera_info.',
                    '--params-file', '--namespace')
    add_preset_options(parser)
    parser.add_argument('--rate', type=number_in(0.1, 60.0, 'Hz'), default=RATE, metavar='HZ',
                        help=f'pictures per second (default: {RATE:g}); to draw one takes '
                        'about 0.05 s of a core')
    options = parser.parse_args(argv)
    try:
        require_opencv()
    except OpenCVError as error:
        return parser.fail(error)
    from soft_continuum.nodes.up import description_file
    from soft_continuum.parameters.files import load_description
    from soft_continuum.ros.names import CAMERA
    from soft_continuum.sensing.layout import TagLayout
    from soft_continuum.twin.camera import TwinCamera
    from soft_continuum.twin.pictures import Pictures

    def begin(running: ExitStack) -> None:
        layout = TagLayout.of(load_description(
            *options.params_file or [description_file()], node=CAMERA))
        camera = TwinCamera(layout, chosen_differences(options))
        running.enter_context(Pictures(camera, options.rate, options.namespace))
        print('Simulated pictures on camera/image_raw. Ctrl-C ends it.', flush=True)

    return serve(parser, begin)
