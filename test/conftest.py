# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Which tests run, and how: ``--quick`` leaves out those that take long, and the rest makes it hard.

No test depends on how fast the machine is.  Those that do are found by force: with the cores kept
busy (``--busy N``), with every Python that starts being late (``--slow-start S``), on one core
(``--one-core``), in random order (``--random``).
"""

from collections import Counter
from contextlib import suppress
import gc
import os
from pathlib import Path
from random import Random
import subprocess
import sys
from time import time_ns

from hypothesis import HealthCheck, settings
import pytest

# As the program and the benchmarks do, before numpy is imported: in matrices this small, threads
# only wait for each other, and on a busy machine that takes most of the time.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

# What hypothesis draws does not depend on chance, and what it says not on how fast that goes.
settings.register_profile('claims', deadline=None, derandomize=True, database=None,
                          suppress_health_check=[HealthCheck.too_slow])
settings.load_profile('claims')

with suppress(ImportError, AttributeError):  # an older hypothesis knows no such thing
    from hypothesis.internal.conjecture import providers

    # It draws numbers of whatever modules of ours are imported by then: in every worker others.
    providers._get_local_constants = providers.Constants

SLOW = ('browser', 'client', 'commands', 'hardware', 'nodes', 'sim', 'test_installation.py',
        'estimation/test_anomaly_causes.py', 'estimation/test_cameras.py',
        'estimation/test_printing.py', 'estimation/test_ring_camera.py',
        'estimation/test_space.py', 'estimation/test_tag_camera.py', 'lab/test_commands.py',
        'lab/test_identification.py', 'lab/test_identification_in_space.py', 'lab/test_study.py',
        'mechanics/test_elastica.py', 'mechanics/test_inverse_problems.py',
        'mechanics/test_kernel.py', 'mechanics/test_mujoco.py', 'planning/test_aiming.py',
        'planning/test_held_shapes.py', 'planning/test_reach.py', 'sequencing/test_angle_servo.py',
        'sequencing/test_closed_loop.py', 'sequencing/test_tip_runs.py')
"""
Tests below these start nodes, devices, programs or other solvers, draw many pictures, search for
tips, plans and causes of faults, or run whole analyses and whole sequences with measurements.
"""
WAITING = ('browser', 'client', 'commands', 'nodes')
"""Tests in these mostly wait for nodes and programs; the others compute."""
COMPUTE = """
import os
parent = os.getppid()
while os.getppid() == parent:
    sum(range(1_000_000))
"""


@pytest.fixture(scope='module', autouse=True)
def _no_saved_shapes(tmp_path_factory):
    """Give each module a file of saved shapes of its own, and leave that of the user alone."""
    os.environ['XDG_CONFIG_HOME'] = str(tmp_path_factory.mktemp('config'))


@pytest.fixture(autouse=True)
def _usual_share():
    """Give back the larger share of the processor that a node or a device in this process took."""
    usual = os.getpriority(os.PRIO_PROCESS, 0)
    yield
    if os.getpriority(os.PRIO_PROCESS, 0) < usual:
        for thread in os.listdir('/proc/self/task'):
            with suppress(OSError):
                os.setpriority(os.PRIO_PROCESS, int(thread), usual)


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
    group = parser.getgroup('force', 'finding tests that depend on the speed of the machine')
    group.addoption('--busy', type=int, default=0, metavar='N',
                    help='keep the cores busy with N processes that compute')
    group.addoption('--slow-start', type=float, default=0.0, metavar='S',
                    help='let every Python that is started wait for up to S seconds')
    group.addoption('--one-core', action='store_true', help='run everything on one core')
    group.addoption('--random', action='store_true',
                    help='run modules, and the tests of each, in random order')
    group.addoption('--seed', type=int, help='the order of a run before, as its head says')


def pytest_configure(config):
    if hasattr(config, 'workerinput'):  # a worker inherits all of this
        return
    option = config.option
    if option.one_core:
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    if option.slow_start:
        os.environ['SOFT_CONTINUUM_SLOW_START'] = str(option.slow_start)
        os.environ['PYTHONPATH'] = os.pathsep.join(
            [str(Path(__file__).parent / 'support' / 'slow_start'),
             *filter(None, [os.environ.get('PYTHONPATH')])])
    if option.random and option.seed is None:
        option.seed = time_ns() // 1000 % 100_000
    for _ in range(option.busy):
        busy = subprocess.Popen([sys.executable, '-c', COMPUTE])
        config.add_cleanup(busy.kill)


def pytest_report_header(config):
    option = config.option
    force = {'busy': option.busy, 'slow start': option.slow_start, 'one core': option.one_core,
             'seed': option.seed}
    return ', '.join(f'{name}: {value}' for name, value in force.items() if value) or None


def pytest_ignore_collect(collection_path, config):
    here = Path(__file__).parent
    if config.option.quick and collection_path.is_relative_to(here):
        return collection_path.relative_to(here).as_posix().startswith(SLOW) or None
    return None


def pytest_collection_modifyitems(config, items):
    if config.option.seed is not None:
        random = Random(config.option.seed)
        modules = {item.path: random.random() for item in items}
        items.sort(key=lambda item: (modules[item.path], random.random()))
        return
    # Tests that wait run beside tests that compute; modules of many tests come first.
    kinds = [[], []]
    for path, _ in Counter(item.path for item in items).most_common():
        kinds[path.parent.name in WAITING].append(path)
    order = {path: (i + 0.5) / len(kind) for kind in kinds for i, path in enumerate(kind)}
    items.sort(key=lambda item: order[item.path])
