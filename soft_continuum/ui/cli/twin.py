# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``twin``: a simulated rig in MuJoCo behind emulated boards; ``twin_camera``: one before it."""

from argparse import ArgumentTypeError, Namespace
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from math import degrees, radians
import re
import threading

from soft_continuum.extras import require
from soft_continuum.hardware.real_time import ask_for_a_larger_share
from soft_continuum.parameters.arguments import DONE, given_path, number_in, Parser, WRONG_USAGE
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.sim.emulators.tendon_motors import TENDON_MOTORS
from soft_continuum.sim.twin.model_errors import (
    DEFAULT_PRESET,
    load_cell_parameters,
    ModelErrors,
    PRESETS,
    read_model_errors,
    TwinError,
)

CAMERA_RATE = 10.0  # Hz
CAMERA_DIRECTION = 165.0  # degrees, from where every disc of the shipped shapes is seen best
CAMERA_NAME = re.compile(r'[a-z]\w{0,30}', re.ASCII)


def add_preset_options(parser: Parser) -> None:
    """Add ``--preset`` and ``--file``."""
    parser.add_argument('--preset', default=DEFAULT_PRESET, metavar='NAME',
                        help=f'model errors relative to the description: {", ".join(PRESETS)}, or '
                        f'another preset of the file (default: {DEFAULT_PRESET})')
    parser.add_argument('--file', type=given_path, metavar='FILE',
                        help='file of the presets (default: config/twin.yaml)')


def chosen_model_errors(options: Namespace) -> ModelErrors:
    """Return the model errors from these options; raises as read_model_errors does."""
    from soft_continuum.user_files import description_file
    return read_model_errors(
        options.file or description_file().with_name('twin.yaml'), options.preset)


def run_until_interrupted(parser: Parser, begin: Callable[[ExitStack], None]) -> int:
    """Start something on an ExitStack, wait for Ctrl-C; return the exit status."""
    from soft_continuum.client import ClientError
    try:
        with ExitStack() as running:
            begin(running)
            threading.Event().wait()
    except (ClientError, ParameterError, TwinError) as error:
        return parser.fail(error, WRONG_USAGE)
    except OSError as error:
        return parser.fail(error)
    except KeyboardInterrupt:
        pass
    return DONE


def main(argv: Sequence[str] | None = None) -> int:
    """Serve the twin until Ctrl-C; return the exit status."""
    parser = Parser('twin', 'A simulated rig: the arm in MuJoCo, behind emulated GRBL boards or '
                    'Dynamixel servos, and Modbus boards. Its load cells and IMUs publish on '
                    'load_cells and disc_N/imu. The ground truth is published on twin/disc_poses '
                    'and twin/joint_states, which no node of the suite uses.',
                    '--params-file', '--namespace')
    add_preset_options(parser)
    parser.add_argument('--tendon-driver', choices=TENDON_MOTORS, default='grbl',
                        help='motors of the tendons: grbl (steppers) or dynamixel (servos, which '
                        'measure tension) (default: grbl)')
    parser.add_argument('--tendon-link', '--grbl-link', type=given_path, metavar='PATH',
                        help='symbolic link to create to the port of the tendons; PATH_2, PATH_3, '
                        '... for the boards of an arm with more than three tendons')
    parser.add_argument('--modbus-link', type=given_path, metavar='PATH',
                        help='the same for valves and sensors')
    parser.add_argument('--regulators', action='store_true',
                        help='vacuum regulators on an output board instead of pump and valves')
    options = parser.parse_args(argv)
    from soft_continuum.parameters.arm import arm_from_parameters
    from soft_continuum.parameters.files import parameters_text
    from soft_continuum.ros.description import load_description
    from soft_continuum.sim.twin.rig import TwinRig
    from soft_continuum.sim.twin.topics import GroundTruth, SensorTopics
    from soft_continuum.user_files import description_file

    def begin(running: ExitStack) -> None:
        ask_for_a_larger_share()  # like a rig, it does not wait for other programs
        values = load_description(*options.params_file or [description_file()],
                                  namespace=options.namespace)
        arm = arm_from_parameters(values)
        rig = running.enter_context(TwinRig(
            arm, chosen_model_errors(options), options.tendon_link or '',
            options.modbus_link or '', tendon_driver=options.tendon_driver,
            jams=bool(values['arm.jamming']), regulators=options.regulators))
        running.enter_context(GroundTruth(rig, options.namespace))
        running.enter_context(SensorTopics(rig, options.namespace))
        given = rig.parameters() | load_cell_parameters(len(arm.tendon_names))
        print(parameters_text(given, [
            f'A simulated rig, preset {options.preset}. Ctrl-C ends it. Put this into a parameter '
            'file of the nodes:']), flush=True)

    return run_until_interrupted(parser, begin)


def camera(argv: Sequence[str] | None = None) -> int:
    """Publish images until Ctrl-C; return the exit status."""
    parser = Parser('twin_camera', 'A simulated camera in front of the twin: draws the arm and '
                    'its tags, and publishes NAME/image_raw and NAME/camera_info for the node '
                    'camera of that name.',
                    '--params-file', '--namespace')
    add_preset_options(parser)
    parser.add_argument('--rate', type=number_in(0.1, 60.0, 'Hz'), default=CAMERA_RATE,
                        metavar='HZ', help=f'images per second (default: {CAMERA_RATE:g}); '
                        'drawing one takes about 0.05 s of a core')
    parser.add_argument('--name', type=_name, default='camera',
                        help='name of the camera (default: camera)')
    parser.add_argument('--direction', type=number_in(-360.0, 360.0, 'degrees'), metavar='DEGREES',
                        help='direction from the arm to the camera, for a spatial arm: angle '
                        'about z from x; fixed tags must be in view '
                        f'(default: {CAMERA_DIRECTION:g})')
    options = parser.parse_args(argv)
    require('cv2')
    from soft_continuum.estimation.sensing.layout import FRONT, layout_of, RingLayout
    from soft_continuum.ros.description import load_description
    from soft_continuum.ros.names import CAMERA
    from soft_continuum.sim.twin.camera import TwinCamera
    from soft_continuum.sim.twin.topics import Pictures
    from soft_continuum.user_files import description_file

    def begin(running: ExitStack) -> None:
        layout = layout_of(load_description(
            *options.params_file or [description_file()], node=CAMERA,
            namespace=options.namespace))
        rings, direction = isinstance(layout, RingLayout), options.direction
        if direction is not None and not rings:
            raise ParameterError('--direction is for spatial arms; a planar arm is seen from -y')
        if direction is None:
            direction = CAMERA_DIRECTION if rings else degrees(FRONT)
        camera = TwinCamera(layout, chosen_model_errors(options), radians(direction))
        running.enter_context(Pictures(camera, options.rate, options.namespace, options.name))
        print(f'Simulated pictures on {options.name}/image_raw. Ctrl-C ends it.', flush=True)

    return run_until_interrupted(parser, begin)


def _name(text: str) -> str:
    if not CAMERA_NAME.fullmatch(text):
        raise ArgumentTypeError(f'{text!r} is not a valid camera name; allowed: letters, digits '
                                'and _, such as camera_2')
    return text
