# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Who reaches the nodes: processes of this computer, and others only where the user wants it."""

from contextlib import ExitStack
import json
from pathlib import Path
from shutil import which
import socket
from socket import AF_INET, AF_INET6, SOCK_DGRAM, SOCK_STREAM
import subprocess
import sys
import time

import pytest

from soft_continuum.ros.environment import (
    choose_network,
    given_network,
    PROFILES,
    RANGE,
    reachable_addresses,
    who_commands,
)
from soft_continuum.user_files import description_file
from support.processes import module_command
from support.split_arm import PARAMETERS, SplitArm
from support.two_computers import Computers, Quality, RIG, why_not, WORKSTATION

CONFIG = description_file().parent
NO_PROFILE = dict.fromkeys(PROFILES, '')
NODE = 'jamming_valves'


def node(rig, processes, reach):
    """Return a node that serves in an environment with this ROS_AUTOMATIC_DISCOVERY_RANGE."""
    command = [*module_command(NODE), '--ros-args', '-r', f'__ns:={rig.namespace}']
    process = processes.start(command, environment=NO_PROFILE | {RANGE: reach})
    rig.wait_until_ready(NODE)
    return process


def test_a_node_listens_to_its_own_computer_only_and_its_memory_is_limited(rig, processes):
    process = node(rig, processes, 'LOCALHOST')
    folder = Path('/proc', str(process.process.pid))
    assert reachable_addresses(process.process.pid) == []
    # Over shared memory a killed process holds up the others, and leaves its files behind.
    assert '/dev/shm/fastrtps' not in (folder / 'maps').read_text(encoding='utf-8')
    limit = next(line for line in (folder / 'limits').read_text(encoding='ascii').splitlines()
                 if line.startswith('Max data size'))
    assert 2**30 < int(limit.split()[3]) < 2**32
    assert 'DDS listens' not in process.output
    name = f'[{rig.namespace.strip("/")}.{NODE}]: '  # as of its other lines
    assert f'{name}every user of this computer can command this arm' in process.output


def test_a_node_that_other_computers_reach_says_so(rig, processes):
    process = node(rig, processes, 'SUBNET')
    addresses = reachable_addresses(process.process.pid)
    assert any(address.startswith('0.0.0.0:') for address in addresses)
    assert f'DDS listens on {addresses[0].split(":")[0]}' in process.output
    assert 'every computer that reaches it can move this arm' in process.output
    maps = Path('/proc', str(process.process.pid), 'maps').read_text(encoding='utf-8')
    assert '/dev/shm/fastrtps' not in maps


def test_addresses_of_every_kind_of_socket_are_seen_and_those_of_this_computer_are_not():
    before = {*reachable_addresses()}
    with ExitStack() as opened:
        ports = {}
        for kind, family, address in (('udp', AF_INET, '0.0.0.0'), ('udp6', AF_INET6, '::'),
                                      ('tcp', AF_INET, '0.0.0.0'), ('tcp6', AF_INET6, '::'),
                                      ('local', AF_INET, '127.0.0.2'), ('mine', AF_INET6, '::1')):
            stream = SOCK_STREAM if kind.startswith('tcp') else SOCK_DGRAM
            one = opened.enter_context(socket.socket(family, stream))
            one.bind((address, 0))
            if stream == SOCK_STREAM:
                one.listen()
            ports[kind] = one.getsockname()[1]
        assert {*reachable_addresses()} - before == {
            f'0.0.0.0:{ports["udp"]}', f'[::]:{ports["udp6"]}', f'0.0.0.0:{ports["tcp"]}',
            f'[::]:{ports["tcp6"]}'}


