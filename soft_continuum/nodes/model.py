# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The compiled model in a node: loaded while the node is already up."""

from collections.abc import Callable
from functools import cache
import gc
import threading

from rclpy.node import Node

from soft_continuum.mechanics._compile import is_compiled
from soft_continuum.mechanics.statics import warm_up
from soft_continuum.nodes.threads import on_ros_thread

SLACK_ALLOWANCE = 1e-4
"""m of pull that rope and guides absorb; the model's inextensible tendons would buckle the arm."""


def loading() -> str:
    """Return what a node does before it can work."""
    return ('loading the model' if is_compiled() else
            'compiling the model, this once; it takes about half a minute')


@cache
def _freeze() -> None:
    """
    Keep the garbage collector from what numba has made: it takes 0.2 s, in which nothing runs.

    Once in a process: what is frozen is never collected.
    """
    gc.freeze()


def load_model(node: Node, loaded: Callable[[], None] | None = None) -> None:
    """
    Load the compiled model on a thread of its own; compiling takes tens of seconds.

    ``loaded`` is called on the thread of ROS.  The thread does not keep a process from ending.
    """
    def load() -> None:
        warm_up()
        _freeze()
        if loaded is not None:
            on_ros_thread(node, loaded)

    threading.Thread(target=load, name='model', daemon=True).start()
