# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Which tests run: all, or with ``--quick`` those that start neither processes nor a browser."""

from pathlib import Path

PROCESSES = ('browser', 'client', 'commands', 'hardware', 'nodes', 'test_installation.py')
"""Tests below these start nodes, devices or programs."""


def pytest_addoption(parser):
    parser.addoption('--quick', action='store_true',
                     help='leave out the tests that start nodes, devices or programs')


def pytest_collection_modifyitems(config, items):
    if not config.getoption('--quick'):
        return
    here = Path(__file__).parent
    left_out = [item for item in items
                if item.path.relative_to(here).as_posix().startswith(PROCESSES)]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if item not in left_out]
