# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The ``ros2`` commands of the documents, run by rclpy, because the wheels have no ``ros2``.

Every function takes the arguments after ``ros2 COMMAND VERB`` and fails when the graph does not
have what they name, or when a message does not accept a value.
"""

from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters
from rclpy.action import ActionClient
from rclpy.qos import DurabilityPolicy, QoSProfile
from ros_rig import Rig
import yaml

from soft_continuum.ros.qos import SENSOR

FLAGS = ('--once', '--full-length', '--feedback')


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


def options(arguments: Sequence[str]) -> tuple[list[str], dict[str, str]]:
    """Return positional arguments and options; some options are flags without a value."""
    positional, given = [], {}
    rest = iter(arguments)
    for argument in rest:
        if not argument.startswith('--'):
            positional.append(argument)
        else:
            given[argument] = '' if argument in FLAGS else next(rest)
    return positional, given


def _type_of(rig: Rig, topic: str) -> Any:
    types = rig.wait_for(lambda: dict(rig.observer.get_topic_names_and_types()).get(topic),
                         f'a topic {topic}')
    return interface(types[0])


def echo(rig: Rig, arguments: Sequence[str]) -> None:
    """Receive one message of a topic."""
    (topic,), given = options(arguments)
    assert given.keys() <= {'--once', '--full-length', '--field'}
    info = rig.wait_for(lambda: rig.observer.get_publishers_info_by_topic(topic), topic)
    latched = info[0].qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    received = rig.record(_type_of(rig, topic), topic, QoSProfile(
        depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL) if latched else SENSOR)
    rig.wait_for(lambda: len(received), f'a message on {topic}')
    assert hasattr(received.last, given.get('--field', '__class__'))


def publish(rig: Rig, arguments: Sequence[str]) -> None:
    """Publish a message once."""
    (topic, kind, *text), given = options(arguments)
    assert given.keys() <= {'--once', '--qos-durability', '--qos-reliability'}
    assert _type_of(rig, topic) is interface(kind)
    durability = DurabilityPolicy[given.get('--qos-durability', 'volatile').upper()]
    message = fill(interface(kind)(), yaml.safe_load(text[0]))
    before = len(rig.statuses['tendon_actuation'])
    rig.publisher(interface(kind), topic, QoSProfile(depth=1, durability=durability)).publish(
        message)
    rig.wait_for(lambda: len(rig.statuses['tendon_actuation']) > before, 'an effect')
    assert not rig.status_value('tendon_actuation', 'refused')


def call(rig: Rig, arguments: Sequence[str]) -> None:
    """Call a service; fail when it does not succeed."""
    name, kind, *text = arguments
    request = fill(interface(kind).Request(), yaml.safe_load(text[0]) if text else {})
    fields = {field: getattr(request, field) for field in request.get_fields_and_field_types()}
    answer = rig.call(interface(kind), name, **fields)
    assert answer.success, f'{name}: {answer.message}'


def send_goal(rig: Rig, arguments: Sequence[str]) -> None:
    """Send a goal and wait until it succeeds."""
    (name, kind, text), given = options(arguments)
    assert given.keys() <= {'--feedback'}
    client = ActionClient(rig.observer, interface(kind), name)
    rig.wait_for(client.server_is_ready, name)
    goal = fill(interface(kind).Goal(), yaml.safe_load(text))
    handle = rig.wait_future(client.send_goal_async(goal), 'an answer')
    assert handle.accepted, rig.rejected()
    result = rig.wait_future(handle.get_result_async(), 'a result', 120.0).result
    assert result.error_code == 0, result.error_string


def parameter(rig: Rig, verb: str, arguments: Sequence[str]) -> None:
    """List, get, describe or set a parameter of a node."""
    node, *rest = arguments
    if verb == 'list':
        assert rig.call(ListParameters, f'{node}/list_parameters').result.names
    elif verb == 'set':
        name, value = rest
        result = rig.set_parameter(node, name, yaml.safe_load(value))
        assert result.successful, result.reason
    elif verb == 'get':
        value, = rig.call(GetParameters, f'{node}/get_parameters', names=rest).values
        assert value.type, f'{node} has no parameter {rest}'
    else:
        found, = rig.call(DescribeParameters, f'{node}/describe_parameters',
                          names=rest).descriptors
        assert verb == 'describe' and found.description


def lifecycle(rig: Rig, verb: str, arguments: Sequence[str]) -> None:
    """Get the state of a node, or change it."""
    node, *transition = arguments
    if verb == 'get':
        assert rig.lifecycle_state(node) == 'active'
    else:
        assert verb == 'set' and rig.transition(node, *transition)


WORDS: dict[str, Callable[[Rig, Sequence[str]], None]] = {
    'topic echo': echo, 'topic hz': echo, 'topic pub': publish, 'service call': call,
    'action send_goal': send_goal,
    **{f'param {verb}': lambda rig, arguments, verb=verb: parameter(rig, verb, arguments)
       for verb in ('list', 'get', 'set', 'describe')},
    **{f'lifecycle {verb}': lambda rig, arguments, verb=verb: lifecycle(rig, verb, arguments)
       for verb in ('get', 'set')},
}
