# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The command line operates the arm, and says by its exit status how it went."""

import json
from math import radians
from pathlib import Path
import re
import signal
import subprocess
import sys
from time import monotonic

import pytest

from soft_continuum.cli.main import TOOLS

DONE, FAILED, BAD_USAGE, NO_NODES, INTERRUPTED = 0, 1, 2, 3, 130
SCRIPT = Path(__file__).parents[2] / 'bin' / 'soft_continuum'
REACHED = 1e-2  # rad
PATIENCE = 30.0  # s


def test_the_shape_library_is_listed_for_people_and_for_programs(arm, command):
    status, output, _ = command('shapes').end()
    assert status == DONE
    assert re.search(r'^c_form +\+36\.0 +\+36\.0 +\+36\.0 deg$', output, re.MULTILINE)
    library = command('shapes', '--json').documents()[0]['shapes']
    assert library['s_form'] == pytest.approx([radians(36), -radians(36), radians(36)])


def test_a_run_says_a_line_per_phase_and_reaches_its_shapes(arm, command):
    status, output, errors = command('run', 'c_form', '--angles', '-10,5,5', '--hold',
                                     '0.1').end()
    assert (status, errors) == (DONE, '')
    assert 'c_form, segment 2: moving' in output
    assert output.splitlines()[-1] == 'done'
    assert len(output.splitlines()) == len(set(output.splitlines()))
    state = command('status', '--json').documents()[0]
    assert state['bending_angles'] == pytest.approx(
        [radians(-10), radians(5), radians(5)], abs=REACHED)


def test_a_run_on_a_terminal_shows_a_bar_that_fills(arm, command):
    status, output, _ = command('run', '--angles=5,5,5', terminal=True).end()
    assert status == DONE
    assert '\r[' in output and f'[{"#" * 24}] 100 %' in output


def test_a_run_in_json_is_a_document_per_line_and_the_last_is_the_result(arm, command):
    *progress, result = command('run', '--angles', '5,5,5', '--json').documents()
    assert progress[-1]['fraction'] == pytest.approx(1.0)
    assert {'shape_index', 'shape', 'segment', 'phase'} < progress[0].keys()
    assert result == {'result': 'done', 'outcome': 'SUCCESSFUL', 'message': '',
                      'shapes_completed': 1}


def test_what_the_sequencer_rejects_is_one_line_on_stderr(arm, command):
    status, output, errors = command('run', 'no_form').end()
    assert (status, output) == (FAILED, '')
    assert errors.startswith('soft_continuum run: shape_sequencer: shape 1: unknown shape')
    assert errors.count('\n') == 1
    refused = command('run', 'no_form', '--json')
    assert 'known: c_form' in refused.documents()[0]['message']
    assert refused.end()[0] == FAILED


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_cancels_the_run_and_waits_until_the_arm_is_stiff(arm, command, number):
    run = command('run', 'c_form')
    run.wait_for('moving')
    run.process.send_signal(number)
    status, output, errors = run.end()
    assert status == INTERRUPTED
    assert 'canceling; Ctrl-C again leaves at once' in output
    assert errors == 'soft_continuum run: CANCELED: canceled by the client\n'
    assert command('status', '--json').documents()[0]['stiff'] == [True] * 3
    assert arm.wait_for_status('shape_sequencer', 'last', 'CANCELED')


def test_an_interrupted_run_in_json_says_so_in_json(arm, command):
    run = command('run', 'c_form', '--json')
    run.wait_for('moving')
    run.process.send_signal(signal.SIGINT)
    assert run.documents()[-1]['outcome'] == 'CANCELED'


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


def test_a_stop_of_another_client_ends_a_run(arm, command):
    run = command('run', 'c_form', 's_form')
    run.wait_for('moving')
    status, output, _ = command('stop').end()
    assert (status, output) == (DONE, 'stopped, holding tension; nothing moves before ~/resume\n')
    status, _, errors = run.end()
    assert status == FAILED
    assert errors.startswith('soft_continuum run: STOPPED: ')
    status, _, errors = command('run', 'c_form').end()
    assert status == FAILED and 'resume first' in errors
    assert command('resume').end()[0] == DONE
    assert command('run', '--angles', '0,0,0').end()[0] == DONE


def test_of_two_runs_at_once_the_newer_one_is_done(arm, command):
    older = command('run', 'c_form', '--hold', '600')
    older.wait_for('moving')
    newer = command('run', '--angles', '2,2,2')
    status, _, errors = older.end()
    assert status == FAILED and 'PREEMPTED' in errors
    assert newer.end()[0] == DONE


