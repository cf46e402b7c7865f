# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``twin``: a simulated rig in MuJoCo behind the serial ports of the boards that a rig has."""

from argparse import Namespace
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
import threading
from typing import TYPE_CHECKING

from soft_continuum.arguments import DONE, Parser, WRONG_USAGE
from soft_continuum.parameters.parameter import ParameterError

if TYPE_CHECKING:
    from soft_continuum.twin.differences import Differences

PRESETS = ('ideal', 'typical', 'bad')
CONFIGURATION = """\
A simulated rig, preset {preset}. Put this into a parameter file of the nodes:
/**:
  ros__parameters:
    tendon_driver: grbl
    grbl: {{port: {grbl}, steps_per_mm: {steps}}}
    jamming_driver: modbus
    modbus: {{port: {modbus}, timeout: {timeout}}}
Ctrl-C ends it.
"""


def add_preset_options(parser: Parser) -> None:
    """Add ``--preset`` and ``--file``."""
    parser.add_argument('--preset', default='typical', metavar='NAME',
                        help='in what it differs from the description: '
                        f'{", ".join(PRESETS)}, or another one of the file (default: typical)')
    parser.add_argument('--file', type=Path, metavar='FILE',
                        help='where the presets are (default: config/twin.yaml)')


def chosen_differences(options: Namespace) -> 'Differences':
    """Return what these options ask for; raises as read_differences does."""
    from soft_continuum.nodes.up import description_file
    from soft_continuum.twin.differences import read_differences
    return read_differences(
        options.file or description_file().with_name('twin.yaml'), options.preset)


def main(argv: Sequence[str] | None = None) -> int:
    """Serve the twin until Ctrl-C; return the exit status."""
    parser = Parser('twin', 'A simulated rig: the arm in MuJoCo, behind emulated GRBL and Modbus '
                    'boards. Where it really is is published on twin/disc_poses and '
                    'twin/joint_states, which no node of the suite reads.',
                    '--params-file', '--namespace')
    add_preset_options(parser)
    parser.add_argument('--grbl-link', type=Path, metavar='PATH',
                        help='a symbolic link to make to the port of the tendons')
    parser.add_argument('--modbus-link', type=Path, metavar='PATH',
                        help='the same for valves and sensors')
    options = parser.parse_args(argv)
    try:
        import_module('mujoco')
    except ImportError:
        return parser.fail("MuJoCo is not installed; install it with: pip install "
                           "'soft_continuum[twin]'")
    from soft_continuum.client.errors import ClientError
    from soft_continuum.nodes.up import description_file
    from soft_continuum.parameters.files import load_arm
    from soft_continuum.twin.differences import TwinError
    from soft_continuum.twin.rig import TwinRig
    from soft_continuum.twin.truth import Truth
    try:
        arm = load_arm(*options.params_file or [description_file()])
        differences = chosen_differences(options)
        with TwinRig(arm, differences, options.grbl_link or '', options.modbus_link or ''
                     ) as rig, Truth(rig, options.namespace):
            given = rig.parameters()
            print(CONFIGURATION.format(
                preset=options.preset, grbl=given['grbl.port'],
                steps=given['grbl.steps_per_mm'], modbus=given['modbus.port'],
                timeout=given['modbus.timeout']), flush=True)
            threading.Event().wait()
    except (ClientError, ParameterError, TwinError) as error:
        return parser.fail(error, WRONG_USAGE)
    except OSError as error:
        return parser.fail(error)
    except KeyboardInterrupt:
        pass
    return DONE
