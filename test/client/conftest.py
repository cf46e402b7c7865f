# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The rigs of nodes, and clients of them."""

from contextlib import ExitStack
import faulthandler
import sys

from action_msgs.srv import CancelGoal
import pytest
from std_srvs.srv import SetBool

from soft_continuum.client import Arm, requests
from soft_continuum.ui.cli.main import main
from support.command import Command
from support.documented_commands import kept_signal_handlers
from support.estimated_arm import EstimatedArm
from support.rig_fixtures import (
    _compiled,
    _patient,
    domain,
    make_rig,
    module_domain,
    module_rig,
    rig,
    take_domain,
)

NAMESPACE = '/arm_under_test'  # of the rigs
TIMEOUT = 60.0  # s, on a loaded machine


# Not so quick that a motion may be over before a busy machine has delivered it, and at rates that
# such a machine keeps; planned in few steps.
QUICK = {'tendon_speed': 0.03, 'tendon_acceleration': 0.3, 'tendon_rate': 10.0,
         'jamming_rate': 10.0, 'angle_step': 0.1, 'reach__states': 1000,
         # What follows the model and is off on purpose, as some tests' trackers, must not lead it.
         'estimation__enabled': False}


@pytest.fixture(scope='module')
def arm_of_module(module_rig):
    """Return the four nodes of a quick arm that the tests of a module share."""
    module_rig.start_arm(**QUICK)
    return module_rig


@pytest.fixture
def settling(monkeypatch):
    """Let clients in this process wait longer for topics of which a busy machine is late."""
    monkeypatch.setattr(requests, 'SETTLING_TIMEOUT', 5.0)


@pytest.fixture
def arm(arm_of_module, settling):
    """Return the shared arm at rest, stiff and without a goal, in whatever shape it was left."""
    rig = arm_of_module
    rig.call(CancelGoal, 'run_shape_sequence/_action/cancel_goal')
    rig.wait_for(lambda: not rig.sequencer.last.running, 'no goal')
    assert rig.trigger('tendon_actuation/resume').success
    assert rig.call(SetBool, 'jamming_valves/set_all_stiff', data=True).success
    rig.wait_for(lambda: rig.all_stiff and rig.at_rest, 'rest')
    return rig


@pytest.fixture(scope='module')
def estimated_of_module(module_domain):
    """Return a stand-in for an arm that is estimated, which the tests of a module share."""
    arm = EstimatedArm(module_domain)
    yield arm
    arm.close()


@pytest.fixture
def straight(arm):
    """Return the shared arm, whose present pulls count as those of the straight arm."""
    for service in ('tendon_actuation/reference', 'kinematics/reset'):  # which may ask back
        arm.wait_for(lambda service=service: arm.trigger(service).success, service)
        arm.wait_for(lambda: arm.pulls == (0.0, 0.0), 'pulls of 0')
    arm.wait_for(lambda: not any(arm.joints.last.position), 'a straight arm')
    return arm


@pytest.fixture
def here(request, monkeypatch):
    """Let clients look in the domain of this test, or of its module where that shares an arm."""
    shares = 'arm' in request.fixturenames
    domain = request.getfixturevalue('module_domain' if shares else 'domain')
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))


@pytest.fixture
def connect(here):
    """Return a maker of clients."""
    with ExitStack() as stack:
        def make(namespace=NAMESPACE, timeout=TIMEOUT):
            return stack.enter_context(Arm(namespace, timeout=timeout))
        yield make


@pytest.fixture(scope='module')
def client_of_module(arm_of_module, module_domain):
    """Return a client that the tests of a module share: to find an arm may take 3 s."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_DOMAIN_ID', str(module_domain))
        patch.setattr(requests, 'SETTLING_TIMEOUT', 5.0)
        with Arm(NAMESPACE, timeout=TIMEOUT) as client:
            yield client


@pytest.fixture
def client(arm, here, client_of_module):
    """Return a client of the shared arm, which knows that it rests."""
    client_of_module.wait_for(lambda state: (
        all(state.stiff) and state.pulls == arm.pulls and not any(state.speeds)
        and state.node('shape_sequencer').message == 'idle'))
    return client_of_module


@pytest.fixture
def straight_client(straight, client):
    """Return a client of the shared arm, which knows that it counts as straight."""
    client.wait_for(lambda state: state.pulls == (0.0, 0.0) and not any(state.joint_angles))
    return client


@pytest.fixture
def call(here, capsys, monkeypatch, tmp_path_factory):
    """Return a function that runs a verb in this process: exit status, stdout, stderr."""
    monkeypatch.setattr(sys, 'argv', ['soft_continuum'])
    # The events executor calls it with a stderr that has no file descriptor here.
    monkeypatch.setattr(faulthandler, 'enable', lambda: None)
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path_factory.mktemp('cache')))

    def run(*words, namespace=NAMESPACE, timeout=TIMEOUT):
        patience = [] if timeout is None else ['--timeout', str(timeout)]
        with kept_signal_handlers():
            status = main([*words, '--namespace', namespace, *patience])
        return status, *capsys.readouterr()

    return run


@pytest.fixture
def command(here):
    """Return a starter of the command line as a process, with the arguments given."""
    started = []

    def start(*arguments, namespace=NAMESPACE, timeout=TIMEOUT, terminal=False):
        words = [*arguments, '--namespace', namespace, '--timeout', str(timeout)]
        started.append(Command(words, terminal))
        return started[-1]

    yield start
    for process in started:
        process.close()
