# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Which tests run, and in which order: all, or with ``--quick`` those that take little time."""

from pathlib import Path

SLOW = ('browser', 'client', 'commands', 'hardware', 'nodes', 'test_installation.py',
        'test_examples.py', 'analysis/test_commands.py', 'analysis/test_identification.py',
        'mechanics/test_elastica.py', 'mechanics/test_mujoco.py', 'twin')
"""Tests below these start nodes, devices, programs or other solvers, or run whole analyses."""


def pytest_addoption(parser):
    parser.addoption('--quick', action='store_true',
                     help='leave out tests of nodes, devices, programs and whole analyses')


def pytest_collection_modifyitems(config, items):
    here = Path(__file__).parent
    slow, fast = [], []
    for item in items:
        (slow if item.path.relative_to(here).as_posix().startswith(SLOW) else fast).append(item)
    if config.getoption('--quick'):
        config.hook.pytest_deselected(items=slow)
        slow = []
    items[:] = slow + fast  # what takes long comes first: so both processes end together
