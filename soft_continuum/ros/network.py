# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Who reaches the nodes over DDS: processes of this computer, unless the user opens the network.

docs/how_to/open_the_network.md says how, and what that means.
"""

from collections.abc import MutableMapping
from contextlib import suppress
import os
from pathlib import Path

PROFILES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')
RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'


def choose_network(environment: MutableMapping[str, str], config: Path) -> None:
    """
    Bind DDS to this computer by a profile in ``config``, before rclpy is initialised.

    ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET opens the network; a profile of the user's stays.  The
    other ranges are part of the profile: with LOCALHOST, ROS adds transports of its own to it,
    which listen on every interface.
    """
    if 'fastrtps' not in environment.get('RMW_IMPLEMENTATION', 'rmw_fastrtps_cpp'):
        environment.setdefault(RANGE, 'LOCALHOST')  # as far as that middleware goes
        return
    if any(environment.get(name) for name in PROFILES):
        return
    is_open = environment.get(RANGE) == 'SUBNET'
    profile = config / ('fastdds_network.xml' if is_open else 'fastdds.xml')
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


def reachable_addresses(process: int | str = 'self') -> list[str]:
    """Return the UDP addresses at which other computers reach a process; of Linux only."""
    folder, sockets = Path('/proc', str(process)), set()
    with suppress(OSError):
        for entry in (folder / 'fd').iterdir():
            with suppress(OSError):  # closed meanwhile
                sockets.add(os.readlink(entry))
        rows = (folder / 'net' / 'udp').read_text(encoding='ascii').splitlines()[1:]
        bound = [fields[1].split(':') for fields in map(str.split, rows)
                 if f'socket:[{fields[9]}]' in sockets]
        return [f'{".".join(map(str, reversed(bytes.fromhex(address))))}:{int(port, 16)}'
                for address, port in bound if not address.endswith('7F')]
    return []
