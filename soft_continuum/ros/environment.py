# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The environment of a process before it has a node: whom it reaches, its keys, where it logs.

DDS reaches only this computer, unless the user opens the network; see
docs/how_to/set_up_the_network.md.  The enclave is the name by which SROS 2 finds keys and
permissions of a process; without SROS 2 it is unused.  A process has one, given by its arguments
before it has a node.  ROS creates a log file for every process and deletes none.
"""

from collections.abc import Mapping, MutableMapping, Sequence
from contextlib import suppress
from errno import EACCES
from ipaddress import ip_address, IPv4Address, IPv6Address
import os
from pathlib import Path
import re
from socket import AF_INET, SOCK_DGRAM, socket
import sys
from time import sleep

from soft_continuum.parameters.parameter import ParameterError

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
ENCLAVE = '--enclave', '-e'
ENCLAVE_NAME = re.compile(r'(/\w+)+', re.ASCII)
CLIENT, VIEWER, INPUTS = 'client', 'viewer', 'inputs'
"""Enclaves of programs other than the nodes: command, view and sensor clients."""
LOG_FOLDER = 'ROS_LOG_DIR'
MAX_LOG_BYTES, MAX_LOG_FILES = 50_000_000, 500
"""Logs that are kept of what processes that ended have written."""


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


def choose_log_folder(environment: MutableMapping[str, str]) -> None:
    """Set the log folder of this suite before ROS is initialised, unless the user set one."""
    if not environment.get(LOG_FOLDER):
        environment[LOG_FOLDER] = str(_own_folder(environment))


def require_log_folder(environment: Mapping[str, str]) -> None:
    """Raise ParameterError if ROS cannot write logs, without which it does not start."""
    folder = Path(environment.get(LOG_FOLDER) or _ros_home(environment) / 'log')
    reason = os.strerror(EACCES)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK | os.X_OK):
            return
    except OSError as error:
        reason = error.strerror or str(error)
    raise ParameterError(f'ROS cannot write its logs to {folder}: {reason}; set {LOG_FOLDER} to a '
                         'folder that can be written')


def discard_old_logs(environment: Mapping[str, str], max_bytes: int = MAX_LOG_BYTES,
                     max_files: int = MAX_LOG_FILES) -> None:
    """
    Delete the oldest logs beyond the limit.

    A folder that the user has chosen is left alone.
    """
    folder = _own_folder(environment)
    if environment.get(LOG_FOLDER) != str(folder):
        return
    logs = []
    with suppress(OSError):
        for path in folder.glob('*.log'):
            with suppress(OSError):  # another process deletes, too
                about = path.lstat()
                logs.append((about.st_mtime, about.st_size, path))
    size = 0
    for number, (_, length, path) in enumerate(sorted(logs, reverse=True), 1):
        size += length
        if size > max_bytes or number > max_files:
            with suppress(OSError):
                path.unlink()


def _own_folder(environment: Mapping[str, str]) -> Path:
    return _ros_home(environment) / 'log' / 'soft_continuum'


def _ros_home(environment: Mapping[str, str]) -> Path:
    return Path(environment.get('ROS_HOME') or Path.home() / '.ros')


def with_enclave(arguments: Sequence[str], name: str, namespace: str = '') -> list[str]:
    """
    Return the arguments of a process with its enclave, unless they have one.

    name: of its node, where no argument gives it another; likewise namespace.
    """
    from soft_continuum.parameters.overrides import full_name_of  # the start of verbs is without
    words = list(arguments)
    if not {*ENCLAVE} & {*words}:
        path = full_name_of(words, name, namespace)
        if ENCLAVE_NAME.fullmatch(path):  # else ROS reports the invalid namespace
            words += ['--ros-args', ENCLAVE[0], path]
    return words
