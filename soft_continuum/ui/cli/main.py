# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
``soft_continuum VERB``: every verb, the location of its function, and its call.

To add a verb, add a line to GROUPS.  A function is imported when its verb is called, so that
``stop`` does not load unneeded modules.
"""

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
import os
import signal
import sys
from typing import Any

from soft_continuum import version
from soft_continuum.parameters.arguments import DONE, FOR_NODES, INTERRUPTED, Parser
from soft_continuum.parameters.parameter import name_hint
from soft_continuum.ui.cli.operate import ACTIONS
from soft_continuum.user_files import pages

NODE = 'nodes.runtime:run'


@dataclass(frozen=True)
class Verb:
    """
    A verb.

    help: one line.  target: ``module:function`` in soft_continuum; the function reads its options
    from ``sys.argv[1:]`` and returns the exit status.  arguments: of the function.
    """

    name: str
    help: str
    target: str
    arguments: tuple[Any, ...] = ()

    @property
    def completes(self) -> bool:
        """Whether TAB may call the function: it builds a Parser before it does anything."""
        return not self.target.startswith(('ui.browser.', 'nodes.'))


def _node(name: str, text: str) -> Verb:
    return Verb(name, text, NODE, (name,))


GROUPS: Mapping[str, tuple[Verb, ...]] = {
    'start': (
        Verb('demo', "set the paper's three shapes on a simulated rig", 'ui.cli.demo:main'),
        Verb('up', 'start the nodes of an arm', 'ui.cli.up:main'),
        Verb('ui', 'start the four nodes and show the arm in a browser', 'ui.browser.main:ui'),
        Verb('browser', 'show a running arm in a browser', 'ui.browser.main:browser'),
    ),
    'operate a running arm': (
        *(Verb(name, action.help, 'ui.cli.operate:main', (name,))
          for name, action in ACTIONS.items()),
        Verb('teleop', 'steer with the keyboard', 'ui.cli.teleop:main'),
        Verb('record', 'record everything that the arm publishes', 'lab.recordings.record:main'),
        Verb('measure', 'set shapes and measure the discs for identify and validate',
             'ui.cli.measure:main'),
        Verb('save-estimate', 'save the estimated parameters of the arm',
             'ui.cli.save_estimate:main'),
    ),
    'plan, without nodes': (
        Verb('plan', 'print the plan for a tip position, step by step',
             'ui.cli.plan:main'),
    ),
    'set up a rig, while no nodes run': (
        Verb('new-arm', 'describe an arm interactively', 'lab.new_arm.description:main'),
        Verb('doctor', 'check a rig step by step; nothing moves', 'commissioning.doctor:main'),
        Verb('calibrate', 'measure a rig: vacuum, signs, steps, zero; set up servos',
             'commissioning.calibrate:main'),
        Verb('emulate', 'emulate the device of a driver: grbl, dynamixel, modbus',
             'sim.emulators.device:emulate'),
        Verb('twin', 'simulate a rig: the arm in MuJoCo with emulated boards', 'ui.cli.twin:main'),
        Verb('twin_camera', 'simulate a camera of that rig', 'ui.cli.twin:camera'),
        Verb('tags', 'write printable tags for discs and board', 'ui.cli.measure:tags'),
        Verb('policy', 'write a policy for SROS 2: access permissions over DDS',
             'ui.cli.policy:main'),
        Verb('install-service', 'start the nodes at boot with systemd',
             'ui.cli.install_service:main'),
    ),
    'analyse measurements': (
        Verb('characterize', 'fit the bending stiffness to force-displacement curves',
             'lab.analysis.characterisation:main'),
        Verb('identify', 'fit parameters of the arm to measured shapes',
             'lab.analysis.identification:main'),
        Verb('validate', 'compare the models with measured shapes',
             'lab.analysis.validation:main'),
        Verb('converge', 'check the convergence of the model with its resolution',
             'lab.analysis.convergence:main'),
        Verb('workspace', 'sample the positions that the tip reaches',
             'lab.analysis.workspace:main'),
        Verb('study', 'compare designs of arms', 'lab.study.summary:main'),
        Verb('report', 'write a one-page report of a recording', 'lab.recordings.report:main'),
        Verb('replay', 'play a recording in a browser', 'ui.browser.main:replay'),
        Verb('export', 'export a recording as CSV, MATLAB or Parquet',
             'lab.recordings.tables:export'),
    ),
    'single nodes and devices, as `ros2 run soft_continuum` names them': (
        _node('tendon_actuation', 'moves the tendons'),
        _node('jamming_valves', 'controls pump, valves and pressure sensors'),
        _node('kinematics', 'computes the shape of the arm'),
        _node('shape_sequencer', 'executes shape sequences'),
        _node('camera', 'measures the poses of the discs with printed tags'),
        _node('disc_sensors', 'converts trackers and IMUs to poses of the discs'),
        _node('servo', 'follows a moving target with the soft segment'),
        Verb('teleop_node', 'the node teleop: steers with a joystick', NODE, ('teleop',)),
        _node('recorder', 'records the topics of the arm on request'),
        Verb('grbl_emulator', 'the same as emulate grbl', 'sim.emulators.grbl:main'),
        Verb('dynamixel_emulator', 'the same as emulate dynamixel',
             'sim.emulators.dynamixel:main'),
        Verb('modbus_emulator', 'the same as emulate modbus', 'sim.emulators.modbus:main'),
    ),
    'shell': (
        Verb('completion', 'print the script for tab completion', 'ui.cli.main:completion'),
    ),
}

VERBS = {verb.name: verb for verbs in GROUPS.values() for verb in verbs}


def main(argv: Sequence[str] | None = None) -> int:
    """
    Call a verb with its options; return the exit status.

    argv: the words after the program, by default those of this process.  Common options may also
    stand before the verb.
    """
    if '_ARGCOMPLETE' in os.environ:
        return _complete()
    words = list(sys.argv[1:] if argv is None else argv)
    parser = _parser()
    parser.add_argument('verb', nargs='?', help=argparse.SUPPRESS)
    parser.add_argument('options', nargs=argparse.REMAINDER, help=argparse.SUPPRESS)
    options = parser.parse_args(words)
    if options.version:
        print(f'soft_continuum {version()}')
        return DONE
    if options.verb is None:
        parser.error('no verb given, such as status or demo')
    if options.verb not in VERBS:
        parser.error(f'unknown verb {options.verb!r}{name_hint(options.verb, VERBS)}')
    before = words[:len(words) - len(options.options) - 1]
    return call(VERBS[options.verb], [*before, *options.options])


def call(verb: Verb, options: Sequence[str]) -> int:
    """Import the function of a verb and call it; return the exit status."""
    sys.argv[1:] = options
    module, _, name = verb.target.partition(':')
    try:
        function: Callable[..., int] = getattr(import_module(f'soft_continuum.{module}'), name)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        return function(*verb.arguments)
    except ImportError as error:
        from soft_continuum.extras import remedy
        if not (text := remedy(error)):
            raise
        return Parser(verb.name, '').fail(text)
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:  # such as into head: the reader has closed the pipe
        return DONE


def completion() -> int:
    """Print the completion script of a shell."""
    parser = Parser('completion', 'Print the script for tab completion. For bash put this into '
                    '~/.bashrc: source <(soft_continuum completion bash)')
    parser.add_argument('shell', choices=('bash', 'zsh', 'fish'))
    shell = parser.parse_args().shell
    from argcomplete.shell_integration import shellcode
    print(shellcode(['soft_continuum'], shell='bash' if shell == 'zsh' else shell))
    return DONE


def _parser() -> Parser:
    width = max(map(len, VERBS))
    listing = '\n\n'.join(
        '\n'.join([f'{group}:', *(f'  {verb.name:<{width}}  {verb.help}' for verb in verbs)])
        for group, verbs in GROUPS.items())
    parser = Parser(
        '', 'Tendon-driven continuum arms with jamming segments: operate them, analyse them, set '
        'them up.\nVERB --help shows the options of a verb. Pages quoted in messages, such as '
        f'docs/index.md, are in {pages()}\n\n{listing}',
        *FOR_NODES, usage='%(prog)s VERB [OPTION]...',
        formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--version', action='store_true', help='print the version and exit')
    return parser


def _complete() -> int:
    """Print what completes the word at the cursor: a verb, or what its own parser offers."""
    from argcomplete.lexers import split_line
    words = split_line(os.environ['COMP_LINE'], int(os.environ['COMP_POINT']))[3]
    for position, word in enumerate(words[1:], start=1):
        if word in VERBS:
            os.environ['_ARGCOMPLETE'] = str(position + 1)  # the parser sees VERB and the rest
            return call(VERBS[word], []) if VERBS[word].completes else DONE
    parser = _parser()
    parser.add_argument('verb', choices=VERBS)
    parser.parse_args()
    return DONE
