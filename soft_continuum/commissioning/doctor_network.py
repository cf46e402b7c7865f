# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``doctor --network``: the computer of each node, and whether all nodes agree on the arm."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
import os
from pathlib import Path
from statistics import median
from typing import Any

from soft_continuum import version
from soft_continuum.client import ClientError
from soft_continuum.client.connection import Connection
from soft_continuum.client.requests import Requests
from soft_continuum.client.tasks import until
from soft_continuum.hardware.commissioning import Check, FAIL, OK, WARN
from soft_continuum.nodes.suite_node import HEARTBEAT_PERIOD, NodeInfo
from soft_continuum.parameters.arm import ARM_PARAMETERS
from soft_continuum.ros.conversions import seconds
from soft_continuum.ros.entries import SENSOR, subscribe_unguarded
from soft_continuum.ros.environment import PROFILES, RANGE, reachable_addresses
from soft_continuum.ros.names import GET_NODE_INFO, HEARTBEAT, NODES
from soft_continuum.ros.parameter_table import AUTOSTART, NODE_PARAMETERS
from soft_continuum.text import printable
from soft_continuum_interfaces.msg import Heartbeat
from soft_continuum_interfaces.srv import GetNodeInfo

DISCOVERY = 4.0  # s
CALLS = 50
ANSWER_TIMEOUT = 1.0  # s
CALL_PERIOD = 0.05  # s between two calls of a node
LONG, TOO_LONG = 0.15, 0.4  # s, of a round trip: longer than tested; motion is refused
LOSSY = 0.06  # share of the messages: more than tested
OFF, TOO_FAR_OFF = 0.02, 0.15  # s by which clocks differ: measurements suffer, and are refused
PEERS, DOMAIN = 'ROS_STATIC_PEERS', 'ROS_DOMAIN_ID'
NODE_INFO_TYPE = 'soft_continuum_interfaces/srv/GetNodeInfo'
HOW_TO = 'docs/how_to/set_up_the_network.md'
CLOSED = ('reaches this computer only; for others set '
          f'{RANGE}=SUBNET on each of them, before every command: {HOW_TO}')
NOBODY = ('no node answers in namespace {}; do they run, with the same {} and '
          '{}, and does a firewall let UDP pass? {}')


@dataclass
class NodeReplies:
    """
    Replies and messages of one node.

    said: its replies.  trips, offsets: for each reply, its round trip and the lead of its clock
    over this one, s; the latter is known to half of the former.  calls: number of calls.  heard:
    the times, s, of received heartbeats.
    """

    said: list[GetNodeInfo.Response] = field(default_factory=list)
    trips: list[float] = field(default_factory=list)
    offsets: list[float] = field(default_factory=list)
    calls: int = 0
    heard: list[float] = field(default_factory=list)

    @property
    def expected(self) -> int:
        """Number of heartbeats sent from the first to the last that was received."""
        if not self.heard:
            return 0
        return max(len(self.heard),
                   round((max(self.heard) - min(self.heard)) / HEARTBEAT_PERIOD) + 1)


def checks(connection: Connection) -> Iterator[Check]:
    """Query every node of an arm; yield checks of the network and the computers."""
    yield settings()
    requests = connection.requests
    found = requests.start(_ask_all(requests)).result()
    values = requests.start(_shared_parameters(requests, found)).result()
    yield from judged(found, values, connection.node.get_namespace())


def settings() -> Check:
    """Return the settings that decide which computers this process reaches."""
    profile = next(filter(None, map(os.environ.get, PROFILES)), '')
    text = ', '.join((
        f'{DOMAIN} {os.environ.get(DOMAIN) or 0}', f'{RANGE} {os.environ.get(RANGE) or "unset"}',
        f'{PEERS} {os.environ.get(PEERS) or "unset"}',
        f'profile {Path(profile).name if profile else "none"}'))
    return Check('settings', *((OK, text) if reachable_addresses() else
                               (WARN, f'{text}: {CLOSED}')))


