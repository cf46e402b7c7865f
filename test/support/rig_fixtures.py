# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Fixtures of nodes, each test or module of tests in a ROS domain of its own."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import fcntl
import gc
import itertools
import os
from pathlib import Path
import tempfile
import time

import pytest

HERE = Path(__file__).resolve().parent
# Read when the first participant of a process is made.
os.environ['FASTRTPS_DEFAULT_PROFILES_FILE'] = str(HERE / 'fastdds.xml')
os.environ['FASTDDS_DEFAULT_PROFILES_FILE'] = str(HERE / 'fastdds.xml')
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'SYSTEM_DEFAULT'  # LOCALHOST would replace it

from soft_continuum.hardware import tendon_controller  # noqa: E402
from soft_continuum.hardware.dynamixel import bus, packets  # noqa: E402
from soft_continuum.hardware.dynamixel import tendons as servo_tendons  # noqa: E402
from soft_continuum.hardware.grbl import tendons as grbl_tendons  # noqa: E402
from soft_continuum.mechanics._kernel import warm_up  # noqa: E402
from soft_continuum.nodes import managed_node, tendon_control  # noqa: E402
from support.processes import Processes  # noqa: E402
from support.ros_rig import Rig  # noqa: E402

DOMAINS = range(1, 102)  # ROS 2: above these, ports overlap with those that Linux gives away
LEAVE = 20.0  # s for the last process in a domain to end on a busy machine
_turn = itertools.count()


@pytest.fixture(scope='session', autouse=True)
def _compiled() -> None:
    """Compile the solver in one worker; the others find it on the disk."""
    with open(Path(tempfile.gettempdir()) / 'soft_continuum_compile.lock', 'w') as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        warm_up()
    gc.collect()
    gc.freeze()  # else every collection looks through all that was imported


@pytest.fixture(scope='module', autouse=True)
def _patient() -> Iterator[None]:
    """
    Let the nodes in this process go on when a busy machine kept them, or a device, waiting.

    Emulated devices share the machine, where real ones have a processor of their own.  A device
    that is away is looked for more often than for a user.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tendon_control, 'MAX_LATENESS', 20.0)
        patch.setattr(tendon_controller, 'MAX_DELAY', 20.0)
        patch.setattr(managed_node, 'RETRY', 0.3)
        patch.setattr(packets, 'REPLY_TIME', 0.2)
        patch.setattr(bus, 'SEARCH_TIME', 0.2)
        patch.setattr(servo_tendons, 'SILENCE_TIMEOUT', 2.0)
        patch.setattr(servo_tendons, 'WATCHDOG', 100)  # 2 s
        patch.setattr(servo_tendons, 'BEHIND_TIMEOUT', 2.0)
        patch.setattr(grbl_tendons, 'QUERY_TIMEOUT', 1.0)
        patch.setattr(grbl_tendons, 'ACKNOWLEDGEMENT_TIMEOUT', 3.0)
        patch.setattr(grbl_tendons, 'PROGRESS_TIMEOUT', 3.0)
        yield


def _used_ports() -> set[int]:
    """Return the UDP ports that are in use on this machine."""
    ports = set()
    for table in ('/proc/net/udp', '/proc/net/udp6'):
        try:
            lines = Path(table).read_text(encoding='ascii').splitlines()[1:]
        except OSError:
            continue
        ports |= {int(line.split()[1].rsplit(':', 1)[1], 16) for line in lines}
    return ports


def _is_silent(domain: int) -> bool:
    """Whether no participant lives in a domain, such as one that another run left behind."""
    first = 7400 + 250 * domain
    return _used_ports().isdisjoint(range(first, first + 250))


def _is_left(domain: int) -> bool:
    """Whether no participant is left in a domain; waits for processes that are ending."""
    begin = time.monotonic()
    while not _is_silent(domain):
        if time.monotonic() - begin > LEAVE:
            return False
        time.sleep(0.1)
        gc.collect()  # of a program that ran in this process, what sits in cycles
    return True


@contextmanager
def domains() -> Iterator[Callable[[], int]]:
    """Take ROS domains: not those of the other workers, of other runs, or of leftover nodes."""
    worker = int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0').removeprefix('gw'))
    workers = int(os.environ.get('PYTEST_XDIST_WORKER_COUNT', '1'))
    own = DOMAINS[worker::workers]
    locks = {}

    def take() -> int:
        for _ in own:
            domain = own[next(_turn) % len(own)]
            path = Path(tempfile.gettempdir()) / f'soft_continuum_domain_{domain}.lock'
            try:
                lock = path.open('w')
            except PermissionError:  # made by another user
                continue
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                lock.close()
                continue
            if _is_silent(domain):
                locks[domain] = lock
                return domain
            lock.close()
        pytest.fail(f'every ROS domain of {own} is in use on this machine')

    yield take
    left = [domain for domain in locks if not _is_left(domain)]
    for lock in locks.values():
        lock.close()
    if left:  # soon no test would find a domain
        pytest.fail(f'a node, or a socket of one, was left in the ROS domains {left}')


@pytest.fixture
def take_domain() -> Iterator[Callable[[], int]]:
    """Return a function that takes a ROS domain for this test alone."""
    with domains() as take:
        yield take


@pytest.fixture
def domain(take_domain: Callable[[], int]) -> int:
    """Return a ROS domain for this test alone."""
    return take_domain()


@pytest.fixture
def make_rig(domain: int) -> Iterator[Callable[..., Rig]]:
    """Return a maker of rigs in the domain of this test."""
    rigs: list[Rig] = []

    def make(**options: str) -> Rig:
        rigs.append(Rig(domain, **options))
        return rigs[-1]

    yield make
    for rig in rigs:
        rig.close()


@pytest.fixture
def rig(make_rig: Callable[..., Rig]) -> Rig:
    """Return an observer to which nodes can be added."""
    return make_rig()


@pytest.fixture
def arm(rig: Rig) -> Rig:
    """Return the four nodes of a quick arm, straight and stiff."""
    rig.start_arm()
    return rig


@pytest.fixture(scope='module')
def module_domain() -> Iterator[int]:
    """Return a ROS domain for all tests of a module."""
    with domains() as take:
        yield take()


@pytest.fixture(scope='module')
def module_rig(module_domain: int) -> Iterator[Rig]:
    """Return an observer for all tests of a module, to which nodes can be added."""
    rig = Rig(module_domain)
    yield rig
    rig.close()


@pytest.fixture(scope='module')
def shared_arm(module_rig: Rig) -> Rig:
    """Return the four nodes of a quick arm that all tests of a module use, one after the other."""
    module_rig.start_arm()
    return module_rig


@pytest.fixture
def processes(domain: int, tmp_path: Path) -> Iterator[Processes]:
    """Return a starter of nodes as processes in the domain of this test."""
    started = Processes(domain, tmp_path)
    yield started
    started.close()
