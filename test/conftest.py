# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Which tests run: all, or with ``--quick`` those that take little time."""

from contextlib import suppress
import gc
import os
from pathlib import Path

import pytest

# As the program and the benchmarks do, before numpy is imported: in matrices this small, threads
# only wait for each other, and on a busy machine that takes most of the time.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

with suppress(ImportError, AttributeError):  # an older hypothesis knows no such thing
    from hypothesis.internal.conjecture import providers

    # It draws numbers of whatever modules of ours are imported by then: in every worker others.
    providers._get_local_constants = providers.Constants

SLOW = ('browser', 'client', 'commands', 'hardware', 'nodes', 'test_installation.py',
        'test_examples.py', 'analysis/test_commands.py', 'analysis/test_identification.py',
        'mechanics/test_elastica.py', 'mechanics/test_kernel.py', 'mechanics/test_mujoco.py',
        'mechanics/test_spatial_tip.py', 'study', 'twin')
"""Tests below these start nodes, devices, programs or other solvers, or run whole analyses."""


@pytest.fixture(scope='module', autouse=True)
def _no_saved_shapes(tmp_path_factory):
    """Give each module a file of saved shapes of its own, and leave that of the user alone."""
    os.environ['XDG_CONFIG_HOME'] = str(tmp_path_factory.mktemp('config'))


@pytest.hookimpl(hookwrapper=True)
def pytest_collection():
    """Collect thousands of tests without looking again and again for what could be freed."""
    gc.disable()
    yield
    gc.enable()
    gc.freeze()


def pytest_addoption(parser):
    parser.addoption('--quick', action='store_true',
                     help='leave out tests of nodes, devices, programs and whole analyses')


def pytest_collection_modifyitems(config, items):
    if not config.getoption('--quick'):
        return
    here = Path(__file__).parent
    left_out = [item for item in items
                if item.path.relative_to(here).as_posix().startswith(SLOW)]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if item not in left_out]
