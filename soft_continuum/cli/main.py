# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
``python -m soft_continuum``: reads the command line, says how it went by the exit status.

Little is imported before it is needed: ``stop`` must not wait.
"""

import argparse
from collections.abc import Callable, Sequence
from importlib import import_module
from math import isfinite, radians
import os
import re
import signal
import sys
from typing import Any, NoReturn

DONE, FAILED, BAD_USAGE, NO_NODES, INTERRUPTED = 0, 1, 2, 3, 130
TOOLS = {
    'doctor': 'check a rig step by step, without nodes',
    'calibrate': 'calibrate a rig',
    'characterize': 'from force-displacement curves to bending stiffness',
    'identify': 'identify parameters of the arm from measurements',
    'validate': 'compare the model with measurements',
    'converge': 'show how the model converges with its resolution',
    'workspace': 'compute what the tip can reach',
    'record': 'record a run into files',
    'report': 'turn a recording into one page',
}
"""The commands of soft_continuum.commands, which have options of their own."""


def angles(text: str) -> tuple[float, ...]:
    """Read ``10,20,30`` in degrees; return rad."""
    try:
        values = tuple(radians(float(part)) for part in text.split(','))
    except ValueError:
        values = (float('nan'),)
    if not all(isfinite(value) for value in values):
        raise argparse.ArgumentTypeError(
            f'{text!r} given; needed: a bending angle in degrees for each segment, such as '
            '10,20,30')
    return values


def number(low: float, high: float, unit: str) -> Callable[[str], float]:
    """Return a reader of a number between bounds."""
    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = float('nan')
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(
                f'{text!r} given; allowed: {low:g} to {high:g} {unit}')
        return value
    return read


def segment(text: str) -> int:
    """Read the number of a segment."""
    if not (text.isdecimal() and int(text) > 0):
        raise argparse.ArgumentTypeError(
            f'{text!r} given; needed: the number of a segment, 1 at the base')
    return int(text)


def segment_or_all(text: str) -> int | None:
    """Read the number of a segment, or ``all`` as None."""
    if text != 'all' and not text.isdecimal():
        raise argparse.ArgumentTypeError(
            f'{text!r} given; needed: the number of a segment, 1 at the base, or all')
    return None if text == 'all' else segment(text)


def make_parser() -> tuple[argparse.ArgumentParser, dict[str, argparse.ArgumentParser]]:
    """Return the parser, and that of each command."""
    common = argparse.ArgumentParser(add_help=False, argument_default=argparse.SUPPRESS)
    common.add_argument('--namespace', metavar='NAME', help='namespace of the nodes, such as left')
    common.add_argument('--timeout', type=number(0.01, 3600.0, 's'), metavar='S',
                        help='longest wait for nodes to be found and to answer (default: 5 s)')
    common.add_argument('--json', action='store_true',
                        help='print JSON, one document per line, in SI units')
    parser = argparse.ArgumentParser(
        prog='soft_continuum', allow_abbrev=False, parents=[common],
        description='Operate a running arm, and the tools around it.',
        epilog='exit status: 0 done, 1 refused or failed, 2 wrong usage, 3 no nodes, '
               '130 interrupted')
    commands = parser.add_subparsers(dest='command', metavar='COMMAND', required=True)
    parsers: dict[str, argparse.ArgumentParser] = {}

    def add(name: str, text: str, **options: Any) -> argparse.ArgumentParser:
        parsers[name] = commands.add_parser(name, help=text, description=text, allow_abbrev=False,
                                            **({'parents': [common]} | options))
        return parsers[name]

    add('shapes', 'list the shape library')
    run = add('run', 'set shapes one after the other; Ctrl-C cancels')
    run.add_argument('shapes', nargs='*', metavar='SHAPE', help='names in the shape library')
    run.add_argument('--angles', action='append', type=angles, default=[], metavar='A,B,C',
                     help='bending angle of each segment, base first, degrees, to set after the '
                     'named shapes; may be repeated')
    run.add_argument('--hold', type=number(0.0, 86400.0, 's'), default=0.0, metavar='S',
                     help='how long each shape is held (default: 0 s)')
    add('stiffen', 'evacuate a segment, or all, and wait until it is stiff').add_argument(
        'segment', type=segment_or_all, metavar='N|all', help='1 at the base')
    add('soften', 'vent a segment and wait until it is soft').add_argument(
        'segment', type=segment, metavar='N', help='1 at the base')
    jog = add('jog', 'pull the tendons a little further, while a segment is soft')
    for side in ('right', 'left'):
        jog.add_argument(f'--{side}', type=number(-1000.0, 1000.0, 'mm'), default=0.0,
                         metavar='MM', help=f'pull of the {side} tendon, negative: let out')
    add('status', 'show the state of the arm and its nodes')
    add('watch', 'show the state of the arm twice per second, until Ctrl-C')
    add('stop', 'stop all motion, holding tension')
    add('resume', 'allow motion after a stop')
    add('reference', 'take the present pulls as those of the straight arm')
    add('reset', 'tell kinematics that the arm is straight')
    add('completion', 'print a script for tab completion: source <(soft_continuum completion bash)'
        ).add_argument('what', choices=('bash', 'shapes'))
    for name, text in TOOLS.items():
        add(name, text, parents=[], add_help=False)
    return parser, parsers


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command; return the exit status."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    if arguments and arguments[0] in TOOLS:
        tool = import_module(f'soft_continuum.commands.{arguments[0]}')
        signal.signal(signal.SIGINT, signal.default_int_handler)
        status: int = tool.main(arguments[1:])
        return status
    parser, parsers = make_parser()
    options = parser.parse_args(_joined(arguments))
    if options.command in TOOLS:
        parser.error(f'{options.command} comes first: soft_continuum {options.command} ...')
    if options.command == 'run' and not options.shapes + options.angles:
        parsers['run'].error('give a SHAPE or --angles; `soft_continuum shapes` lists the names')
    if options.command == 'jog' and not (options.right or options.left):
        parsers['jog'].error('give --right or --left, or both')
    if options.command == 'completion' and options.what == 'bash':
        from soft_continuum.cli.completion import bash_script
        print(bash_script(parsers), end='')
        return DONE
    for number_ in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number_, _on_interrupt)
    try:
        return _operate(options)
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:  # the reader has seen enough
        return DONE


def _operate(options: argparse.Namespace) -> int:
    from soft_continuum.cli.operate import COMMANDS, Output
    output = Output(options.command, getattr(options, 'json', False))
    try:
        from soft_continuum.client.arm import Arm
        from soft_continuum.client.errors import ClientError, NodesMissingError
    except ModuleNotFoundError as error:
        output.fail(f'ROS 2 is not set up here ({error}); source it, or start with ./run exec')
        return FAILED
    try:
        with Arm(getattr(options, 'namespace', ''), timeout=getattr(options, 'timeout', 5.0)
                 ) as arm:
            return COMMANDS[options.command](arm, options, output)
    except NodesMissingError as error:
        output.fail(str(error))
        return NO_NODES
    except ClientError as error:
        output.fail(str(error))
        return FAILED


def _joined(arguments: list[str]) -> list[str]:
    """Join ``--angles -10,20`` to one word, which argparse would take for an option."""
    joined: list[str] = []
    for word in arguments:
        if joined and joined[-1] == '--angles' and re.match(r'-[\d.]', word):
            joined[-1] += f'={word}'
        else:
            joined.append(word)
    return joined


def _on_interrupt(*_: object) -> NoReturn:
    """Interrupt once; a second time leave at once."""
    for number_ in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number_, lambda *_: os._exit(INTERRUPTED))
    raise KeyboardInterrupt
