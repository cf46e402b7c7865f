# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""Who reaches the nodes: processes of this computer, and others only where the user wants it."""

from pathlib import Path
import sys

from processes import module_command, NodeProcess, Processes
import pytest
from ros_rig import Rig

from soft_continuum.nodes.up import description_file
from soft_continuum.ros.network import choose_network, PROFILES, RANGE, reachable_addresses

CONFIG = description_file().parent
NO_PROFILE = dict.fromkeys(PROFILES, '')
NODE = 'jamming_valves'


def node(rig: Rig, processes: Processes, reach: str) -> NodeProcess:
    """Return a node that serves in an environment with this ROS_AUTOMATIC_DISCOVERY_RANGE."""
    command = [*module_command(NODE), '--ros-args', '-r', f'__ns:={rig.namespace}']
    process = processes.start(command, environment=NO_PROFILE | {RANGE: reach})
    rig.wait_until_ready(NODE)
    return process


def test_a_node_listens_to_its_own_computer_only_and_its_memory_is_limited(
        rig: Rig, processes: Processes) -> None:
    process = node(rig, processes, 'LOCALHOST')
    folder = Path('/proc', str(process.process.pid))
    assert reachable_addresses(process.process.pid) == []
    # Over shared memory a killed process holds up the others, and leaves its files behind.
    assert '/dev/shm/fastrtps' not in (folder / 'maps').read_text(encoding='utf-8')
    limit = next(line for line in (folder / 'limits').read_text(encoding='ascii').splitlines()
                 if line.startswith('Max data size'))
    assert 2**30 < int(limit.split()[3]) < 2**32
    assert 'DDS listens' not in process.output


def test_a_node_that_other_computers_reach_says_so(rig: Rig, processes: Processes) -> None:
    process = node(rig, processes, 'SUBNET')
    addresses = reachable_addresses(process.process.pid)
    assert any(address.startswith('0.0.0.0:') for address in addresses)
    assert f'DDS listens on {addresses[0].split(":")[0]}' in process.output
    assert 'every computer that reaches it can move this arm' in process.output
    maps = Path('/proc', str(process.process.pid), 'maps').read_text(encoding='utf-8')
    assert '/dev/shm/fastrtps' not in maps


@pytest.mark.parametrize('given', [{}, {RANGE: 'LOCALHOST'}, {'ROS_LOCALHOST_ONLY': '1'},
                                   {RANGE: 'SYSTEM_DEFAULT'}])
def test_the_network_is_closed_unless_the_user_opens_it(given: dict[str, str]) -> None:
    environment = dict(given)
    choose_network(environment, CONFIG)
    # With any other range ROS adds transports that listen on every interface.
    profile = str(CONFIG / 'fastdds.xml')
    assert environment == {RANGE: 'SYSTEM_DEFAULT', **dict.fromkeys(PROFILES, profile)}
    assert Path(profile).is_file()


@pytest.mark.parametrize('name', PROFILES)
def test_a_profile_of_the_user_stays(name: str) -> None:
    environment = {name: 'my.xml', RANGE: 'LOCALHOST'}
    choose_network(environment, CONFIG)
    assert environment == {name: 'my.xml', RANGE: 'LOCALHOST'}


def test_another_middleware_is_limited_as_far_as_ros_can() -> None:
    environment = {'RMW_IMPLEMENTATION': 'rmw_cyclonedds_cpp'}
    choose_network(environment, CONFIG)
    assert environment == {'RMW_IMPLEMENTATION': 'rmw_cyclonedds_cpp', RANGE: 'LOCALHOST'}


CLIENT = """
import sys
from soft_continuum.client import Arm
from soft_continuum.ros.network import reachable_addresses
with Arm(sys.argv[1]):
    print(reachable_addresses(), '/dev/shm/fastrtps' in open('/proc/self/maps').read())
"""


def test_a_program_with_the_python_client_listens_to_its_own_computer_only(
        rig: Rig, processes: Processes) -> None:
    rig.start('jamming_valves')
    program = processes.start([sys.executable, '-c', CLIENT, rig.namespace],
                              environment=dict.fromkeys((*PROFILES, RANGE), ''))
    assert program.wait() == 0, program.output
    assert '[] False' in program.output
