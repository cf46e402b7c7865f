# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The doctor finds each fault of a rig, says what to do, and touches nothing."""

import grp  # noqa: F401  # before the user loses the right to read the standard library
import json
import os
import subprocess
import sys

import pytest
import serial

from soft_continuum.commissioning import doctor
from soft_continuum.commissioning.doctor import check_jamming, check_tendons
from soft_continuum.ros.description import load_rig
from support.descriptions import section
from support.emulated_rig import emulated_rig, reference, TIMEOUT

WRITE_COIL = 5


@pytest.fixture(autouse=True)
def real_time(monkeypatch):
    """Let every system allow real-time priority."""
    monkeypatch.setattr(doctor, 'priority_allowed', lambda: (True, True))


@pytest.fixture
def rig(tmp_path):
    with emulated_rig(tmp_path) as found:
        yield found


@pytest.fixture
def ask(capsys):
    """Return a function that runs the doctor: its exit status, and its checks by step."""
    def run(*files):
        arguments = [word for file in files for word in ('--params-file', str(file))]
        status = doctor.main(['--json', *arguments])
        document = json.loads(capsys.readouterr().out)
        assert (document['result'] == 'OK') == (status == 0)
        return status, {c['step']: (c['status'], c['message']) for c in document['checks']}

    return run


def test_a_sound_rig_passes_every_check_and_nothing_is_moved_or_switched(rig, ask):
    reference(rig)
    for _ in range(5):  # a busy computer may miss a reply
        status, found = ask(rig.file)
        if all(s == 'OK' for s, _ in found.values()):
            break
    assert status == 0
    assert list(found) == [
        'packages', 'model', 'parameters', 'control threads', 'serial ports', 'tendon port',
        'tendon firmware', 'tendon settings', 'tendon reference', 'jamming port', 'relay board',
        'analog board',
        'modbus round trip', 'pump and valves', 'segment 1', 'segment 2', 'segment 3']
    assert {step: s for step, (s, _) in found.items() if s != 'OK'} == {}
    assert rig.grbl.motors == (0, 0, 0)
    assert rig.modbus.requests
    assert not any(request[1] == WRITE_COIL for request in rig.modbus.requests)


def test_threads_that_may_have_to_wait_are_named_on_a_rig_alone(rig, ask, monkeypatch):
    monkeypatch.setattr(doctor, 'priority_allowed', lambda: (False, False))
    status, message = ask(rig.file)[1]['control threads']
    assert status == 'WARN' and ' - rtprio 20"' in message
    assert ask()[1]['control threads'][0] == 'OK'


def test_a_simulated_rig_is_called_simulated(ask):
    status, found = ask()
    assert status == 0
    assert 'simulated' in found['tendon driver simulated'][1]
    assert 'simulated' in found['jamming driver simulated'][1]


def test_there_is_one_line_per_step_and_a_summary(rig, capsys):
    rig.modbus.segments[1].broken_wire = True
    assert doctor.main(['--params-file', str(rig.file)]) == 1
    *lines, empty, summary = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines].count('FAIL') == 1
    assert sum(line.startswith('FAIL  segment 2: no pressure') for line in lines) == 1
    assert (empty, summary) == ('', '17 checks: 1 failed, 1 to be looked at')


@pytest.mark.parametrize(('options', 'named'), [
    ('--parameters x', '--parameters'), ('--duration 2', '--duration'),
    ('--sensors --params-file my_rig.yaml', '--params-file'), ('--sensors --duration 0', "'0'"),
    ('--network --sensors', '--sensors'), ('--network --params-file my.yaml', '--sensors'),
    ('--network --duration 5', '--sensors')])
def test_options_that_there_are_not_or_do_not_go_together_are_a_usage_error(
        capsys, options, named):
    with pytest.raises(SystemExit) as ended:
        doctor.main(options.split())
    assert ended.value.code == 2
    assert named in capsys.readouterr().err


