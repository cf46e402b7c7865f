# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
``./run ui``: the four nodes and the view in one process; ``ros2 run soft_continuum browser``.

The view alone, which is the same program with ``--view-only``, joins nodes that run elsewhere.
"""

import argparse
from collections.abc import Sequence
import re
import sys
from time import monotonic
from typing import Any

import rclpy
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.executors import Executor
from rclpy.signals import SignalHandlerOptions
import viser

from soft_continuum.browser.door import address, DoorError, open_server
from soft_continuum.browser.node import Browser
from soft_continuum.browser.panel import Panel
from soft_continuum.browser.scene import Scene
from soft_continuum.nodes.runtime import (
    argument_error,
    check_parameter_files,
    end,
    make_executor,
    node_class,
    NODES,
    ROS_ARGUMENT_ERRORS,
    Signals,
)
from soft_continuum.nodes.up import ros_arguments
from soft_continuum.parameters.parameter import ParameterError

PORT = 8080
PERIOD = 0.04  # s between two looks at the scene
PANEL_PERIOD = 0.2  # s between two looks at the panel
LEARN_PERIOD = 5.0  # s between two questions for the description
TOKEN = re.compile('[A-Za-z0-9_-]{12,}')


class View:
    """Keeps the scene and the panel up to date while a browser looks at them."""

    def __init__(self, server: viser.ViserServer, node: Browser) -> None:
        """Show that there is no arm yet."""
        self._server, self._node = server, node
        self._scene: Scene | None = None
        self._panel = Panel(server, node, None)
        self._described: object = None
        self._next_panel = self._next_question = 0.0
        self._timer = node.create_timer(
            PERIOD, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _tick(self) -> None:
        now = monotonic()
        self._node.look_after()
        self._panel.sample()
        description = self._node.description
        looked_at = bool(self._server.get_clients())
        if now > self._next_question and (looked_at or description is None):
            self._next_question = now + (1.0 if description is None else LEARN_PERIOD)
            self._node.learn()
        if description is not None and description != self._described:
            self._described = description
            self._panel.remove()
            self._server.scene.reset()
            self._scene = Scene(self._server, description)
            self._panel = Panel(self._server, self._node, description)
        if not looked_at:
            return
        with self._server.atomic():
            if self._scene is not None:
                self._scene.show(self._node.state)
            if now > self._next_panel:
                self._next_panel = now + PANEL_PERIOD
                self._panel.show()


def parser(program: str) -> argparse.ArgumentParser:
    """Return the options of the view."""
    options = argparse.ArgumentParser(
        prog=program, allow_abbrev=False,
        description='The arm in a browser. All other options are those of ./run up.')
    options.add_argument('--host', default='127.0.0.1',
                         help='address to listen on; beyond this machine only with --token '
                         '(default: %(default)s)')
    options.add_argument('--port', type=int, default=PORT,
                         help='port, 0 for any free one (default: %(default)s)')
    options.add_argument('--token', type=_token,
                         help='what a browser has to show: 12 or more letters, digits, - and _')
    return options


def _token(text: str) -> str:
    if not TOKEN.fullmatch(text):
        raise argparse.ArgumentTypeError(
            'a token is 12 or more letters, digits, - and _, such as openssl rand -hex 16 prints')
    return text


def ui() -> int:
    """Run the four nodes and the view until Ctrl-C; return the exit status."""
    known = parser('./run ui')
    known.add_argument('--view-only', action='store_true',
                       help='start no nodes; show those that run')
    options, rest = known.parse_known_args()
    return run([] if options.view_only else list(NODES), ros_arguments(rest), options)


def browser() -> int:
    """Run the view alone, with the arguments of a ROS node; return the exit status."""
    options, rest = parser('browser').parse_known_args()
    return run([], ['browser', *rest], options)


def run(names: Sequence[str], arguments: Sequence[str], options: argparse.Namespace) -> int:
    """Run nodes and the view until SIGINT or SIGTERM; return the exit status."""
    signals, token = Signals(), options.token or ''
    nodes: list[Any] = []
    executor: Executor | None = None
    server: viser.ViserServer | None = None
    try:
        check_parameter_files(arguments, names)
        rclpy.init(args=list(arguments), signal_handler_options=SignalHandlerOptions.NO)
        executor = make_executor()
        server = open_server(options.host, options.port, token)
        for name in names:
            nodes.append(node_class(name)())
            executor.add_node(nodes[-1])
            nodes[-1].start()
        nodes.append(Browser())
        executor.add_node(nodes[-1])
        View(server, nodes[-1])
        print(f'The arm is at {address(server, token)} (Ctrl-C ends it)', flush=True)
        signals.spin(executor)
    except (DoorError, ParameterError) as error:
        print(f'{error}', file=sys.stderr)
        return 2
    except ROS_ARGUMENT_ERRORS as error:
        print(argument_error(arguments, error), file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 0
    finally:
        signals.starting = False
        end(executor, nodes)  # first of all the tendons hold
        if server is not None:
            server.stop()
    return 0
