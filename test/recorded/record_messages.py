# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The messages of runs of three shapes: in `test/`, `python -m recorded.record_messages`.

It writes those that are not there, and never over those that are; the same on every machine.

What depends on when a thread had its turn is left out: times, ids, pressures and all else that
passes by while something moves, into how many pieces a motion is cut, and whether the pump rests
between two segments.  What is left is exact: of flags, phases and states each value in turn, of
motions all points of their plan, of streams what they say at rest.
"""

from collections.abc import Mapping, Sequence
import hashlib
import json
from math import isfinite
from pathlib import Path
import re
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from soft_continuum.hardware import tendon_controller
from soft_continuum.lab.recordings.bag import message_class
from soft_continuum.nodes import tendon_control
from support.descriptions import given
from support.rig_fixtures import domains
from support.ros_rig import DEADLINE, Recording, Rig, SEGMENTS

HERE = Path(__file__).resolve().parent
MESSAGES = HERE / 'messages'
CONFIG = HERE.parents[1] / 'config'
RUNS: Mapping[str, tuple[str, Sequence[Sequence[str]]]] = {
    'planar': ('manipulator', (('c_form', 's_form'), ('upright_c_form',))),
    'spatial': ('spatial_jamming', (('c_form', 'helix'), ('s_form',))),
    'without_jamming': ('tendon_arm', (('c_form', 'helix'), ('s_form',))),
}
"""Of each run: the file in ``config/``, and the shapes of its goals."""
LEFT_OUT = {'stamp', 'measured', 'goal_id', 'rejected_goal_id', 'id', 'lifetime'}
"""Fields of messages that are times or ids."""
LAGGING = {'bending_angles', 'bending_directions', 'tip'}
"""Fields of a result that are those of the model as last heard: on a busy machine it lags."""
IN_TURN = {
    'shape_sequencer/state': ('running', 'shape_index', 'shape', 'segment', 'phase', 'error_code',
                              'error_string', 'shapes_completed', 'rejected'),
    'jamming_valves/state': ('connected', 'stiffness', 'fault', 'segment_faults', 'vacuums'),
    'tendon_actuation/state': ('connected', 'fault', 'referenced', 'homing', 'pull_tolerances',
                               'stopped', 'stop_message', 'emergency_stop', 'stops', 'refused'),
    'segment_N/stiff': ('data',), 'target_markers': ('markers',), 'known_obstacles': ('markers',),
}
"""Topics, and the fields of which each value counts; where it repeats, once."""
AT_REST = ('kinematics/state', 'disc_poses', 'segment_poses',
           'joint_states', 'tendon_states', 'tendon_tensions', 'shape_markers')
"""Streams of which the message at rest counts."""
ONCE = ('robot_description',)
TRAJECTORIES = 'tendon_actuation/tendon_trajectory'
JAMMING_VALVES, STIFF = 'jamming_valves', 'segment_N/stiff'


class Run:
    """The messages of one run."""

    def __init__(self, rig: Rig, name: str) -> None:
        """Start the nodes; listen to every topic in the namespace of the arm."""
        file, self._goals = RUNS[name]
        values = given(CONFIG / f'{file}.yaml')
        self._rig, jamming = rig, values.get('arm__jamming', True)
        nodes = ['tendon_actuation', 'kinematics', 'shape_sequencer']
        rig.start(*([JAMMING_VALVES] if jamming else []), *nodes, **values)
        self._heard: dict[str, Recording] = {}
        for kind in (*IN_TURN, *AT_REST, *ONCE, TRAJECTORIES):
            if not jamming and (kind.startswith(JAMMING_VALVES) or kind == STIFF):
                continue
            for topic in [kind.replace('_N', f'_{n}') for n in range(1, 1 + SEGMENTS * (
                    '_N' in kind))] or [kind]:
                publishers = rig.wait_for(
                    lambda topic=topic: self._publishers(topic), f'a publisher of {topic}')
                self._heard[topic] = rig.record(
                    message_class(publishers[0].topic_type), topic, _as(publishers))

    def _publishers(self, topic: str) -> Any:
        return self._rig.observer.get_publishers_info_by_topic(f'{self._rig.namespace}/{topic}')

    def record(self) -> dict[str, Any]:
        """Run the goals and return what was said."""
        rig = self._rig
        found: dict[str, Any] = {'at_rest': [self._at_rest()], 'goals': [], 'in_turn': {}}
        for names in self._goals:
            goal = rig.goal(*names)
            status, result = goal.result()
            # Feedback comes by a topic, the result by a service: neither waits for the other.
            rig.wait_for(lambda goal=goal: goal.phases[-1][-1] == 'holding', 'the last feedback')
            found['goals'].append({
                'phases': [list(phase) for phase in goal.phases], 'status': status,
                'result': {name: value for name, value in plain(result).items()
                           if name not in LAGGING}})
            found['at_rest'].append(self._at_rest())
        for topic, recording in self._heard.items():
            for field in IN_TURN.get(_kind(topic), ()):
                values = [plain(getattr(message, field)) for message in recording]
                found['in_turn'][f'{topic}.{field}'] = [
                    value for before, value in zip([None, *values], values, strict=False)
                    if value != before]
        found['motions'] = self._motions()
        found['topics'] = {
            topic.removeprefix(f'{rig.namespace}/'): kinds[0]
            for topic, kinds in sorted(rig.observer.get_topic_names_and_types())
            if topic.startswith(rig.namespace) and rig.observer.count_publishers(topic)}
        found['digests'] = {
            topic: hashlib.sha256(self._heard[topic].last.data.encode()).hexdigest()
            for topic in ONCE}
        return found

    def _at_rest(self) -> dict[str, Any]:
        """Return what the streams say once they say the same three times, at rest."""
        rig = self._rig
        streams = {topic: heard for topic, heard in self._heard.items() if _kind(topic) in AT_REST}
        rig.wait_for(lambda: rig.at_rest, 'tendons at rest')
        begun = {topic: len(heard) for topic, heard in streams.items()}

        def unsettled() -> list[str]:
            return [topic for topic, heard in streams.items()
                    if len(heard) < begun[topic] + 5 or not _same(list(heard)[-3:])]

        rig.until(lambda: not unsettled(), DEADLINE)
        assert not unsettled(), f'these do not come to rest: {unsettled()}'
        return {topic: plain(heard.last) for topic, heard in streams.items()}

    def _motions(self) -> list[dict[str, Any]]:
        """
        Return all points of each motion, s and m.

        A motion comes in pieces.  The last point of each, but of the last one, is where it was
        cut, which is left out: all others are points of the plan.
        """
        pieces: dict[str, list[Any]] = {}
        for message in self._heard[TRAJECTORIES]:
            part = message.trajectory
            assert part.points, f'the motion was held: {self._rig.sequencer.last}'
            pieces.setdefault(message.id, []).append(part)
        found = []
        for messages in pieces.values():
            points = {
                point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec:
                list(point.positions)
                for message in messages for point in message.points[:-1]}
            last = messages[-1].points[-1]
            points[last.time_from_start.sec + 1e-9 * last.time_from_start.nanosec] = list(
                last.positions)
            found.append({
                'names': list(messages[0].joint_names),
                'times': sorted(points), 'pulls': [points[time] for time in sorted(points)]})
        return found


def plain(value: Any) -> Any:
    """Return a message as dictionaries and lists, without times and ids."""
    if hasattr(value, 'get_fields_and_field_types'):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()
                if name not in LEFT_OUT}
    if isinstance(value, str | bool | int):
        return value
    if isinstance(value, float):
        return value if isfinite(value) else str(value)
    return [plain(one) for one in value]


def _same(messages: Sequence[Any]) -> bool:
    return all(plain(message) == plain(messages[0]) for message in messages)


def _kind(topic: str) -> str:
    """Return segment_N/stiff for segment_1/stiff."""
    return re.sub(r'_\d+', '_N', topic)


def _as(publishers: Sequence[Any]) -> QoSProfile:
    """Return a profile that loses nothing of what these publish."""
    return QoSProfile(
        depth=5000, reliability=ReliabilityPolicy.RELIABLE if all(
            p.qos_profile.reliability == ReliabilityPolicy.RELIABLE for p in publishers)
        else ReliabilityPolicy.BEST_EFFORT, durability=DurabilityPolicy.TRANSIENT_LOCAL if all(
            p.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL for p in publishers)
        else DurabilityPolicy.VOLATILE)


def main() -> None:
    """Write what is not there."""
    MESSAGES.mkdir(exist_ok=True)
    # As rig_fixtures: nodes in this process go on when a busy machine kept them waiting.
    tendon_control.MAX_LATENESS = tendon_controller.MAX_DELAY = 20.0
    for name in RUNS:
        path = MESSAGES / f'{name}.json'
        if not path.exists():
            with domains() as take:
                rig = Rig(take())
                found = Run(rig, name).record()
                rig.close()
            text = json.dumps(found, separators=(',', ':'), allow_nan=False)
            path.write_text(text + '\n', encoding='utf-8')


if __name__ == '__main__':
    main()
