# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The ``ros2`` commands of the documentation, by rclpy: the wheels have no ``ros2``.

Each function takes the arguments of one command.  It fails when the running nodes do not have what
they name, or when a message does not accept a value, and returns a function that does what the
command does and fails when that has no success.
"""

import argparse
from collections.abc import Callable, Sequence
from importlib import import_module
import re
import shlex
from typing import Any, NoReturn

from lifecycle_msgs.msg import Transition
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters
from rclpy.action import ActionClient, get_action_names_and_types
from rclpy.qos import DurabilityPolicy, QoSProfile
import yaml

from soft_continuum.ros.entries import SENSOR
from support.ros_rig import Rig

SEQUENCE_TIMEOUT = 120.0  # s
OF_THE_READER = ('/my_camera/tip_pose',)
Action = Callable[[], object]


class Options(argparse.ArgumentParser):
    """Reads the arguments of one ros2 command: positional ones, options with a value, flags."""

    def __init__(self, words: Sequence[str], positional: str, options: str = '') -> None:
        """positional, options: names, separated by spaces; options with a value end in =."""
        super().__init__(allow_abbrev=False)
        for name in positional.split():
            self.add_argument(name.strip('*?'), nargs=name[-1] if name[-1] in '*?' else None)
        for name in options.split():
            self.add_argument(name.rstrip('='),
                              action='store' if name.endswith('=') else 'store_true')
        self.given = self.parse_args(words)

    def error(self, message: str) -> NoReturn:
        """Fail the test."""
        raise AssertionError(message)


def without_namespace(name: str) -> str:
    """Return a name without the namespace of one of two arms: the test has one."""
    return re.sub(r'^/(left|right)(?=/)', '', name)


def interface(name: str) -> Any:
    """Return the class of a type such as std_srvs/srv/Trigger."""
    package, kind, short = name.split('/')
    return getattr(import_module(f'{package}.{kind}'), short)


def fill(message: Any, values: dict[str, Any]) -> Any:
    """Set the fields of a message, and of those in it, from YAML."""
    types = message.get_fields_and_field_types()
    for name, value in values.items():
        kind = types[name].removeprefix('sequence<').removesuffix('>')
        if '/' in kind:
            package, short = kind.split('/')
            made = interface(f'{package}/msg/{short}')
            value = ([fill(made(), item) for item in value] if isinstance(value, list)
                     else fill(made(), value))
        setattr(message, name, value)
    return message


def _type(rig: Rig, found: Callable[[], list[tuple[str, list[str]]]], name: str) -> str:
    types = rig.wait_for(lambda: dict(found()).get(name), name)
    return str(types[0])


def _topic_type(rig: Rig, topic: str) -> Any:
    return interface(_type(rig, rig.observer.get_topic_names_and_types, topic))


def topic_echo(rig: Rig, words: Sequence[str]) -> Action:
    """Receive one message of a topic."""
    given = Options(words, 'topic', '--once --full-length --field=').given
    topic = without_namespace(given.topic)
    kind = _topic_type(rig, topic)
    publishers = rig.wait_for(lambda: rig.observer.get_publishers_info_by_topic(topic), topic)
    assert given.field is None or given.field in kind.get_fields_and_field_types()

    def receive() -> None:
        latched = publishers[0].qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
        received = rig.record(kind, topic, QoSProfile(
            depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL) if latched else SENSOR)
        rig.wait_for(lambda: len(received), f'a message on {topic}')

    return receive


def topic_pub(rig: Rig, words: Sequence[str]) -> Action:
    """Publish a message once."""
    given = Options(
        words, 'topic kind values',
        '--once --rate= --qos-durability= --qos-reliability=').given
    assert _topic_type(rig, given.topic) is interface(given.kind)
    rig.wait_for(lambda: rig.observer.get_subscriptions_info_by_topic(given.topic), given.topic)
    message = fill(interface(given.kind)(), yaml.safe_load(given.values))
    durability = DurabilityPolicy[(given.qos_durability or 'volatile').upper()]
    return lambda: rig.publisher(
        type(message), given.topic, QoSProfile(depth=1, durability=durability)).publish(message)


def service_call(rig: Rig, words: Sequence[str]) -> Action:
    """Call a service."""
    given = Options(words, 'name kind values?').given
    found = _type(rig, rig.observer.get_service_names_and_types, given.name)
    assert found == given.kind, f'{given.name} is a {found}'
    kind = interface(given.kind)
    request = fill(kind.Request(), yaml.safe_load(given.values or '{}'))

    def call() -> None:
        fields = {field: getattr(request, field) for field in request.get_fields_and_field_types()}
        answer = rig.call(kind, given.name, **fields)
        assert answer.success, f'{given.name}: {answer.message}'

    return call


def action_send_goal(rig: Rig, words: Sequence[str]) -> Action:
    """Send a goal and wait until it succeeds."""
    given = Options(words, 'name kind values', '--feedback').given
    found = _type(rig, lambda: get_action_names_and_types(rig.observer), given.name)
    assert found == given.kind, f'{given.name} is a {found}'
    goal = fill(interface(given.kind).Goal(), yaml.safe_load(given.values))

    def run() -> None:
        client = ActionClient(rig.observer, interface(given.kind), given.name)
        rig.wait_for(client.server_is_ready, given.name)
        handle = rig.wait_future(rig.on_ros_thread(client.send_goal_async, goal), 'an answer')
        assert handle.accepted, rig.sequencer.last
        result = rig.wait_future(rig.on_ros_thread(handle.get_result_async), 'a result',
                                 SEQUENCE_TIMEOUT).result
        assert result.error_code == 0, result.error_string

    return run


def param(verb: str, rig: Rig, words: Sequence[str]) -> Action:
    """List, get, describe or set a parameter of a node."""
    names = {'list': 'node', 'set': 'node name value'}.get(verb, 'node name')
    given = Options(words, names).given
    node, name = given.node, getattr(given, 'name', '')
    if verb == 'list':
        return lambda: rig.call(ListParameters, f'{node}/list_parameters')
    described, = rig.call(
        DescribeParameters, f'{node}/describe_parameters', names=[name]).descriptors
    assert described.type, f'{node} has no parameter {name}'
    if verb == 'set':
        assert not described.read_only, f'{name} is read-only'
        # Checked by the node itself, which has the old value again afterwards.
        before, = rig.call(GetParameters, f'{node}/get_parameters', names=[name]).values
        result = rig.set_parameter(node, name, yaml.safe_load(given.value))
        assert result.successful, result.reason
        kind = ('', 'bool', 'integer', 'double', 'string')[before.type]
        rig.set_parameter(node, name, getattr(before, f'{kind}_value'))
    return lambda: None


def lifecycle(verb: str, rig: Rig, words: Sequence[str]) -> Action:
    """Get the state of a node, or change it."""
    given = Options(words, 'node' if verb == 'get' else 'node transition').given
    _type(rig, rig.observer.get_service_names_and_types, f'{given.node}/get_state')
    if verb == 'set':
        assert hasattr(Transition, f'TRANSITION_{given.transition.upper()}'), given.transition
    return lambda: None


def bag_record(rig: Rig, words: Sequence[str]) -> Action:
    """Record topics; the library that would is not among the wheels."""
    for topic in Options(words, 'topics*').given.topics:
        assert topic in OF_THE_READER or _topic_type(rig, topic)
    return lambda: None


COMMANDS: dict[str, Callable[[Rig, Sequence[str]], Action]] = {
    'topic echo': topic_echo, 'topic hz': topic_echo, 'topic pub': topic_pub,
    'service call': service_call, 'action send_goal': action_send_goal, 'bag record': bag_record,
    **{f'param {verb}': lambda rig, words, verb=verb: param(verb, rig, words)
       for verb in ('list', 'get', 'set', 'describe')},
    **{f'lifecycle {verb}': lambda rig, words, verb=verb: lifecycle(verb, rig, words)
       for verb in ('get', 'set')},
}


def check(rig: Rig, line: str) -> Action:
    """Check a line; return a function that does what it does."""
    words = shlex.split(line)
    command = ' '.join(words[1:3])
    assert command in COMMANDS, f'ros2 {command}'
    return COMMANDS[command](rig, words[3:])
