# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Which tests run: those below SLOW only with ``--all``, or when they are asked for by path.

They wait for devices, processes and browsers in real time, some ten minutes in all.
"""

from pathlib import Path

SLOW = ('browser', 'client', 'commands', 'nodes/test_documents.py', 'nodes/test_hardware.py',
        'nodes/test_kills.py', 'nodes/test_processes.py')


def pytest_addoption(parser):
    parser.addoption('--all', action='store_true', help='run the slow tests as well')


def pytest_collection_modifyitems(config, items):
    if config.getoption('--all') or config.args_source.name != 'TESTPATHS':
        return
    here = Path(__file__).parent
    slow = [item for item in items
            if item.path.relative_to(here).as_posix().startswith(SLOW)]
    config.hook.pytest_deselected(items=slow)
    items[:] = [item for item in items if item not in slow]
