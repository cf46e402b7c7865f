# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
``ui``: the four nodes and the view; ``browser``: the view alone; ``replay``: of a recording.

Nodes and view are separate processes, so the view does not delay the nodes.
"""

from argparse import ArgumentTypeError, Namespace
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext
from functools import partial
import re
import signal
import sys
import threading
from typing import Any, TYPE_CHECKING

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
import viser

from soft_continuum.client import ClientError
from soft_continuum.client.connection import Connection
from soft_continuum.client.requests import Requests
from soft_continuum.nodes.runtime import limit_memory
from soft_continuum.parameters.arguments import DONE, given_path, Parser, WRONG_USAGE
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.ros.names import RECORDER
from soft_continuum.ui.browser.access import AccessError, open_server, page_address
from soft_continuum.ui.browser.bar import alarm_text, Bar, bar_state, BarState
from soft_continuum.ui.browser.limits import LOG
from soft_continuum.ui.browser.panel import Panel
from soft_continuum.ui.browser.scene import Scene
from soft_continuum.ui.browser.session import PageSession
from soft_continuum.ui.cli.processes import NodeProcesses
from soft_continuum.ui.cli.up import arguments_of, check_twin, chosen_nodes, start_parser

if TYPE_CHECKING:  # only a replay needs it
    from soft_continuum.lab.recordings.playback import Playback

PORT = 8080
SCENE_PERIOD = 0.04  # s
PANEL_PERIOD = 0.2  # s
DESCRIPTION_PERIOD = 2.0  # s between two requests for the description
ANSWER_TIMEOUT = 5.0  # s for a service; boards of a rig reply within a fraction of a second
DISCOVERY_TIMEOUT = 0.5  # s: running nodes are discovered before a user clicks
TOKEN = re.compile('[A-Za-z0-9_-]{12,}')


class View:
    """Updates the scene and the panel while a browser shows them."""

    def __init__(self, server: viser.ViserServer, session: PageSession, bar: Bar,
                 playback: 'Playback | None' = None, title: str = '') -> None:
        """Show that there is no arm yet; title: of a playback."""
        self._server, self._session, self._bar = server, session, bar
        self._playback, self._title = playback, title
        if playback is None:
            bar.commands = {'stop': session.stop, 'resume': session.resume}
        self._scene: Scene | None = None
        self._panel = Panel(server, session, playback)
        self._description: object = None
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        for period, update in ((SCENE_PERIOD, self._update_scene),
                               (PANEL_PERIOD, self._update_panel),
                               (DESCRIPTION_PERIOD, self._update_description)):
            session.requests.node.create_timer(period, partial(_guarded, update), clock=clock)

    @property
    def _is_looked_at(self) -> bool:
        return bool(self._server.get_clients())

    def _update_scene(self) -> None:
        description = self._session.description
        if description is not None and description != self._description:
            self._description = description
            self._server.gui.reset()
            self._server.scene.reset()
            self._scene = Scene(self._server, description)
            self._panel = Panel(self._server, self._session, self._playback)
        if self._scene is not None and self._is_looked_at:
            with self._server.atomic():
                state = self._session.state
                self._scene.show(state, self._session.ghost(state), self._session.obstacles)

    def _update_panel(self) -> None:
        state = self._session.state
        self._bar.show(bar_state(state, self._session.notices) if self._playback is None else
                       BarState('replay', 'Replay', self._title, alarm=alarm_text(state)))
        self._panel.sample(state)
        self._session.picture.look(self._is_looked_at)
        if self._is_looked_at:
            with self._server.atomic():
                self._panel.show(state)

    def _update_description(self) -> None:
        if self._description is None or self._is_looked_at:
            self._session.update_description()
            self._session.saved.follow()


def _guarded(update: Callable[[], None]) -> None:
    """Update; after a failure continue with the next update."""
    try:
        update()
    except Exception:  # such as a malformed message
        LOG.exception('the view could not be updated')


def add_view_options(parser: Parser) -> None:
    """Add --host, --port and --token."""
    parser.add_argument('--host', default='127.0.0.1',
                        help='address to listen on; other than this machine only with --token '
                        '(default: %(default)s)')
    parser.add_argument('--port', type=int, default=PORT,
                        help='port, 0 for any free one (default: %(default)s)')
    parser.add_argument('--token', type=_token,
                        help='token that browsers need: 12 or more letters, digits, - and _')


def _token(text: str) -> str:
    if not TOKEN.fullmatch(text):
        raise ArgumentTypeError(
            'a token is 12 or more letters, digits, - and _, such as the output of openssl rand '
            '-hex 16')
    return text


def ui() -> int:
    """Run the four nodes and the view until Ctrl-C; return the exit status."""
    parser = start_parser('ui', 'Start the four nodes and the recorder, and show the arm in a '
                          'browser.')
    add_view_options(parser)
    parser.add_argument('--view-only', action='store_true',
                        help='start no nodes; show running ones')
    options = parser.parse_args()
    if options.view_only and (options.twin or options.camera):
        parser.error('--view-only starts nothing; leave out --twin and --camera')
    try:
        check_twin(options)
        nodes = () if options.view_only else (*chosen_nodes(options), RECORDER)
    except ParameterError as error:
        return parser.fail(error, WRONG_USAGE)
    return run(parser, nodes, options, arguments_of(options))


def browser() -> int:
    """Run the view alone, with the arguments of a ROS node; return the exit status."""
    parser = Parser('browser', 'Show the arm in a browser. All other arguments are those of a ROS '
                    'node.')
    add_view_options(parser)
    options, rest = parser.parse_known_args()
    return run(parser, (), options, nullcontext(['browser', *rest]))


def replay(argv: Sequence[str] | None = None) -> int:
    """Show a recording until Ctrl-C; return the exit status."""
    parser = Parser('replay', 'Play a recording in a browser, with a time slider. No arm moves.',
                    '--namespace')
    parser.add_argument('recording', type=given_path, metavar='RECORDING',
                        help='directory that record wrote, or an MCAP file')
    add_view_options(parser)
    options = parser.parse_args(argv)
    from soft_continuum.lab.analysis.delimited import MeasurementError
    from soft_continuum.lab.recordings.playback import Playback
    from soft_continuum.lab.recordings.tables import bag_in
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        path = bag_in(options.recording)
        playback = Playback(path, options.namespace)
        if not playback.is_described:
            return parser.fail(f'{path} lacks the parameters of the arm, which record writes; use '
                               'report or export', WRONG_USAGE)
        if playback.damage:
            print(f'{path}: {playback.damage}; the part before is shown', file=sys.stderr)
        with ExitStack() as running, playback:
            serve_view(running, options, 'The recording', playback,
                       f'of {path.name}: {playback.duration:.1f} s. No arm moves.',
                       namespace=playback.namespace)
    except (AccessError, MeasurementError) as error:
        return parser.fail(error, WRONG_USAGE)
    except KeyboardInterrupt:
        pass
    return DONE


def run(parser: Parser, nodes: Sequence[str], options: Namespace,
        starting: AbstractContextManager[list[str]]) -> int:
    """
    Run nodes and the view until SIGINT or SIGTERM; return the status.

    starting: gives their ROS arguments, and runs while they do.
    """
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with ExitStack() as running, starting as arguments, NodeProcesses(nodes, arguments):
            serve_view(running, options, 'The arm', arguments=arguments,
                       discovery_timeout=DISCOVERY_TIMEOUT)
    except (AccessError, ClientError, ParameterError) as error:
        return parser.fail(error, WRONG_USAGE)
    except KeyboardInterrupt:
        pass
    return DONE


def serve_view(running: ExitStack, options: Namespace, what: str,
               playback: 'Playback | None' = None, title: str = '', **connecting: Any) -> None:
    """
    Serve the view with the options of add_view_options until SIGINT or SIGTERM.

    running: closes the view.  what: the subject of the line with the address.  playback, title: as
    of View.  connecting: as of Connection.  Raises AccessError, ClientError, and at its end
    KeyboardInterrupt.
    """
    token, bar = options.token or '', Bar()
    server = open_server(options.host, options.port, token, bar)
    running.callback(server.stop)
    connection = Connection('browser', timeout=ANSWER_TIMEOUT, **connecting)
    running.callback(connection.close)
    connection.requests.start(
        _show(server, connection.requests, bar, playback, title)).result()
    limit_memory()
    print(f'{what} is at {page_address(server, token)} (Ctrl-C ends it)', flush=True)
    threading.Event().wait()


async def _show(server: viser.ViserServer, requests: Requests, bar: Bar,
                playback: 'Playback | None', title: str) -> View:
    """Start to show the arm, on the thread of the node."""
    return View(server, PageSession(requests), bar, playback, title)