async def _ask_all(requests: Requests) -> dict[str, NodeReplies]:
    """Return the replies of each node that serves ~/get_node_info, by its name."""
    node, found = requests.node, dict[str, NodeReplies]()
    space = node.get_namespace().rstrip('/') + '/'
    ending = GET_NODE_INFO.removeprefix('~')

    def look() -> None:
        for service, kinds in node.get_service_names_and_types():
            name = service.removeprefix(space).removesuffix(ending)
            if NODE_INFO_TYPE in kinds and service == f'{space}{name}{ending}' and '/' not in name:
                found.setdefault(name, NodeReplies())

    await until(look, DISCOVERY)
    clients = {name: node.create_client(GetNodeInfo, f'{name}{ending}') for name in found}
    for name, answers in found.items():
        subscribe_unguarded(node, Heartbeat, HEARTBEAT.replace('~', name),
                            partial(_note, answers), SENSOR)
    await until(lambda: all(client.service_is_ready() for client in clients.values()), DISCOVERY)
    for _ in range(CALLS):
        for future in [_call(node, clients[name], answers) for name, answers in found.items()]:
            await requests.done(future, ANSWER_TIMEOUT)
        await until(lambda: False, CALL_PERIOD)
    return found


def _note(answers: NodeReplies, message: Heartbeat) -> None:
    answers.heard.append(NodeInfo.from_ros(message).time)


def _call(node: Any, client: Any, answers: NodeReplies) -> Any:
    """Begin a call; a reply in time is noted on arrival."""
    def now() -> float:
        return float(node.get_clock().now().nanoseconds * 1e-9)

    def on_answer(future: Any) -> None:
        end = now()
        if end - begin <= ANSWER_TIMEOUT and future.exception() is None:
            said = future.result()
            answers.said.append(said)
            answers.trips.append(end - begin)
            answers.offsets.append(seconds(said.stamp) - 0.5 * (begin + end))

    begin = now()
    answers.calls += 1
    future = client.call_async(GetNodeInfo.Request())
    future.add_done_callback(on_answer)
    return future


async def _shared_parameters(requests: Requests, nodes: Iterable[str]
                             ) -> dict[str, dict[str, Any]]:
    """Return the parameters that several nodes have, by node; none for nodes that do not reply."""
    counts = Counter(p.name for table in NODE_PARAMETERS.values() for p in table)
    found = {}
    for name in nodes:
        shared = [p.name for p in NODE_PARAMETERS.get(name, ())
                  if counts[p.name] > 1 and p is not AUTOSTART]
        if shared:
            try:
                found[name] = await requests.parameters(name, shared)
            except ClientError:
                continue  # reported elsewhere
    return found


def judged(found: Mapping[str, NodeReplies], values: Mapping[str, Mapping[str, Any]], space: str
           ) -> Iterator[Check]:
    """Yield a check for each computer, and whether versions and descriptions agree."""
    answered = {name: answers for name, answers in found.items() if answers.said}
    if not answered:
        yield Check('nodes', FAIL, NOBODY.format(space, DOMAIN, RANGE, HOW_TO))
        return
    hosts = defaultdict(list)
    for name, answers in sorted(answered.items()):
        on = sorted({printable(said.host) for said in answers.said})
        if len(on) > 1:
            yield Check(name, FAIL, f'runs on {" and ".join(on)}; end all but one')
        hosts[on[0]].append(name)
    for host, names in sorted(hosts.items()):
        yield Check(f'computer {host}', OK, ', '.join(names))
    if silent := sorted(found.keys() - answered.keys()):
        yield Check('unanswered', FAIL, f'{", ".join(silent)}: found, but no answer within '
                    f'{ANSWER_TIMEOUT:g} s; is the computer overloaded, or the network cut?')
    if missing := [name for name in NODES if name not in found]:
        yield Check('missing', WARN, f'{", ".join(missing)}: not found; an arm without jamming '
                    'has no jamming_valves and, unless its tendons bend each segment '
                    f'independently, no shape_sequencer; otherwise see {HOW_TO}')
    for host, names in sorted(hosts.items()):
        of_host = [answered[name] for name in names]
        yield _round_trip(host, of_host)
        yield _messages(host, of_host)
        yield _clock(host, of_host)
    yield _same_version(answered)
    yield from _same_arm(answered, values)


def _round_trip(host: str, nodes: Sequence[NodeReplies]) -> Check:
    trips = [trip for one in nodes for trip in one.trips]
    calls = sum(one.calls for one in nodes)
    middle, lost = median(trips), calls - len(trips)
    text = (f'median {middle * 1e3:.1f} ms, worst {max(trips) * 1e3:.1f} ms; {lost} of {calls} '
            f'calls unanswered within {ANSWER_TIMEOUT:g} s')
    if middle > TOO_LONG:
        return Check(f'round trip to {host}', FAIL, f'{text}; with more than '
                     f'{TOO_LONG * 1e3:g} ms motions come late and are refused: use a cable')
    if middle > LONG or lost:
        return Check(f'round trip to {host}', WARN, f'{text}; goals are tested up to 100 ms with '
                     '5 % loss: use a cable')
    return Check(f'round trip to {host}', OK, text)