def test_parameters_that_are_missing_wrong_or_read_differently_are_named(rig, ask, tmp_path):
    status, found = ask(tmp_path / 'nowhere.yaml')
    assert status == 1
    assert 'nowhere.yaml: cannot be read' in found['parameters'][1]
    other = tmp_path / 'other.yaml'
    for node, line, words in (
            ('kinematics', 'arm.gravity: 0.0', 'sets arm.gravity for kinematics alone'),
            ('shape_sequencer', 'tension_limit: 7.0',
             'tension_limit is 60.0 for tendon_actuation and 7.0 for shape_sequencer')):
        other.write_text(section(node, line))
        status, found = ask(rig.file, other)
        assert status == 1
        assert words in found['parameters'][1]
    rig.parameters(grbl__prot='x')
    assert 'did you mean grbl.port?' in ask(rig.file)[1]['parameters'][1]


@pytest.mark.parametrize(('numba', 'environment', 'status', 'said'), [
    ({'numba.py': 'raise RuntimeError("of another NumPy")\n'}, {}, 1,
     ['FAIL  model: does not compile: RuntimeError: of another NumPy']),
    ({'numba.py': 'raise ImportError("none here")\n'}, {}, 0,
     ['WARN  model: works, but numba is not installed']),
    ({'numba/__init__.py': 'class config:\n    CACHE_DIR = ""\n\n\n'
                           'def njit(**options):\n    return lambda function: function\n',
      'numba/core/__init__.py': '',
      'numba/core/cpu.py': 'class CPUTargetOptions:\n    pass\n'}, {'PATH': ''}, 0,
     ['WARN  model: works, but every start takes seconds longer', 'there is no C++ compiler'])])
def test_a_model_that_does_not_compile_or_is_slow_is_a_diagnosis_not_a_traceback(
        tmp_path, numba, environment, status, said):
    for name, text in numba.items():  # while nothing is built yet
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    done = subprocess.run(
        [sys.executable, '-m', 'soft_continuum', 'doctor'], capture_output=True, text=True,
        env={**os.environ, 'PYTHONPATH': f'{tmp_path}:{os.environ.get("PYTHONPATH", "")}',
             'XDG_CACHE_HOME': str(tmp_path), **environment}, check=False)
    assert 'Traceback' not in done.stderr
    assert done.returncode == status, done.stderr
    assert all(words in done.stdout for words in said)


@pytest.mark.parametrize(('parameter', 'step'), [
    ('grbl__port', 'tendon port'), ('modbus__port', 'jamming port')])
def test_a_port_that_is_missing_or_in_use_is_called_so(rig, ask, parameter, step):
    port = str(rig.grbl.port if 'grbl' in parameter else rig.modbus.port)
    with serial.Serial(port, exclusive=True):
        status, found = ask(rig.file)
        assert status == 1
        assert found[step][0] == 'FAIL'
        assert 'in use by another program' in found[step][1]
    rig.parameters(**{parameter: '/dev/nothing'})
    found = ask(rig.file)[1]
    assert found[step][0] == 'FAIL'
    assert 'does not exist' in found[step][1]
    rig.parameters(**{parameter: ''})
    assert 'no serial port is configured' in ask(rig.file)[1][step][1]


@pytest.mark.parametrize(('device', 'check', 'step'), [
    ('grbl', check_tendons, 'tendon port'), ('modbus', check_jamming, 'jamming port')])
def test_a_port_that_the_user_may_not_open_names_the_group(rig, device, check, step):
    port = os.path.realpath(getattr(rig, device).port)
    rig.parameters(**{f'{device}__port': port})
    values = load_rig([rig.file])
    os.chmod(port, 0)
    root = os.geteuid() == 0
    if root:
        os.seteuid(65534)  # root may open everything
    try:
        found, *others = check(values)
    finally:
        if root:
            os.seteuid(0)
    assert (found.step, found.status, others) == (step, 'FAIL', [])
    assert 'sudo usermod -aG' in found.message


def test_steppers_without_a_zero_are_to_be_referenced(rig, ask):
    assert ask(rig.file)[1]['tendon reference'][0] == 'WARN'
    reference(rig)
    assert ask(rig.file)[1]['tendon reference'][0] == 'OK'
    rig.grbl.reset()
    status, message = ask(rig.file)[1]['tendon reference']
    assert status == 'WARN'
    assert 'calibrate zero' in message