def test_who_commands_is_said_for_each_network():
    assert 'no other computer (ROS_DOMAIN_ID 7)' in who_commands({'ROS_DOMAIN_ID': '7'}, [])
    assert 'listens on 10.0.0.1:7400' in who_commands({}, ['10.0.0.1:7400'])
    secured = {'ROS_SECURITY_ENABLE': 'true', 'ROS_SECURITY_STRATEGY': 'Enforce',
               'ROS_SECURITY_KEYSTORE': '/keys'}
    assert 'keys in /keys' in who_commands(secured, ['10.0.0.1:7400'])
    # Permissive lets everybody in for whom there is no key.
    permissive = {**secured, 'ROS_SECURITY_STRATEGY': 'Permissive'}
    assert 'every user of this computer' in who_commands(permissive, [])


def test_without_dds_security_or_keys_nothing_starts_and_the_reason_is_said(processes, tmp_path):
    secured = {'ROS_SECURITY_ENABLE': 'true', 'ROS_SECURITY_STRATEGY': 'Enforce',
               'ROS_SECURITY_KEYSTORE': str(tmp_path)}
    (tmp_path / 'enclaves' / 'client').mkdir(parents=True)
    node, client = (processes.start(module_command(verb), environment=secured)
                    for verb in ('jamming_valves', 'status'))
    assert node.wait() == 2 and 'create the keys' in node.output, node.output
    assert client.wait() == 1, client.output
    # With ROS from apt it is the key that is missing.
    assert 'without DDS security' in client.output or 'create the keys' in client.output
    assert 'Traceback' not in node.output + client.output


# With any other range ROS adds transports that listen on every interface.
CLOSED = {RANGE: 'SYSTEM_DEFAULT', **dict.fromkeys(PROFILES, str(CONFIG / 'fastdds.xml'))}
CYCLONE = {'RMW_IMPLEMENTATION': 'rmw_cyclonedds_cpp'}


@pytest.mark.parametrize(('given', 'chosen'), [
    *((given, CLOSED) for given in ({}, {RANGE: 'LOCALHOST'}, {'ROS_LOCALHOST_ONLY': '1'},
                                    {RANGE: 'SYSTEM_DEFAULT'})),
    *(({name: 'my.xml', RANGE: 'LOCALHOST'},) * 2 for name in PROFILES),  # a user's profile stays
    (CYCLONE, {**CYCLONE, RANGE: 'LOCALHOST'})])  # limited as far as ROS can
def test_the_network_is_closed_unless_the_user_opens_it(given, chosen):
    assert (CONFIG / 'fastdds.xml').is_file()
    environment = dict(given)
    choose_network(environment, CONFIG)
    assert environment == chosen


def test_what_the_user_chose_is_known_afterwards():
    for given in ({}, {RANGE: 'SUBNET'}, dict.fromkeys(PROFILES, '/home/me/my.xml')):
        environment = dict(given)
        choose_network(environment, CONFIG)
        assert given_network(environment) == given


LATE = """
import subprocess, sys, time
from soft_continuum.client.connection import Connection
node = subprocess.Popen([sys.executable, '-m', 'soft_continuum', 'jamming_valves'],
                        stderr=subprocess.PIPE, text=True)
said = node.stderr.readline()
assert 'waiting for the interface lo' in said, said
subprocess.run(['ip', 'link', 'set', 'lo', 'up'], check=True)
connection, deadline = Connection('observer'), time.monotonic() + 60.0
while not connection.node.count_publishers('jamming_valves/state'):
    assert node.poll() is None and time.monotonic() < deadline
    time.sleep(0.05)
connection.close()
node.terminate()
print('found', node.wait())
"""
ALONE = ['unshare', '--map-root-user', '--net']  # no interface but lo, which is down


@pytest.mark.skipif(not which('unshare') or not which('ip') or bool(
    subprocess.run([*ALONE, 'true'], capture_output=True, check=False).returncode),
    reason='needs leave to make a network namespace')
def test_a_computer_without_a_network_is_enough_also_when_lo_comes_late(processes):
    program = processes.start([*ALONE, sys.executable, '-c', LATE],
                              environment=dict.fromkeys((*PROFILES, RANGE), ''))
    assert program.wait() == 0 and 'found 0' in program.output, program.output


