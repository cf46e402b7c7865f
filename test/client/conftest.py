# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The rigs of test/nodes, and clients of them."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
import sys
from typing import Any

import pytest

NODES = Path(__file__).resolve().parents[1] / 'nodes'
sys.path.insert(0, str(NODES))
_spec = spec_from_file_location('nodes_conftest', NODES / 'conftest.py')
assert _spec is not None and _spec.loader is not None
_fixtures = module_from_spec(_spec)
_spec.loader.exec_module(_fixtures)

_compiled = _fixtures._compiled
take_domain = _fixtures.take_domain
domain = _fixtures.domain
make_rig = _fixtures.make_rig
rig = _fixtures.rig

from command import Command  # noqa: E402

from soft_continuum.client import Arm  # noqa: E402

NAMESPACE = '/arm_under_test'  # of the rigs
TIMEOUT = 30.0  # s, on a loaded machine


@pytest.fixture
def arm(rig: Any) -> Any:
    """
    Return the four nodes of a quick arm, straight and stiff.

    Not so quick that a motion may be over before a busy machine has delivered it, and at a rate
    that such a machine keeps.
    """
    rig.start_arm(tendon_speed=0.03, tendon_acceleration=0.3, tendon_rate=10.0)
    return rig


@pytest.fixture
def here(domain: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let clients look in the domain of this test."""
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))


@pytest.fixture
def connect(here: None) -> Iterator[Callable[..., Arm]]:
    """Return a maker of clients."""
    with ExitStack() as stack:
        def make(namespace: str = NAMESPACE, timeout: float = TIMEOUT) -> Arm:
            return stack.enter_context(Arm(namespace, timeout=timeout))
        yield make


@pytest.fixture
def client(arm: Any, connect: Callable[..., Arm]) -> Arm:
    """Return a client of a quick arm, straight and stiff."""
    return connect()


@pytest.fixture
def command(here: None) -> Iterator[Callable[..., Command]]:
    """Return a starter of the command line as a process, with the arguments given."""
    started: list[Command] = []

    def start(*arguments: str, namespace: str = NAMESPACE, timeout: float = TIMEOUT,
              terminal: bool = False) -> Command:
        words = [*arguments, '--namespace', namespace, '--timeout', str(timeout)]
        started.append(Command(words, terminal))
        return started[-1]

    yield start
    for process in started:
        process.close()
