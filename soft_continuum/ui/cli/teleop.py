# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``teleop``: the keyboard of a terminal as a joystick."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
import curses
import os
from pathlib import Path
import signal
import sys
from tempfile import NamedTemporaryFile, TemporaryDirectory
from textwrap import wrap
from time import monotonic, sleep
from typing import Any, TYPE_CHECKING

from soft_continuum.parameters.arguments import DONE, FAILED, NO_NODES, Parser, WRONG_USAGE
from soft_continuum.parameters.files import write_parameters
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.parameters.scalars import EXACT
from soft_continuum.ros.names import KINEMATICS, SERVO, SHAPE_SEQUENCER, TELEOP
from soft_continuum.ros.parameter_table import NODE_PARAMETERS
from soft_continuum.text import printable
from soft_continuum.ui.teleop.joystick import Keyboard, MOVE, Pad, PadState, RELEASE

if TYPE_CHECKING:
    from concurrent.futures import Future

    from soft_continuum.client.connection import Connection

JOY_PERIOD = 0.04  # s between two messages, as of a joystick that repeats
KEY_WAIT = 10  # ms for a key
DRAW_PERIOD = 0.1  # s
START_TIMEOUT = 20.0  # s for servo and teleop to start
START_POLL = 0.05  # s between two searches for them; they need the processor to start
STOP, QUIT = ' ', 'q'
CODES = {curses.KEY_RIGHT: 'right', curses.KEY_LEFT: 'left', curses.KEY_UP: 'up',
         curses.KEY_DOWN: 'down'}
HELP = (
    'space        STOP: nothing moves before r',
    'arrows       bend or move, while held',
    'u j          tip up, down (in space)',
    's t          soften, stiffen the segment',
    'n            next segment',
    'm            bend a segment / move the tip',
    '+ -          faster, slower',
    'e            emergency stop on',
    'r            emergency stop off; resume',
    'q Ctrl-C     quit',
)
KEYS = {RELEASE: 'let go of all keys', MOVE: 'hold an arrow', ': reset ': ': r ',
        '~/resume': 'r', '~/stop': 'stop'}
"""Joystick controls in messages of teleop, and the corresponding keys."""
STARTING = 'starting ...'
STALE_AFTER = 3.0  # s: teleop repeats its state once a second
BRIEF = ('space STOP; arrows move; s, t soften, stiffen; n next segment; m mode; e emergency '
         'stop; r reset; + - speed; q quit')
MAX_SHOWN = 500  # characters of a message


def main(argv: Sequence[str] | None = None) -> int:
    """Steer until q or Ctrl-C; return the exit status."""
    parser = Parser('teleop', 'Steer a running arm with the keyboard of this terminal. Starts the '
                    'nodes servo and teleop unless they run.',
                    '--namespace', '--params-file', '--timeout')
    options = parser.parse_args(argv)
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        return parser.fail('this needs the keyboard of a terminal; for a joystick start the nodes '
                           'with: up --teleop', WRONG_USAGE)
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.default_int_handler)
    from soft_continuum.client import ClientError, NodesMissingError
    from soft_continuum.client.connection import Connection
    try:
        connection = Connection(f'keyboard_{os.getpid()}', options.namespace, options.timeout)
    except ClientError as error:
        return parser.fail(error)
    try:
        connection.requests.start(connection.requests.observe()).result()
        print(STARTING, end='\r', flush=True)
        with _steering(connection, options.params_file) as log:
            return _steer(parser, connection, log)
    except ParameterError as error:
        return parser.fail(error, WRONG_USAGE)
    except ClientError as error:
        return parser.fail(error, NO_NODES if isinstance(error, NodesMissingError) else FAILED)
    except curses.error as error:
        return parser.fail(f'this terminal cannot be used: {error}; is TERM set?')
    except KeyboardInterrupt:
        return DONE
    finally:
        connection.close()


@contextmanager
def _steering(connection: 'Connection', files: Sequence[Path]) -> Iterator[Path]:
    """
    Run servo and teleop unless they run, with the description of the running arm.

    Yield the file of their output.  Raises ParameterError, and ClientError.
    """
    from soft_continuum.ros.names import running_nodes
    from soft_continuum.ui.cli.processes import NodeProcesses
    running = running_nodes(connection.node, (SERVO, TELEOP, SHAPE_SEQUENCER))
    requests, missing = connection.requests, [n for n in (SERVO, TELEOP) if not running[n]]
    space = connection.node.get_namespace()
    with TemporaryDirectory(prefix='soft_continuum_') as directory, NamedTemporaryFile(
            dir=directory) as log:
        arguments = ['teleop', '--ros-args', '-r', f'__ns:={space}']
        if SERVO in missing:
            names = {p.name for p in NODE_PARAMETERS[SERVO]}
            source = SHAPE_SEQUENCER if running[SHAPE_SEQUENCER] else KINEMATICS
            names &= {p.name for p in NODE_PARAMETERS[source]}
            values = requests.start(requests.parameters(source, sorted(names))).result()
            path = Path(directory) / 'arm.yaml'
            write_parameters(path, values, ['The running arm.'], digits=EXACT)
            arguments += ['--params-file', str(path)]
        for file in files:
            arguments += ['--params-file', str(file)]
        with NodeProcesses(missing, arguments, log.fileno()):
            yield Path(log.name)


