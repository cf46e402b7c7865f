# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The enclave of a process: the name by which SROS 2 finds its keys and permissions.

Without SROS 2 it is unused.  A process has one enclave, given by its arguments before it has a
node.
"""

from collections.abc import Sequence
import re

from soft_continuum.parameters.overrides import full_name_of

ENCLAVE = '--enclave', '-e'
NAME = re.compile(r'(/\w+)+', re.ASCII)
CLIENT, VIEWER, INPUTS = 'client', 'viewer', 'inputs'
"""Enclaves of programs other than the nodes: command, view and sensor clients."""


def with_enclave(arguments: Sequence[str], name: str, namespace: str = '') -> list[str]:
    """
    Return the arguments of a process with its enclave, unless they have one.

    name: of its node, where no argument gives it another; likewise namespace.
    """
    words = list(arguments)
    if not {*ENCLAVE} & {*words}:
        path = full_name_of(words, name, namespace)
        if NAME.fullmatch(path):  # else ROS reports the invalid namespace
            words += ['--ros-args', ENCLAVE[0], path]
    return words
