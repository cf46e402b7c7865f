# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The twin in a separate process, for verbs that start the nodes: ``--twin``."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
import subprocess
from tempfile import TemporaryDirectory
from time import monotonic, sleep

from soft_continuum.arguments import Parser
from soft_continuum.cli.processes import Child, end
from soft_continuum.emulators.driving import board_links, driving_parameters
from soft_continuum.emulators.tendon_motors import TENDON_MOTORS
from soft_continuum.parameters.files import load_arm
from soft_continuum.parameters.parameter import ParameterError, Value
from soft_continuum.ros.names import TWIN, TWIN_CAMERA
from soft_continuum.twin.model_errors import DEFAULT_PRESET, load_cell_parameters, PRESETS

PERIOD = 0.05  # s between two checks that it is ready
START_TIMEOUT = 120.0  # s: it imports MuJoCo, and makes the model of the arm
NO_OTHER_CAMERA: dict[str, Value] = {'camera.source': '', 'camera.calibration': ''}
RATE = 5  # Hz of the images: drawing and processing one takes 0.1 s of a core


def add_twin_options(parser: Parser) -> None:
    """Add ``--twin [PRESET]`` and ``--camera``."""
    parser.add_argument('--twin', nargs='?', const=DEFAULT_PRESET, metavar='PRESET',
                        help='also start a simulated rig in MuJoCo and drive it: '
                        f'{", ".join(PRESETS)} (without a name: {DEFAULT_PRESET})')
    parser.add_argument('--camera', action='store_true',
                        help='also start the node camera, and with --twin a simulated camera')


@contextmanager
def twin_process(preset: str | None, params_files: Sequence[Path], namespace: str, *,
                 camera: bool, tendon_driver: str | None) -> Iterator[dict[str, Value]]:
    """
    Run the twin of the described arm; yield the node parameters that drive it.

    camera: with one before it.  tendon_driver: one of TENDON_MOTORS, grbl if None.  Without a
    preset nothing is started and nothing yielded.  Raises ParameterError for a twin that does not
    start; it has said why by then.
    """
    if preset is None:
        yield {}
        return
    from soft_continuum.user_files import description_file
    tendons = len(load_arm(
        *params_files or [description_file()], namespace=namespace).tendon_names)
    with TemporaryDirectory(prefix='soft_continuum_') as directory:
        driver = tendon_driver or 'grbl'
        if driver not in TENDON_MOTORS:
            raise ParameterError(f'the twin has no motors for --tendon-driver {driver}; it has '
                                 f'those for {", ".join(TENDON_MOTORS)}')
        ports = {'tendon': Path(directory) / driver, 'modbus': Path(directory) / 'modbus'}
        arguments = [f'--preset={preset}', f'--namespace={namespace}',
                     *(f'--params-file={path}' for path in params_files)]
        links = [f'--{name}-link={path}' for name, path in ports.items()]
        twin = Child(TWIN, [*arguments, *links, f'--tendon-driver={driver}'],
                     'the nodes have lost their boards', subprocess.DEVNULL)
        children = [twin]
        try:
            boards = board_links(ports['tendon'], tendons if driver == 'grbl' else 1)
            deadline = monotonic() + START_TIMEOUT
            while not all(path.is_symlink() for path in (*map(Path, boards), ports['modbus'])):
                if not twin.running:
                    raise ParameterError('the twin did not start; see the lines above')
                if monotonic() > deadline:
                    raise ParameterError(f'the twin has no serial ports {START_TIMEOUT:g} s after '
                                         'its start; is the computer overloaded?')
                sleep(PERIOD)
            parameters = driving_parameters(
                modbus=ports['modbus'], tendons=tendons, **{driver: ' '.join(boards)})
            parameters |= load_cell_parameters(tendons)
            if camera:
                children.append(Child(TWIN_CAMERA, [*arguments, f'--rate={RATE}'],
                                      'there are no more images', subprocess.DEVNULL))
                parameters |= NO_OTHER_CAMERA
            yield parameters
        finally:
            end(children)