def _steer(parser: Parser, connection: 'Connection', log: Path) -> int:
    """Steer until q; return the exit status."""
    from soft_continuum.client import ClientError
    requests = connection.requests
    begin = monotonic()
    while not connection.node.count_publishers(f'{TELEOP}/state'):
        if monotonic() - begin > START_TIMEOUT:
            lines = log.read_text(encoding='utf-8', errors='replace').splitlines()[-3:]
            return parser.fail(f'teleop did not start: {" ".join(lines)}')
        sleep(START_POLL)
    try:
        values = requests.start(requests.parameters(
            TELEOP, [p.name for p in NODE_PARAMETERS[TELEOP]])).result()
    except ClientError as error:
        return parser.fail(f'teleop does not answer: {error}')
    print(' ' * len(STARTING), end='\r', flush=True)
    return int(curses.wrapper(_Screen(connection, Pad.from_parameters(values)).run))


class _Screen:
    """Reads keys, publishes them as a joystick, shows the messages of teleop."""

    def __init__(self, connection: 'Connection', pad: Pad) -> None:
        from sensor_msgs.msg import Joy

        from soft_continuum.ros.entries import EVERY_STATE, STREAM, subscribe_unguarded
        from soft_continuum_interfaces.msg import TeleopState
        self._connection, self._pad, self._keyboard = connection, pad, Keyboard()
        self._state: Any = None
        self._heard = 0.0  # s (steady)
        self._note = ''  # outcome of a STOP

        async def join() -> Any:
            node = connection.node
            subscribe_unguarded(node, TeleopState, f'{TELEOP}/state', self._on_state, EVERY_STATE)
            return node.create_publisher(Joy, 'joy', STREAM)

        self._joy = connection.requests.start(join()).result()

    def _on_state(self, state: Any) -> None:
        self._state, self._heard = state, monotonic()

    def run(self, window: Any) -> int:
        """Run until q or Ctrl-C."""
        window.timeout(KEY_WAIT)
        if curses.has_colors():
            curses.use_default_colors()
        curses.curs_set(0)
        published = drawn = 0.0
        before = None
        try:
            while True:
                now = monotonic()
                code = window.getch()
                while code != curses.ERR:
                    key = CODES.get(code, chr(code).lower() if 0 <= code < 128 else '')
                    if key == QUIT:
                        return DONE
                    if key == STOP:
                        self._stop()
                    else:
                        self._note = ''
                    self._keyboard.press(key, monotonic())
                    window.nodelay(True)
                    code = window.getch()
                window.timeout(KEY_WAIT)
                now = monotonic()
                controls = self._keyboard.controls(now)
                if controls != before or now - published >= JOY_PERIOD:
                    before, published = controls, now
                    self._publish(controls)
                if now - drawn >= DRAW_PERIOD:
                    drawn = now
                    self._draw(window)
        finally:
            self._keyboard.release()
            self._publish(self._keyboard.controls(monotonic()))

    def _publish(self, controls: PadState) -> None:
        from sensor_msgs.msg import Joy
        axes, buttons = self._pad.write(controls)
        message = Joy(axes=axes, buttons=buttons)
        node = self._connection.node
        message.header.stamp = node.get_clock().now().to_msg()
        node.executor.create_task(self._joy.publish, message)

    def _stop(self) -> None:
        """Request a stop like any client; it does not need teleop."""
        from soft_continuum.client import ClientError

        def stopped(future: 'Future[str]') -> None:
            try:
                self._note = f'STOP: {future.result()}'
            except ClientError as error:
                self._note = f'STOP failed: {error}'

        requests = self._connection.requests
        requests.start(requests.stop()).add_done_callback(stopped)

    def _draw(self, window: Any) -> None:
        height, width = window.getmaxyx()
        window.erase()
        for row, line in enumerate(screen_lines(
                self._text(), self._keyboard.speed, height, width - 1)):
            with suppress(curses.error):  # the window became smaller meanwhile
                window.addnstr(row, 0, line, width - 1)
        window.refresh()

    def _text(self) -> tuple[str, str]:
        """Return what is steered, and its status."""
        state = self._state
        if state is None or monotonic() - self._heard > STALE_AFTER:
            return '', 'teleop does not answer; space still stops'
        what = (f'segment {state.segment or "none"}' if state.mode == state.BENDING else
                f'tip, with segment {state.segment or "none"}')
        message = f'{self._note}; {state.message}' if self._note else state.message
        return what + (', held' if state.enabled else ''), in_keys(printable(message, MAX_SHOWN))


def in_keys(message: str) -> str:
    """Return a message of teleop with keys in place of joystick controls."""
    for control, key in KEYS.items():
        message = message.replace(control, key)
    return message


def screen_lines(text: tuple[str, str], speed: float, height: int, width: int) -> list[str]:
    """
    Return the lines that fit on a screen of this size, most important first.

    text: what is steered, and its status.  speed: fraction of full speed.
    """
    what, message = text
    lines = [f'teleop  {what}', f'speed {100.0 * speed:.0f} %', '',
             *wrap(message, width), '']
    if height < len(lines) + len(HELP):
        lines = [line for line in lines if line]
        return [*lines, *wrap(BRIEF, width)][:height]
    return [*lines, *HELP]