def _messages(host: str, nodes: Sequence[NodeReplies]) -> Check:
    sent, came = sum(one.expected for one in nodes), sum(len(one.heard) for one in nodes)
    step = f'messages from {host}'
    if not came:
        return Check(step, FAIL, f'none received, although calls are answered; does {HEARTBEAT} '
                     'differ in type or version?')
    text = f'{sent - came} of {sent} lost'
    if sent - came > max(1, LOSSY * sent):
        return Check(step, WARN, f'{text}: more than 5 % is not tested; use a cable, and keep '
                     'images off this network')
    return Check(step, OK, text)


def _clock(host: str, nodes: Sequence[NodeReplies]) -> Check:
    """Check the clock offset of a computer, from its fastest call."""
    trip, offset = min((trip, offset) for one in nodes
                       for trip, offset in zip(one.trips, one.offsets, strict=True))
    step, unsure = f'clock of {host}', 0.5 * trip
    text = f'{offset * 1e3:+.1f} ms from this one, known to {unsure * 1e3:.1f} ms'
    least = max(0.0, abs(offset) - unsure)
    remedy = 'synchronise all computers to one time server (chrony)'
    if least > TOO_FAR_OFF:
        return Check(step, FAIL, f'{text}; allowed: {TOO_FAR_OFF * 1e3:g} ms. Its measurements '
                     f'are not used, and motions come too late or are refused: {remedy}')
    if least > OFF:
        return Check(step, WARN, f'{text}; from {OFF * 1e3:g} ms, measurements of a moving arm '
                     f'are assigned to the wrong time: {remedy}')
    if unsure > TOO_FAR_OFF:
        return Check(step, WARN, f'{text}: the network is too slow for a better estimate')
    return Check(step, OK, text)


def _same_version(found: Mapping[str, NodeReplies]) -> Check:
    versions = {name: printable(answers.said[-1].version) for name, answers in found.items()}
    if set(versions.values()) == {version()}:
        return Check('version', OK, f'{version()} everywhere')
    texts = [f'{said} of {", ".join(sorted(n for n in versions if versions[n] == said))}'
             for said in sorted(set(versions.values()))]
    return Check('version', FAIL, f'{version()} here, {"; ".join(texts)}; motion is refused: '
                 'install one version on every computer')


def _same_arm(found: Mapping[str, NodeReplies], values: Mapping[str, Mapping[str, Any]]
              ) -> Iterator[Check]:
    """Compare the digests, and the parameters of all nodes, naming each that differs."""
    digests = {name: printable(answers.said[-1].description) for name, answers in found.items()
               if answers.said[-1].description}
    names = {p.name for p in ARM_PARAMETERS}
    different = {name: text for name, text in _differences(found, values) if text}
    of_arm = '; '.join(text for name, text in different.items() if name in names)
    others = '; '.join(text for name, text in different.items() if name not in names)
    if len(set(digests.values())) > 1:
        given = ', '.join(f'{name} {digest}' for name, digest in sorted(digests.items()))
        yield Check('description', FAIL, f'{of_arm or f"digests differ: {given}"}; motion is '
                    'refused: start every node with the same description')
    elif digests:
        yield Check('description', OK, f'the same everywhere, digest {digests.popitem()[1]}')
    if others:
        yield Check('other parameters', WARN, f'{others}; start every node with the same files')


def _differences(found: Mapping[str, NodeReplies], values: Mapping[str, Mapping[str, Any]]
                 ) -> Iterator[tuple[str, str]]:
    """Yield each parameter and its difference between nodes; empty if there is none."""
    for name in sorted({name for given in values.values() for name in given}):
        by_value = defaultdict(list)
        for node, given in sorted(values.items()):
            if name in given:
                by_value[printable(repr(given[name]))].append(
                    f'{node} on {printable(found[node].said[-1].host)}'
                    if node in found and found[node].said else node)
        text = ' and '.join(f'{value} for {", ".join(nodes)}' for value, nodes
                            in by_value.items())
        yield name, f'{name} is {text}' if len(by_value) > 1 else ''
