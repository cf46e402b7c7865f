# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Runs the nodes of an arm as separate processes, without launch_ros: ``./run up``.

It takes the arguments of launch/bringup.launch.py.
"""

from argparse import Namespace
import atexit
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
import subprocess
from tempfile import NamedTemporaryFile, TemporaryDirectory
from time import monotonic, sleep

from ament_index_python.packages import get_packages_with_prefixes
from rclpy.exceptions import InvalidNamespaceException
from rclpy.validate_namespace import validate_namespace

from soft_continuum.mechanics.arm import Arm
from soft_continuum.mechanics.constant_curvature import fully_actuated
from soft_continuum.nodes.runtime import Signals
from soft_continuum.parameters.arguments import DONE, FAILED, Parser, WRONG_USAGE
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.files import parameters_text
from soft_continuum.parameters.overrides import Overrides
from soft_continuum.parameters.parameter import ParameterError, Value
from soft_continuum.parameters.scalars import EXACT
from soft_continuum.ros.description import check_parameter_files, load_arm, load_description
from soft_continuum.ros.names import (
    CAMERA,
    HARDWARE,
    JAMMING_VALVES,
    KINEMATICS,
    NODES,
    SERVO,
    SHAPE_SEQUENCER,
    TELEOP,
    TWIN,
    TWIN_CAMERA,
)
from soft_continuum.ros.parameter_table import ALL_PARAMETERS
from soft_continuum.sim.emulators.tendon_motors import (
    board_links,
    driving_parameters,
    TENDON_MOTORS,
)
from soft_continuum.sim.twin.model_errors import DEFAULT_PRESET, load_cell_parameters, PRESETS
from soft_continuum.ui.cli.processes import Child, end_processes, NodeProcesses
from soft_continuum.user_files import description_file

DRIVERS = ('tendon_driver', 'jamming_driver')
STEERING = (SERVO, TELEOP)
ALL, RIG, WORKSTATION = 'all', 'rig', 'workstation'
COMPUTERS = (ALL, RIG, WORKSTATION)
COMPUTER_HELP = ('nodes to start: those that own devices (rig), the others (workstation), or all')
PERIOD = 0.05  # s between two checks of processes
TWIN_TIMEOUT = 120.0  # s: it imports MuJoCo, and makes the model of the arm
NO_OTHER_CAMERA: dict[str, Value] = {'camera.source': '', 'camera.calibration': ''}
CAMERA_RATE = 5  # Hz of the images: drawing and processing one takes 0.1 s of a core


def start_parser(verb: str, description: str) -> Parser:
    """Return a parser with the options of a verb that starts the nodes."""
    parser = Parser(verb, description, '--namespace', '--params-file')
    table = {p.name: p for p in ALL_PARAMETERS}
    for name in DRIVERS:
        parser.add_argument(f'--{name.removesuffix("_driver")}-driver',
                            choices=table[name].choices, help=table[name].description)
    parser.add_argument('--computer', choices=COMPUTERS, default=ALL,
                        help=f'{COMPUTER_HELP} (default: all)')
    add_twin_options(parser)
    parser.add_argument('--teleop', action='store_true',
                        help='also start the nodes servo and teleop, to steer with a joystick')
    return parser


def description_files(options: Namespace) -> list[str | Path]:
    """Return the parameter files from the options, or that of the paper's arm."""
    return [*options.params_file] or [description_file()]


def check_launch(namespace: str, files: Sequence[str | Path], packages: Sequence[str] = (),
                 nodes: Sequence[str] = NODES) -> None:
    """
    Check everything that a launch file starts before the start.

    Raises ParameterError for an invalid namespace, for a parameter file that the ``nodes`` would
    refuse, and for a missing one of the ROS ``packages``.
    """
    try:
        validate_namespace('/' + namespace)
    except InvalidNamespaceException as error:
        raise ParameterError(f'namespace {namespace!r} is not valid in ROS: '
                             f'{str(error).splitlines()[0]}') from None
    check_parameter_files(start_arguments(namespace, files), nodes)
    for package in packages:
        if package not in get_packages_with_prefixes():
            raise ParameterError(
                f'the ROS package {package} is not installed; on Ubuntu, install it with: '
                f'sudo apt install ros-jazzy-{package.replace("_", "-")}')


def start_arguments(namespace: str, files: Sequence[str | Path]) -> list[str]:
    """Return the arguments of nodes of a namespace with parameter files."""
    return ['--ros-args', *['-r', f'__ns:=/{namespace}'] * bool(namespace),
            *(word for path in files for word in ('--params-file', str(path)))]


def _namespace(options: Namespace) -> str:
    return (options.namespace or '').strip('/')


def asked_file(files: Sequence[str | Path], asked: Mapping[str, Value]) -> Path:
    """
    Write parameters that override those of all ``files``, for every node, to another file.

    It is there until this process ends.  An argument ``-p`` would not win over the section of a
    node, nor would a section for it win over ``/**``: see parameters.overrides.
    """
    section = Overrides(*files).fresh_section()
    with NamedTemporaryFile('w', prefix='soft_continuum_', suffix='.yaml', encoding='utf-8',
                            delete=False) as file:
        file.write(parameters_text(asked, ['Options of the start command; they override the other '
                                           'files.'],
                                   digits=EXACT, section=section))
    atexit.register(Path(file.name).unlink, missing_ok=True)
    return Path(file.name)