CLIENT = """
import sys
from soft_continuum.client import Arm
from soft_continuum.ros.environment import reachable_addresses
with Arm(sys.argv[1]):
    print(reachable_addresses(), '/dev/shm/fastrtps' in open('/proc/self/maps').read())
"""


def test_a_program_with_the_python_client_listens_to_its_own_computer_only(rig, processes):
    rig.start('jamming_valves')
    program = processes.start([sys.executable, '-c', CLIENT, rig.namespace],
                              environment=dict.fromkeys((*PROFILES, RANGE), ''))
    assert program.wait() == 0, program.output
    assert '[] False' in program.output


LOSSY = Quality(delay=0.05, jitter=0.01, loss=0.05)
"""In each direction, so that a round trip takes 0.1 s."""
FORWARD, BACK = [0.0, 0.0, 0.5], [0.0, 0.0, -0.5]
STALE_TIMEOUT = 2.0  # s: a busy machine is silent for more than the 0.5 s that ./run soak tries
SLOW = {**PARAMETERS, 'stale_timeout': STALE_TIMEOUT, 'tendon_speed': 0.006}
"""A motion takes longer than the timeout."""
ALLOWED, BUSY = STALE_TIMEOUT + 0.1, 2.0  # s: what a cut takes, and what a busy machine may add
AFTERWARDS = 1.0  # s

pytestmark = pytest.mark.skipif(bool(why_not()), reason=why_not() or 'namespaces may be made')


@pytest.fixture
def split(domain, tmp_path):
    """Return an arm on two computers, whose cable delays and loses."""
    with SplitArm(domain, tmp_path, LOSSY, SLOW) as arm:
        yield arm


def links():
    """Return the network interfaces of this computer."""
    return {path.name for path in Path('/sys/class/net').iterdir()}


def test_goals_succeed_over_a_slow_and_lossy_cable_and_a_cut_ends_all_motion(split):
    doctor = split.start(split.computers.workstation, 'doctor', '--network', '--json')
    doctor.wait()
    checks = {c['step']: c for c in json.loads(doctor.output.splitlines()[-1])['checks']}
    assert checks[f'computer {RIG}']['message'] == 'jamming_valves, tendon_actuation'
    assert checks[f'computer {WORKSTATION}']['message'] == 'kinematics, shape_sequencer'
    assert checks['description']['status'] == checks['version']['status'] == 'OK'
    trip = float(checks[f'round trip to {RIG}']['message'].split()[1])
    assert trip >= 80.0  # ms: no frame is faster than 40 ms

    split.operator.send(FORWARD)
    split.rig.wait_for(lambda: split.moving, 'a motion')
    valves = split.valves
    split.computers.cut()
    cut = time.time_ns()
    answer = split.operator.answer()
    assert answer.startswith(
        f'HARDWARE_FAULT: nothing received for {STALE_TIMEOUT:g} s from '), answer
    split.rig.wait_for(lambda: not split.moving, 'rest')
    assert split.moved_after(cut) < ALLOWED + BUSY
    assert split.valves == valves
    rests_at, rest = split.rig.tendons.last.position, time.time_ns()

    split.computers.mend()
    time.sleep(AFTERWARDS)
    split.rig.wait_for_more(split.rig.tendons)
    assert split.rig.tendons.last.position == rests_at
    assert split.moved_after(rest) == 0.0
    assert split.valves == valves
    split.operator.send(FORWARD)
    assert split.operator.answer() == 'reached'

    split.operator.send(BACK)
    split.rig.wait_for(lambda: split.moving, 'a motion')
    valves = split.valves
    killed = split.kill(WORKSTATION)
    split.rig.wait_for(lambda: not split.moving, 'rest')
    assert split.moved_after(killed) < ALLOWED + BUSY
    assert split.valves == valves


def test_nothing_is_left_behind():
    before = links()
    with Computers() as computers:
        pids = computers.rig.pid, computers.workstation.pid
        computers.set(Quality(loss=1.0))
    assert links() == before
    assert not any(Path('/proc', str(pid)).exists() for pid in pids)