def test_segments_and_tendons_are_operated_by_hand(arm, command):
    assert command('jog', '--right', '1').end()[::2] == (
        FAILED, 'soft_continuum jog: tendon_actuation: every segment is stiff; soften one first '
        '(jamming_valves/segment_N/set_stiff)\n')
    assert command('soften', '3').end()[:2] == (DONE, 'segment 3 is soft\n')
    assert command('jog', '--right', '1', '--left', '-1.5').end()[:2] == (
        DONE, 'pulls: right +1.00 mm, left -1.50 mm\n')
    assert command('stiffen', '3').end()[:2] == (DONE, 'segment 3 is stiff\n')
    assert command('stiffen', 'all', '--json').documents() == [
        {'result': 'done', 'message': 'all segments are stiff'}]
    status, _, errors = command('soften', '4').end()
    assert status == FAILED
    assert 'there is no segment 4; the segments are 1 to 3' in errors


def test_an_interrupted_jog_holds_the_tendons(arm, command):
    arm.soften(3)
    jog = command('jog', '--right', '12', '--left', '-14')
    arm.wait_for(lambda: arm.pulls[0] > 1e-3, 'a motion')
    jog.process.send_signal(signal.SIGINT)
    assert jog.end() == (INTERRUPTED, '', '')
    arm.wait_for(lambda: not arm.moving, 'rest')
    assert arm.pulls[0] < 11e-3


def test_the_status_shows_tendons_segments_and_nodes(arm, command):
    status, output, _ = command('status').end()
    assert status == DONE
    assert 'tendons    right +0.00 mm, left +0.00 mm' in output
    assert re.search(r'^segment 2  stiff +\d+\.\d kPa', output, re.MULTILINE)
    assert re.search(r'^shape_sequencer +ok: idle', output, re.MULTILINE)
    state = command('status', '--json').documents()[0]
    assert state['tensions'] == [None, None]  # nothing determines them: not NaN, which is no JSON
    assert [node['name'] for node in state['nodes']] == [
        'tendon_actuation', 'jamming_valves', 'kinematics', 'shape_sequencer']


def test_a_watch_goes_on_until_it_is_interrupted(arm, command):
    watch = command('watch', '--json')
    watch.wait_for('}\n{')
    watch.wait_for('"stiff": [true, true, true]')
    watch.process.send_signal(signal.SIGINT)
    assert len(watch.documents()) > 1
    assert watch.end()[0] == DONE
    lines = command('watch')
    lines.wait_for('stiff stiff stiff |   +0.0   +0.0   +0.0 deg | idle\n')
    lines.process.send_signal(signal.SIGINT)
    assert lines.end()[::2] == (DONE, '')


def test_a_reader_that_has_seen_enough_ends_a_command_quietly(arm, command):
    for words in ('watch',), ('shapes',), ('status', '--json'):
        process = command(*words)
        process.stop_reading()
        assert process.end()[::2] == (DONE, '')


def test_reference_and_reset_say_what_they_did(arm, command):
    assert 'counts as the straight arm' in command('reference').end()[1]
    assert 'taken to be straight' in command('reset').end()[1]


@pytest.mark.parametrize('words', [
    ('shapes',), ('run', 'c_form'), ('stiffen', '1'), ('soften', '1'), ('jog', '--right', '1'),
    ('status',), ('watch',), ('stop',), ('resume',), ('reference',), ('reset',)])
def test_without_nodes_every_command_says_how_to_start_them(command, words):
    status, output, errors = command(*words, timeout=0.5).end()
    assert (status, output) == (NO_NODES, '')
    assert errors.startswith(f'soft_continuum {words[0]}: tendon_actuation, jamming_valves, '
                             'kinematics, shape_sequencer do not run in namespace /arm_under_test')
    assert './run up' in errors
    assert errors.count('\n') == 1


def test_an_interrupt_while_nodes_are_looked_for_ends_quietly(command):
    run = command('run', 'c_form', timeout=600.0)
    maps = Path(f'/proc/{run.process.pid}/maps')
    deadline = monotonic() + PATIENCE
    while 'librmw' not in maps.read_text(encoding='utf-8'):  # it has begun to connect
        assert monotonic() < deadline
    run.process.send_signal(signal.SIGINT)
    assert run.end() == (INTERRUPTED, '', '')


def test_an_interrupt_before_it_has_begun_ends_quietly(command):
    run = command('run', 'c_form', timeout=600.0)
    status = Path(f'/proc/{run.process.pid}/status')
    deadline = monotonic() + PATIENCE

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


