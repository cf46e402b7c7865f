# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The command line operates the arm, and says by its exit status how it went."""

import json
from math import radians
from pathlib import Path
import re
import signal
from time import monotonic

import pytest

from soft_continuum.client.own_file import save_sequence, save_shape
from soft_continuum.hardware.clock import STEADY
from soft_continuum.ui.cli.operate import cached_shapes
from soft_continuum.user_files import saved_shapes
from support.driver_waits import until

DONE, FAILED, NO_NODES, INTERRUPTED = 0, 1, 3, 130
REACHED = 1e-2  # rad
TIMEOUT = 60.0  # s


@pytest.fixture
def documents(call):
    """Return a function that runs a verb with --json: its documents."""
    return lambda *words: [json.loads(line) for line in call(*words, '--json')[1].splitlines()]


def test_the_shape_library_is_listed_for_people_and_for_programs(arm, call, documents):
    status, output, _ = call('shapes')
    assert status == DONE
    assert re.search(r'^c_form +\+36\.0 +\+36\.0 +\+36\.0 deg$', output, re.MULTILINE)
    assert documents('shapes')[0]['shapes']['s_form'] == pytest.approx(
        [radians(36), -radians(36), radians(36)])
    assert cached_shapes() == ['c_form', 'upright_c_form', 's_form']  # for the next TAB


def test_a_run_prints_a_line_per_phase_and_reaches_its_shapes(arm, call, documents):
    status, output, errors = call('run', 'c_form', '--angles', '-10,5,5', '--hold', '0.1')
    assert (status, errors) == (DONE, '')
    assert 'c_form, segment 2: moving' in output
    assert 'done' in output.splitlines()[-2:]  # then what was reached, if that is reported
    assert len(output.splitlines()) == len(set(output.splitlines()))
    assert documents('status')[0]['bending_angles'] == pytest.approx(
        [radians(-10), radians(5), radians(5)], abs=REACHED)


def test_what_was_saved_is_listed_and_run_by_its_name_as_often_as_it_says(arm, call, documents):
    save_shape('lean', (radians(5), 0.0, 0.0))
    save_sequence('nod', [('lean', 0.1), ('lean', 0.0)], 2)
    try:
        assert re.search(r'^lean +\+5\.0 +\+0\.0 +\+0\.0 deg, saved$', call('shapes')[1],
                         re.MULTILINE)
        listed, = documents('shapes')
        assert (list(listed['saved_shapes']), list(listed['saved_sequences'])) == (
            ['lean'], ['nod'])
        ran = documents('run', 'nod')
        assert [d['shapes_completed'] for d in ran if 'result' in d] == [2, 2]
        assert {d['shape'] for d in ran if 'shape' in d} == {'lean'}
        assert len([d for d in documents('run', 'lean', '--repeat', '1') if 'result' in d]) == 1
    finally:
        saved_shapes().unlink()


def test_a_run_on_a_terminal_shows_a_bar_that_fills(arm, command):
    status, output, _ = command('run', '--angles=5,5,5', terminal=True).end()
    assert status == DONE
    assert '\r[' in output and f'[{"#" * 24}] 100 %' in output


def test_a_run_in_json_is_a_document_per_line_and_the_last_is_the_result(arm, documents):
    *progress, result = documents('run', '--angles', '5,5,5')
    assert progress[-1]['fraction'] == pytest.approx(1.0)
    assert {'shape_index', 'shape', 'segment', 'phase'} < progress[0].keys()
    assert 'reached' in result  # null where that is not reported
    assert {**result, 'reached': None} == {
        'result': 'done', 'outcome': 'SUCCESSFUL', 'message': '', 'shapes_completed': 1,
        'reached': None}


def test_what_the_sequencer_rejects_is_one_line_on_stderr(arm, call, documents):
    status, output, errors = call('run', 'no_form')
    assert (status, output) == (FAILED, '')
    assert errors.startswith('soft_continuum run: shape_sequencer: shape 1: unknown shape')
    assert errors.count('\n') == 1
    refused, = documents('run', 'no_form')
    assert refused['result'] == 'failed' and 'known: c_form' in refused['message']


@pytest.mark.parametrize(('number', 'options'), [
    (signal.SIGTERM, []), (signal.SIGINT, ['--json'])])
def test_an_interrupt_cancels_the_run_and_waits_until_the_arm_is_stiff(
        arm, command, documents, number, options):
    run = command('run', 'c_form', '--hold', '600', *options)
    run.wait_for('moving')
    run.process.send_signal(number)
    status, output, errors = run.end()
    assert status == INTERRUPTED
    if options:
        assert json.loads(output.splitlines()[-1])['outcome'] == 'CANCELED'
    else:
        assert 'canceling; press Ctrl-C again to exit at once' in output
        assert errors == 'soft_continuum run: CANCELED: canceled by the client\n'
    assert documents('status')[0]['stiff'] == [True] * 3
    assert arm.wait_for_status('shape_sequencer', 'last', 'CANCELED')


def test_a_second_interrupt_leaves_at_once(make_rig, command):
    rig = make_rig()
    # Slow to stiffen: the arm would need minutes to come to rest.
    rig.start_arm(simulated_jamming__evacuation_time=90.0, jamming_timeout=600.0)
    run = command('run', 'c_form')
    run.wait_for('moving')
    run.process.send_signal(signal.SIGINT)
    run.wait_for('canceling')
    run.process.send_signal(signal.SIGINT)
    assert run.end()[0] == INTERRUPTED
    assert 'CANCELED' not in rig.status_value('shape_sequencer', 'last')