def nodes_of(files: Sequence[str | Path], namespace: str = '') -> tuple[str, ...]:
    """Return the nodes that drive the described arm; raises ParameterError."""
    values = load_description(*files, node=KINEMATICS, namespace=namespace)
    return nodes_for(arm_from_parameters(values), bool(values['arm.jamming']))


def nodes_for(arm: Arm, jamming: bool) -> tuple[str, ...]:
    """
    Return the nodes that drive an arm, with jamming or not.

    Without jamming no segment is switched, and too few tendons cannot set shapes.
    """
    left_out = {JAMMING_VALVES: not jamming,
                SHAPE_SEQUENCER: not (jamming or fully_actuated(arm))}
    return tuple(name for name in NODES if not left_out.get(name))


def chosen_nodes(options: Namespace) -> tuple[str, ...]:
    """Return the nodes that the options of start_parser ask for, as nodes_of."""
    nodes = nodes_of(description_files(options), _namespace(options))
    return nodes_on(options.computer, (
        *nodes, *[CAMERA] * options.camera, *STEERING * options.teleop))


def nodes_on(computer: str, nodes: Iterable[str]) -> tuple[str, ...]:
    """Return the nodes that belong on one of COMPUTERS."""
    return tuple(name for name in nodes
                 if computer == ALL or (name in HARDWARE) == (computer == RIG))


def check_twin(options: Namespace) -> None:
    """Raise ParameterError for options of start_parser that contradict ``--twin``."""
    if options.twin and options.jamming_driver:
        raise ParameterError('--twin brings its own boards; leave out --jamming-driver')
    if options.twin and options.computer == WORKSTATION:
        raise ParameterError('--twin brings the boards of a rig; start it on that computer, with '
                             '--computer rig')


@contextmanager
def arguments_of(options: Namespace) -> Iterator[list[str]]:
    """
    Yield the options of start_parser as arguments of the nodes, with the program.

    Meanwhile the twin runs if requested, see twin_process.
    """
    files = description_files(options)
    with twin_process(options.twin, files, _namespace(options),
                      camera=options.camera, tendon_driver=options.tendon_driver) as driving:
        asked = {name: value for name in DRIVERS if (value := getattr(options, name))} | driving
        if asked:
            files.append(asked_file(files, asked))
        yield ['up', *start_arguments(_namespace(options), files)]


def main() -> int:
    """Run until Ctrl-C or until every node has exited; return the exit status."""
    parser = start_parser('up', 'Start the nodes of an arm: all four, or those that it needs.')
    options = parser.parse_args()
    signals = Signals()
    try:
        check_twin(options)
        with (arguments_of(options) as arguments,
              NodeProcesses(chosen_nodes(options), arguments) as nodes):
            signals.starting = False
            while not signals.received and nodes.running:
                sleep(PERIOD)
    except ParameterError as error:
        return parser.fail(error, WRONG_USAGE)
    except KeyboardInterrupt:
        return DONE
    finally:
        signals.ignore()
    return DONE if signals.received else FAILED


def add_twin_options(parser: Parser) -> None:
    """Add ``--twin [PRESET]`` and ``--camera``."""
    parser.add_argument('--twin', nargs='?', const=DEFAULT_PRESET, metavar='PRESET',
                        help='also start a simulated rig in MuJoCo and drive it: '
                        f'{", ".join(PRESETS)} (without a name: {DEFAULT_PRESET})')
    parser.add_argument('--camera', action='store_true',
                        help='also start the node camera, and with --twin a simulated camera')


@contextmanager
def twin_process(preset: str | None, files: Sequence[str | Path], namespace: str, *,
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
    tendons = len(load_arm(*files, namespace=namespace).tendon_names)
    with TemporaryDirectory(prefix='soft_continuum_') as directory:
        driver = tendon_driver or 'grbl'
        if driver not in TENDON_MOTORS:
            raise ParameterError(f'the twin has no motors for --tendon-driver {driver}; it has '
                                 f'those for {", ".join(TENDON_MOTORS)}')
        ports = {'tendon': Path(directory) / driver, 'modbus': Path(directory) / 'modbus'}
        arguments = [f'--preset={preset}', f'--namespace={namespace}',
                     *(f'--params-file={path}' for path in files)]
        links = [f'--{name}-link={path}' for name, path in ports.items()]
        twin = Child(TWIN, [*arguments, *links, f'--tendon-driver={driver}'],
                     'the nodes have lost their boards', subprocess.DEVNULL)
        children = [twin]
        try:
            boards = board_links(ports['tendon'], tendons if driver == 'grbl' else 1)
            deadline = monotonic() + TWIN_TIMEOUT
            while not all(path.is_symlink() for path in (*map(Path, boards), ports['modbus'])):
                if not twin.running:
                    raise ParameterError('the twin did not start; see the lines above')
                if monotonic() > deadline:
                    raise ParameterError(f'the twin has no serial ports {TWIN_TIMEOUT:g} s after '
                                         'its start; is the computer overloaded?')
                sleep(PERIOD)
            parameters = driving_parameters(
                modbus=ports['modbus'], tendons=tendons, **{driver: ' '.join(boards)})
            parameters |= load_cell_parameters(tendons)
            if camera:
                children.append(Child(TWIN_CAMERA, [*arguments, f'--rate={CAMERA_RATE}'],
                                      'there are no more images', subprocess.DEVNULL))
                parameters |= NO_OTHER_CAMERA
            yield parameters
        finally:
            end_processes(children)