@pytest.mark.parametrize(('words', 'reason'), [
    ((), 'required: COMMAND'),
    (('fly',), "invalid choice: 'fly'"),
    (('run',), 'give a SHAPE or --angles'),
    (('run', '--angles', '10,x'), "'10,x' given; needed: a bending angle in degrees"),
    (('run', '--angles', '-nan,1,2'), 'expected one argument'),
    (('run', 'c_form', '--hold', '-1'), "'-1' given; allowed: 0 to 86400 s"),
    (('run', 'c_form', '--hold', 'nan'), "'nan' given; allowed: 0 to 86400 s"),
    (('soften', 'x'), "'x' given; needed: the number of a segment"),
    (('soften', 'all'), "'all' given; needed: the number of a segment"),
    (('stiffen', '0'), "'0' given; needed: the number of a segment"),
    (('jog',), 'give --right or --left, or both'),
    (('jog', '--right', 'inf'), "'inf' given; allowed: -1000 to 1000 mm"),
    (('stop', '--timeout', '0'), "'0' given; allowed: 0.01 to 3600 s"),
    (('--json', 'doctor'), 'doctor comes first: soft_continuum doctor ...'),
    (('completion', 'fish'), "invalid choice: 'fish'"),
])
def test_wrong_usage_is_said_with_what_is_allowed(words, reason):
    ran = subprocess.run([sys.executable, '-m', 'soft_continuum', *words], capture_output=True,
                         text=True, timeout=60)
    assert ran.returncode == BAD_USAGE
    assert reason in ran.stderr
    assert 'Traceback' not in ran.stderr


def test_a_namespace_that_ros_does_not_take_is_an_error_in_a_line(command):
    status, _, errors = command('stop', namespace='a b').end()
    assert status == FAILED
    assert "namespace 'a b' is not one that ROS takes" in errors


@pytest.mark.parametrize('tool', sorted(TOOLS))
def test_the_tools_are_there_with_their_own_options(tool):
    ran = subprocess.run([sys.executable, '-m', 'soft_continuum', tool, '--help'],
                         capture_output=True, text=True, timeout=60)
    assert ran.returncode == DONE
    assert f'usage: {tool}' in ran.stdout


def test_a_stop_imports_no_mechanics():
    ran = subprocess.run(
        [sys.executable, '-c', 'import sys; from soft_continuum.cli import main, operate; '
         'import soft_continuum.client; print(*sys.modules)'],
        capture_output=True, text=True, timeout=60, check=True)
    assert not {'numba', 'scipy', 'matplotlib', 'soft_continuum.mechanics'} & set(
        ran.stdout.split())


def test_the_installed_script_is_the_same_program():
    ran = subprocess.run([sys.executable, SCRIPT, '--help'], capture_output=True, text=True,
                         timeout=60)
    assert ran.returncode == DONE
    assert 'stiffen' in ran.stdout


# Tab completion.

def complete(words, names=''):
    """Return what bash offers for the last of ``words``; ``names``: of the shape library."""
    script = '\n'.join((
        f'soft_continuum() {{ [[ "$*" == "completion shapes" ]] && echo "{names}"; }}',
        subprocess.run([sys.executable, '-m', 'soft_continuum', 'completion', 'bash'],
                       capture_output=True, text=True, timeout=60, check=True).stdout,
        f'COMP_WORDS=({" ".join(json.dumps(word) for word in words)})',
        f'COMP_CWORD={len(words) - 1}',
        '_soft_continuum',
        'printf "%s\\n" "${COMPREPLY[@]}"'))
    return subprocess.run(['bash', '-c', script], capture_output=True, text=True, timeout=60,
                          check=True).stdout.split()


@pytest.mark.parametrize(('words', 'offered'), [
    (('st',), ['stiffen', 'status', 'stop']),
    (('stiffen', ''), ['all']),
    (('run', 's_'), ['s_form']),
    (('run', 'c_form', '--h'), ['--help', '--hold']),
    (('--json', 'jog', '--r'), ['--right']),
])
def test_tab_completes_commands_options_and_shapes(words, offered):
    found = complete(('soft_continuum', *words), names='c_form s_form')
    assert set(offered) <= set(found)
    assert all(word.startswith(words[-1]) for word in found)


def test_the_names_of_the_shapes_are_there_for_completion(arm, command):
    assert command('completion', 'shapes').end()[:2] == (DONE, 'c_form\nupright_c_form\ns_form\n')
