# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``doctor --network`` says what is wrong between the computers of an arm, and what to do."""

from builtin_interfaces.msg import Time
import pytest

from soft_continuum import version
from soft_continuum.commissioning.doctor_network import judged, NodeReplies
from soft_continuum_interfaces.srv import GetNodeInfo

DIGEST = '0123456789abcdef'


def answers(host='rig', trip=0.01, offset=0.0, calls=50, answered=50, of='', arm=DIGEST, lost=0):
    """Return what a node answered; the slower half of the answers tells its time badly."""
    said = [GetNodeInfo.Response(host=host, version=of or version(), description=arm,
                           stamp=Time(sec=1))] * answered
    return NodeReplies(
        said, [trip * (1 + 9 * (i % 2)) for i in range(answered)],
        [offset + 4 * trip * (i % 2) for i in range(answered)], calls,
        [0.2 * i for i in range(51) if not 0 < i <= lost])


def steps(values=None, **found):
    """Return status and message by step."""
    complete = {name: answers('ws' if name in ('kinematics', 'shape_sequencer') else 'rig')
                for name in ('tendon_actuation', 'jamming_valves', 'kinematics',
                             'shape_sequencer')}
    return {check.step: (check.status, check.message)
            for check in judged(complete | found, values or {}, '/')}


def test_a_sound_network_is_described():
    found = steps()
    assert {status for status, _ in found.values()} == {'OK'}
    assert found['computer ws'][1] == 'kinematics, shape_sequencer'
    assert found['round trip to rig'][1].startswith('median 55.0 ms, worst 100.0 ms; 0 of 100')
    assert found['clock of rig'][1] == '+0.0 ms from this one, known to 5.0 ms'
    assert found['messages from rig'][1] == '0 of 102 lost'


@pytest.mark.parametrize(('answer', 'step', 'status', 'words'), [
    (answers(trip=0.1), 'round trip to rig', 'FAIL', 'motions come late'),
    (answers(trip=0.04), 'round trip to rig', 'WARN', 'use a cable'),
    (answers(answered=48), 'round trip to rig', 'WARN', '4 of 100 calls unanswered'),
    (answers(answered=0), 'unanswered', 'FAIL', 'jamming_valves, tendon_actuation: found, but no'),
    (answers(lost=20), 'messages from rig', 'WARN', '40 of 102 lost'),
    (answers(offset=-0.1), 'clock of rig', 'WARN', 'are assigned to the wrong time'),
    (answers(offset=3.0), 'clock of rig', 'FAIL', '+3000.0 ms from this one, known to 5.0 ms'),
    (answers(trip=0.09, offset=0.06), 'clock of rig', 'OK', '+60.0 ms'),
    (answers(of='0.0.1'), 'version', 'FAIL', '0.0.1 of jamming_valves, tendon_actuation'),
    (answers(arm='f' * 16), 'description', 'FAIL', 'digests differ: ')])
def test_what_is_wrong_is_said(answer, step, status, words):
    found = steps(tendon_actuation=answer, jamming_valves=answer)[step]
    assert found[0] == status, found
    assert words in found[1]


def test_each_parameter_that_differs_is_named_with_both_values():
    arm, limits = 'arm.payload', 'pull_limits'
    found = steps({'tendon_actuation': {arm: 0.0, limits: [-0.06, 0.06]},
                   'kinematics': {arm: 0.1}, 'shape_sequencer': {arm: 0.1, limits: [-0.05, 0.05]}},
                  tendon_actuation=answers(arm='f' * 16))
    assert found['description'][1].startswith(
        'arm.payload is 0.1 for kinematics on ws, shape_sequencer on ws and 0.0 for '
        'tendon_actuation on rig; motion is refused')
    assert found['other parameters'] == (
        'WARN', 'pull_limits is [-0.05, 0.05] for shape_sequencer on ws and [-0.06, 0.06] for '
        'tendon_actuation on rig; start every node with the same files')


def test_a_node_that_runs_twice_or_not_at_all_is_named():
    twice = answers()
    twice.said = [*answers('ws').said, *twice.said]
    assert steps(tendon_actuation=twice)['tendon_actuation'] == (
        'FAIL', 'runs on rig and ws; end all but one')
    alone = {check.step: check for check in judged({'camera': answers()}, {}, '/')}
    assert alone['missing'].message.startswith('tendon_actuation, jamming_valves, kinematics')
    nobody, = judged({}, {}, '/left')
    assert nobody.status == 'FAIL'
    assert 'no node answers in namespace /left' in nobody.message