def lose_the_second_reply(rig):
    replies = []

    def lose(reply):
        replies.append(reply)
        return b'' if len(replies) == 2 else reply
    rig.modbus.transform = lose


def delay_one_reply(rig):
    def one_is_late(reply):
        rig.modbus.late = 0.0 if rig.modbus.late else 0.6 * TIMEOUT
        rig.modbus.transform = None if rig.modbus.late == 0.0 else one_is_late
        return reply
    rig.modbus.transform = one_is_late


FAULTS = {
    'a port name that does not stay with its device': (
        lambda rig: rig.parameters(grbl__port=os.path.realpath(rig.grbl.port)),
        'serial ports', 'WARN',
        ['grbl.port may be another device after the next start', '/dev/serial/by-id']),
    'two devices on one port': (
        lambda rig: rig.parameters(modbus__port=str(rig.grbl.port)),
        'serial ports', 'FAIL', ['the same port']),
    'a stepper board that does not answer': (
        lambda rig: setattr(rig.grbl, 'hang', True),
        'tendon firmware', 'FAIL', ['check grbl.port, grbl.baud_rate and the power']),
    'a locked stepper board': (
        lambda rig: rig.grbl.alarm(1), 'tendon firmware', 'FAIL', ['power-cycle']),
    'settings that contradict the parameters': (
        lambda rig: rig.grbl.firmware.settings.update({1: 25.0, 101: 80.0}),
        'tendon settings', 'FAIL', ['$1=255', '$101=1 ']),  # the lines to type
    'a relay board that does not answer': (
        lambda rig: rig.parameters(modbus__relay_unit=17),
        'relay board', 'FAIL', ['Modbus unit 17']),
    'an analog board that does not answer': (
        lambda rig: rig.parameters(modbus__analog_unit=17),
        'analog board', 'FAIL', ['Modbus unit 17']),
    'coils that a board does not have': (
        lambda rig: rig.parameters(modbus__valve_coils=[1.0, 2.0, 30.0]),
        'relay board', 'FAIL', ['has no such address']),
    'a reply that is missed': (
        lose_the_second_reply,
        'relay board', 'WARN', ['1 of 5 replies missed: Modbus unit 1']),
    'replies that are slow for the timeout': (
        delay_one_reply,
        'modbus round trip', 'WARN', ['modbus.timeout is 1000 ms; set it to']),
    'registers that do not fit the arm': (
        lambda rig: rig.parameters(modbus__pressure_registers=[0.0, 1.0]),
        'jamming driver modbus', 'FAIL', ['modbus.pressure_registers has 2 entries']),
    'a pump that runs for nothing': (
        lambda rig: rig.modbus._set_coil(0, True), 'pump and valves', 'WARN', ['pump on']),
    'a sensor that shows vacuum in a vented segment': (
        lambda rig: setattr(rig.modbus.segments[0], 'stuck_at', 12000),
        'segment 1', 'FAIL', ['50.0 kPa of vacuum although it is vented']),
    'a sensor with a wrong zero': (
        lambda rig: setattr(rig.modbus.segments[0], 'stuck_at', 4800),
        'segment 1', 'WARN', ['adjust the zero']),
    'a sensor of an evacuated segment': (  # which is not judged
        lambda rig: rig.modbus._set_coil(2, True),
        'segment 2', 'WARN', ['vent it and run this again']),
}
SOUND = {'tendon firmware': 'segment 3', 'relay board': 'analog board',
         'analog board': 'relay board', 'segment 1': 'segment 2'}
"""What is still said to be sound beside a step that fails."""


@pytest.mark.parametrize('fault', FAULTS)
def test_a_fault_is_found_where_it_is_and_what_to_do_is_said(rig, ask, fault):
    bring_about, step, verdict, words = FAULTS[fault]
    bring_about(rig)
    status, found = ask(rig.file)
    assert (found[step][0], status) == (verdict, int(verdict == 'FAIL'))
    assert all(word in found[step][1] for word in words)
    if step in SOUND and verdict == 'FAIL':
        assert found[SOUND[step]][0] == 'OK'
