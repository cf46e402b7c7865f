# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A ROS node on a separate thread, for programs that do not spin."""

from collections.abc import Sequence
import os
import threading
import traceback

import rclpy
from rclpy._rclpy_pybind11 import RCLError
from rclpy.context import Context
from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from soft_continuum.client.errors import ClientError, NoAnswerError
from soft_continuum.client.requests import Requests
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.ros.entries import make_executor
from soft_continuum.ros.environment import (
    choose_own_network,
    CLIENT,
    require_log_folder,
    security_problem,
    wait_until_up,
    with_enclave,
)

CLOSE_TIMEOUT = 10.0  # s within which a running callback has to return


class Connection:
    """
    A node in a separate context, spun by a thread, and its ``requests``.

    Everything that creates or sends is a coroutine of ``requests`` and runs on that thread: rclpy
    may drop a response that arrives while another thread still registers the request.
    """

    def __init__(self, name: str, namespace: str = '', timeout: float = 10.0,
                 discovery_timeout: float | None = None, arguments: Sequence[str] = ()) -> None:
        """
        Join the ROS graph as ``name``.

        timeout, discovery_timeout: as for Requests, s.  arguments: ROS arguments of the process.

        Raises ClientError for a namespace that is not valid in ROS, if logs cannot be written, and
        if keys required by SROS 2 are missing.
        """
        choose_own_network()
        wait_until_up()
        self._open = True
        self._context = Context()
        try:
            require_log_folder(os.environ)
            rclpy.init(args=with_enclave(arguments, CLIENT, namespace), context=self._context,
                       signal_handler_options=SignalHandlerOptions.NO)
            # Without rosout and parameter services the start takes half the time.
            self.node = Node(name, namespace='/' + namespace.strip('/'), context=self._context,
                             enable_rosout=False, start_parameter_services=False)
        except ParameterError as error:
            raise ClientError(str(error)) from None
        except NameValidationException as error:
            self._context.try_shutdown()
            raise ClientError(f'namespace {namespace!r} is not valid in ROS: '
                              f'{str(error).splitlines()[0]}') from None
        except RCLError as error:
            self._context.try_shutdown()
            if problem := security_problem(error, os.environ):
                raise ClientError(problem) from None
            raise
        self.requests = Requests(self.node, timeout, discovery_timeout)
        self._executor = make_executor(self._context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._spin, name='soft_continuum', daemon=True)
        self._thread.start()

    def _spin(self) -> None:
        while self._open:
            try:
                self._executor.spin_once(timeout_sec=0.2)
            except Exception:  # such as a malformed message
                self.node.get_logger().error(traceback.format_exc())

    def close(self) -> None:
        """
        End the thread and leave the graph; a second call does nothing.

        Raises NoAnswerError when a callback does not return.
        """
        if self._open:
            try:
                self.requests.start(self.requests.close()).result(CLOSE_TIMEOUT)
            finally:
                self._open = False
                self._thread.join(CLOSE_TIMEOUT)
                if self._thread.is_alive():  # its resources must remain
                    raise NoAnswerError('a callback of this program has not returned for '
                                        f'{CLOSE_TIMEOUT:g} s: its node is not closed')
                self._executor.shutdown()
                self.requests.destroy()
                self.node.destroy_node()
                self._context.try_shutdown()
