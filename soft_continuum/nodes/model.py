# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Loading of the compiled model while the node already runs."""

from collections.abc import Callable, Sequence
from importlib import import_module
import threading
from typing import Any

from soft_continuum.mechanics._kernel import must_build, warm_up
from soft_continuum.mechanics.arm import Arm
from soft_continuum.mechanics.statics import Statics
from soft_continuum.nodes.threads import on_ros_thread


def loading() -> str:
    """Return the status text while the model loads."""
    return ('compiling the model, only on first use; it takes up to a minute' if must_build() else
            'loading the model')


def load_model(node: Any, arm: Arm, loaded: Callable[[], None] | None = None,
               later: Sequence[str] = ()) -> None:
    """
    Load the compiled model on a thread of its own; compiling takes tens of seconds.

    arm: the described one.  ``loaded`` is called on the thread of ROS.  later: modules to import
    afterwards, so that their first use does not wait.  The thread does not prevent a process from
    ending.
    """
    def load() -> None:
        try:
            warm_up()
            for module in Statics(arm).late_imports:  # else the first motion waits for them
                import_module(module)
        except Exception as error:  # of numba, a compiler, a disk
            on_ros_thread(node, node.status.alarm, 'model', 'the model cannot be loaded: '
                          f'{type(error).__name__}: {error}; see soft_continuum doctor')
            return
        if loaded is not None:
            on_ros_thread(node, loaded)
        for module in later:
            import_module(module)

    threading.Thread(target=load, name='model', daemon=True).start()
