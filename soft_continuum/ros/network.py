# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Reachability of the nodes over DDS: only this computer, unless the user opens the network.

See docs/how_to/set_up_the_network.md.
"""

from collections.abc import Mapping, MutableMapping, Sequence
from contextlib import suppress
from ipaddress import ip_address, IPv4Address, IPv6Address
import os
from pathlib import Path
from socket import AF_INET, SOCK_DGRAM, socket
import sys
from time import sleep

PROFILES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')
RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
OPEN, CLOSED = 'fastdds_network.xml', 'fastdds.xml'  # our own profiles
KEYSTORE = 'ROS_SECURITY_KEYSTORE'
SAID = 'SOFT_CONTINUUM_NETWORK_SAID'
"""Environment variable of nodes that start together: only one logs who can command the arm."""
PARENT = 'SOFT_CONTINUUM_PARENT'
"""Environment variable with the id of the parent process, with which a node ends."""
LISTENING = '0A'  # state of a TCP socket
NOT_UP = ('127.0.0.1 is not available: waiting for the interface lo; if nothing else brings it '
          'up, run `ip link set lo up`')


def choose_network(environment: MutableMapping[str, str], config: Path) -> None:
    """
    Bind DDS to this computer by a profile in ``config``, before rclpy is initialised.

    ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET opens the network; a profile of the user is kept.  The
    other ranges are part of the profile: with LOCALHOST, ROS adds transports of its own to it,
    which listen on every interface.
    """
    if 'fastrtps' not in environment.get('RMW_IMPLEMENTATION', 'rmw_fastrtps_cpp'):
        environment.setdefault(RANGE, 'LOCALHOST')  # as far as that middleware goes
        return
    if any(environment.get(name) for name in PROFILES):
        return
    is_open = environment.get(RANGE) == 'SUBNET'
    profile = config / (OPEN if is_open else CLOSED)
    environment.update(dict.fromkeys(PROFILES, str(profile)))
    if is_open:
        environment.setdefault('FASTDDS_BUILTIN_TRANSPORTS', 'UDPv4')
    else:
        environment[RANGE] = 'SYSTEM_DEFAULT'
        environment.pop('ROS_LOCALHOST_ONLY', None)


def choose_own_network() -> None:
    """Choose the network of this process, before its first node; without ROS do nothing."""
    with suppress(ImportError, LookupError):  # not built
        from ament_index_python.packages import get_package_share_directory
        choose_network(os.environ, Path(get_package_share_directory('soft_continuum'), 'config'))


def is_up() -> bool:
    """Whether this computer has the address on which DDS listens; not before ``lo`` is up."""
    with socket(AF_INET, SOCK_DGRAM) as one:
        try:
            one.connect(('127.0.0.1', 9))  # sends nothing
        except OSError:
            return False
    return True


def wait_until_up() -> None:
    """Wait for 127.0.0.1, which DDS only looks for once; report on stderr."""
    if not is_up():
        print(NOT_UP, file=sys.stderr, flush=True)
        while not is_up():
            sleep(0.5)


def given_network(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the user's settings before choose_network, for a process of another environment."""
    chosen = {name: value for name in (*PROFILES, RANGE) if (value := environment.get(name))}
    profile = Path(chosen.get(PROFILES[0], ''))
    if profile.name not in (CLOSED, OPEN) or profile.parent.name != 'config':
        return chosen
    return {RANGE: 'SUBNET'} if profile.name == OPEN else {}


def who_commands(environment: Mapping[str, str], addresses: Sequence[str]) -> str:
    """Return one line on who can command the arm; addresses: of reachable_addresses."""
    domain = f'ROS_DOMAIN_ID {environment.get("ROS_DOMAIN_ID") or 0}'
    if is_secured(environment):
        return (f'SROS 2: the keys in {environment.get(KEYSTORE)} define who can command this arm '
                f'({domain})')
    if addresses:
        return (f'DDS listens on {", ".join(addresses)}: every computer that reaches it can move '
                f'this arm, or make this node unreachable ({domain}); see '
                'docs/how_to/set_up_the_network.md')
    return (f'every user of this computer can command this arm, and no other computer ({domain}); '
            'see docs/how_to/set_up_the_network.md')


def is_secured(environment: Mapping[str, str]) -> bool:
    """Whether SROS 2 is enforced: then no node starts without a key."""
    return (environment.get('ROS_SECURITY_ENABLE') == 'true'
            and environment.get('ROS_SECURITY_STRATEGY') == 'Enforce')


def security_problem(error: Exception, environment: Mapping[str, str]) -> str:
    """Return the remedy for an error of ROS at its start, empty if not caused by SROS 2."""
    text = str(error).splitlines()[0]
    if environment.get('ROS_SECURITY_ENABLE') != 'true' or 'security' not in text.lower():
        return ''
    if 'security libraries' in text:
        return ('ROS_SECURITY_ENABLE is true, but this ROS 2 was built without DDS security, as '
                'that from PyPI is: use ROS 2 from apt, or unset it; see '
                'docs/how_to/set_up_the_network.md')
    return (f'SROS 2 prevents the start: {text}; create the keys as in '
            'docs/how_to/set_up_the_network.md, or unset ROS_SECURITY_ENABLE')


def reachable_addresses(process: int | str = 'self') -> list[str]:
    """Return the addresses at which other computers reach a process, UDP first; Linux only."""
    folder, sockets, found = Path('/proc', str(process)), set(), []
    with suppress(OSError):
        for entry in (folder / 'fd').iterdir():
            with suppress(OSError):  # closed meanwhile
                sockets.add(os.readlink(entry))
        for protocol in ('udp', 'udp6', 'tcp', 'tcp6'):
            with suppress(OSError):  # a kernel without IPv6
                table = (folder / 'net' / protocol).read_text(encoding='ascii')
                found += [_address(fields[1]) for fields in map(str.split, table.splitlines()[1:])
                          if f'socket:[{fields[9]}]' in sockets
                          and (protocol.startswith('udp') or fields[3] == LISTENING)]
    return [f'[{address}]:{port}' if address.version == 6 else f'{address}:{port}'
            for address, port in found if not address.is_loopback]


def _address(text: str) -> tuple[IPv4Address | IPv6Address, int]:
    """Return address and port of a row below /proc/net: words of four bytes, last one first."""
    digits, _, port = text.partition(':')
    packed = b''.join(bytes.fromhex(digits[start:start + 8])[::-1]
                      for start in range(0, len(digits), 8))
    address = ip_address(packed)
    return getattr(address, 'ipv4_mapped', None) or address, int(port, 16)
