# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
What the ``ros2`` lines of the documents ask for, done by rclpy: the wheels have no ``ros2``.

Every function takes the words after ``ros2 VERB NAME`` and fails when the graph has not what they
name, or a message does not take what they say.
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


def options(words: Sequence[str]) -> tuple[list[str], dict[str, str]]:
    """Return words and options; --once, --full-length and --feedback take no word."""
    plain, given = [], {}
    rest = iter(words)
    for word in rest:
        if not word.startswith('--'):
            plain.append(word)
        else:
            given[word] = '' if word in ('--once', '--full-length', '--feedback') else next(rest)
    return plain, given


def _type_of(rig: Rig, topic: str) -> Any:
    there = rig.wait_for(lambda: dict(rig.observer.get_topic_names_and_types()).get(topic),
                         f'a topic {topic}')
    return interface(there[0])


def echo(rig: Rig, words: Sequence[str]) -> None:
    """Hear one message of a topic."""
    (topic,), given = options(words)
    assert given.keys() <= {'--once', '--full-length', '--field'}
    info = rig.wait_for(lambda: rig.observer.get_publishers_info_by_topic(topic), topic)
    latched = info[0].qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    heard = rig.record(_type_of(rig, topic), topic, QoSProfile(
        depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL) if latched else SENSOR)
    rig.wait_for(lambda: len(heard), f'a message on {topic}')
    assert hasattr(heard.last, given.get('--field', '__class__'))


def publish(rig: Rig, words: Sequence[str]) -> None:
    """Publish a message once."""
    (topic, kind, *text), given = options(words)
    assert given.keys() <= {'--once', '--qos-durability', '--qos-reliability'}
    assert _type_of(rig, topic) is interface(kind)
    durability = DurabilityPolicy[given.get('--qos-durability', 'volatile').upper()]
    message = fill(interface(kind)(), yaml.safe_load(text[0]))
    before = len(rig.statuses['tendon_actuation'])
    rig.publisher(interface(kind), topic, QoSProfile(depth=1, durability=durability)).publish(
        message)
    rig.wait_for(lambda: len(rig.statuses['tendon_actuation']) > before, 'an effect')
    assert not rig.status_value('tendon_actuation', 'refused')


def call(rig: Rig, words: Sequence[str]) -> None:
    """Call a service; fail when it does not succeed."""
    name, kind, *text = words
    request = fill(interface(kind).Request(), yaml.safe_load(text[0]) if text else {})
    fields = {field: getattr(request, field) for field in request.get_fields_and_field_types()}
    answer = rig.call(interface(kind), name, **fields)
    assert answer.success, f'{name}: {answer.message}'


def send_goal(rig: Rig, words: Sequence[str]) -> None:
    """Send a goal and wait until it succeeds."""
    (name, kind, text), given = options(words)
    assert given.keys() <= {'--feedback'}
    client = ActionClient(rig.observer, interface(kind), name)
    rig.wait_for(client.server_is_ready, name)
    goal = fill(interface(kind).Goal(), yaml.safe_load(text))
    handle = rig.wait_future(client.send_goal_async(goal), 'an answer')
    assert handle.accepted, rig.rejected()
    result = rig.wait_future(handle.get_result_async(), 'a result', 120.0).result
    assert result.error_code == 0, result.error_string


def parameter(rig: Rig, verb: str, words: Sequence[str]) -> None:
    """List, get, describe or set a parameter of a node."""
    node, *rest = words
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


def lifecycle(rig: Rig, verb: str, words: Sequence[str]) -> None:
    """Get the state of a node, or change it."""
    node, *transition = words
    if verb == 'get':
        assert rig.lifecycle_state(node) == 'active'
    else:
        assert verb == 'set' and rig.transition(node, *transition)


WORDS: dict[str, Callable[[Rig, Sequence[str]], None]] = {
    'topic echo': echo, 'topic hz': echo, 'topic pub': publish, 'service call': call,
    'action send_goal': send_goal,
    **{f'param {verb}': lambda rig, words, verb=verb: parameter(rig, verb, words)
       for verb in ('list', 'get', 'set', 'describe')},
    **{f'lifecycle {verb}': lambda rig, words, verb=verb: lifecycle(rig, verb, words)
       for verb in ('get', 'set')},
}