def test_a_stop_of_another_client_ends_a_run(arm, command, call):
    run = command('run', 'c_form', '--hold', '600')
    run.wait_for('moving')
    status, output, _ = call('stop')
    assert (status, output) == (DONE, 'stopped, holding tension; nothing moves before '
                                         '`soft_continuum resume`\n')
    status, _, errors = run.end()
    assert status == FAILED
    assert errors.startswith('soft_continuum run: STOPPED: ')
    status, _, errors = call('run', 'c_form')
    assert status == FAILED and 'type `soft_continuum resume` first' in errors
    assert call('resume')[0] == DONE
    assert call('run', '--angles', '0,0,0')[0] == DONE


def test_segments_and_tendons_are_operated_by_hand(straight, call, documents):
    assert call('jog', 'right=1')[::2] == (
        FAILED, 'soft_continuum jog: tendon_actuation: every segment is stiff; soften one first '
        '(`soft_continuum soften N`)\n')
    assert call('soften', '3')[:2] == (DONE, 'segment 3 is soft\n')
    assert call('jog', 'right=1', 'left=-1.5')[:2] == (
        DONE, 'pulls: right_tendon +1.00 mm, left_tendon -1.50 mm\n')
    assert call('jog', 'left=-0.5', 'right_tendon=0.5')[:2] == (
        DONE, 'pulls: right_tendon +1.50 mm, left_tendon -2.00 mm\n')
    assert call('stiffen', '3')[:2] == (DONE, 'segment 3 is stiff\n')
    assert documents('stiffen', 'all') == [{'result': 'done', 'message': 'all segments are stiff'}]


def test_an_interrupted_jog_holds_the_tendons(straight, command):
    straight.soften(3)
    jog = command('jog', 'left=-50')
    straight.wait_for(lambda: straight.pulls[1] < -1e-3, 'a motion')
    jog.process.send_signal(signal.SIGINT)
    assert jog.end() == (INTERRUPTED, '', '')
    straight.wait_for(lambda: straight.at_rest, 'rest')
    assert straight.pulls[1] > -49e-3


def test_the_status_shows_tendons_segments_and_nodes(straight, call, documents):
    status, output, _ = call('status')
    assert status == DONE
    assert 'tendons    right_tendon +0.00 mm, left_tendon +0.00 mm' in output
    assert re.search(r'^segment 2  stiff +\d+\.\d kPa', output, re.MULTILINE)
    assert re.search(r'^shape_sequencer +ok: idle', output, re.MULTILINE)
    state, = documents('status')
    assert state['tensions'] == [None, None]  # nothing determines them: not NaN, which is no JSON
    assert [node['name'] for node in state['nodes']] == [
        'tendon_actuation', 'jamming_valves', 'kinematics', 'shape_sequencer']


def test_a_watch_goes_on_until_it_is_interrupted_or_its_reader_has_seen_enough(straight, command):
    watch, lines, shapes = command('watch', '--json'), command('watch'), command('shapes')
    shapes.stop_reading()
    lines.wait_for('stiff stiff stiff |   +0.0   +0.0   +0.0 deg | predicted | idle\n')
    lines.stop_reading()
    watch.wait_for('}\n{')
    watch.wait_for('"stiff": [true, true, true]')
    watch.process.send_signal(signal.SIGINT)
    assert len(watch.documents()) > 1
    for process in (watch, lines, shapes):
        assert process.end()[::2] == (DONE, '')


def test_reference_and_reset_say_what_they_did(straight, call):
    assert 'counts as the straight arm' in call('reference')[1]
    assert 'assumed straight' in call('reset')[1]


@pytest.mark.parametrize('words', [
    ('shapes',), ('run', 'c_form'), ('stiffen', '1'), ('soften', '1'), ('jog', 'right=1'),
    ('status',), ('watch',), ('stop',), ('resume',), ('reference',), ('reset',)])
def test_without_nodes_every_verb_says_how_to_start_them(call, words):
    status, output, errors = call(*words, timeout=0.05)
    assert (status, output) == (NO_NODES, '')
    assert errors.startswith(f'soft_continuum {words[0]}: tendon_actuation, jamming_valves, '
                             'kinematics, shape_sequencer do not run in namespace /arm_under_test')
    assert './run up' in errors
    assert errors.count('\n') == 1


def test_an_interrupt_while_nodes_are_looked_for_ends_quietly(command):
    run = command('run', 'c_form', timeout=600.0)
    maps = Path(f'/proc/{run.process.pid}/maps')
    until(STEADY, lambda: 'librmw' in maps.read_text(encoding='utf-8'), 'it begins to connect')
    run.process.send_signal(signal.SIGINT)
    assert run.end() == (INTERRUPTED, '', '')


def test_an_interrupt_before_it_has_begun_ends_quietly(command):
    run = command('run', 'c_form', timeout=600.0)
    status = Path(f'/proc/{run.process.pid}/status')
    deadline = monotonic() + TIMEOUT

    def caught():
        return int(re.search(r'SigCgt:\s*(\w+)', status.read_text(encoding='ascii'))[1], 16)

    interpreter_handles = 1 << signal.SIGINT - 1
    while not caught() & interpreter_handles:  # Python starts
        assert monotonic() < deadline
    while caught() & interpreter_handles and monotonic() < deadline:  # the first lines have run
        if 'librmw' in Path(f'/proc/{run.process.pid}/maps').read_text(encoding='utf-8'):
            break
    run.process.send_signal(signal.SIGINT)
    ended, output, errors = run.end()
    assert ended in (INTERRUPTED, -signal.SIGINT)
    assert (output, errors) == ('', '')


def test_a_namespace_that_ros_does_not_take_is_an_error_in_a_line(call):
    status, _, errors = call('stop', namespace='a b')
    assert status == FAILED
    assert "namespace 'a b' is not valid in ROS" in errors
