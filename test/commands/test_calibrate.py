# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Calibrating finds what is true of a rig, moves little, and leaves it safe however it ends."""

import signal

import pytest

from soft_continuum.commissioning import calibrate, calibrate_tendons
from soft_continuum.hardware.clock import STEADY
from soft_continuum.ros.description import load_rig
from soft_continuum.sim.emulators.grbl import GrblEmulator
from support.command import CTRL_C, Terminal
from support.emulated_rig import emulated_rig, is_referenced, reference, shorten, until

STEPS_PER_MM = 200


@pytest.fixture
def rig(request, tmp_path):
    with emulated_rig(tmp_path, real_time='on_terminal' in request.fixturenames) as found:
        yield found


@pytest.fixture
def run(rig, tmp_path, capsys):
    """Return a function that runs the command on the rig: exit status, output, errors."""
    def call(*arguments):
        try:
            status = calibrate.main(
                [*map(str, arguments), '--params-file', str(rig.file), '--output', str(tmp_path)])
        except SystemExit as ended:  # argparse
            status = ended.code
        return status, *capsys.readouterr()

    return call


@pytest.fixture
def answer(run, monkeypatch):
    """Return a function that runs the verb in a dialogue of (part of a question, answer)."""
    def call(dialogue, *arguments):
        remaining = list(dialogue)

        def typed(question):
            expected, text = remaining.pop(0)
            assert expected in question
            return text() if callable(text) else text

        monkeypatch.setattr('builtins.input', typed)
        ended = run(*arguments)
        assert not remaining, ended
        return ended

    return call


@pytest.fixture
def on_terminal(rig, tmp_path):
    """Return a function that starts the command on a terminal."""
    def start(*arguments):
        return Terminal('calibrate', *arguments, '--params-file', rig.file, '--output', tmp_path)

    return start


def standing(rig):
    """The position of both motors, once they stand."""
    until(lambda: not rig.grbl.moving, 'motors stand')
    return rig.grbl.motors[:2]


def with_results(rig, name):
    """What nodes read from the parameter files and the results after them."""
    return load_rig([rig.file, rig.file.with_name(name)])


# Steps


def test_steps_per_mm_come_from_measured_travel(rig, on_terminal):
    with on_terminal('steps', '--distance', '1') as terminal:
        terminal.answer('Ready?', 'yes')
        for side, travel in (('right', '0.8'), ('left', '1,01')):
            terminal.answer('note where its mark is.', 'yes')
            terminal.answer(f'was the {side} tendon really pulled in?', travel)
        assert terminal.status() == 0
    assert 'the zero must be set again' in terminal.output
    assert with_results(rig, 'calibration_steps.yaml')['grbl.steps_per_mm'] == (250.0, 198.02)


def test_only_the_tendon_to_be_measured_is_pulled_and_it_goes_back(rig, answer):
    def two_at(*motors):
        def measure():
            assert standing(rig) == motors
            return '2'
        return measure

    status, _, _ = answer([
        ('Ready?', 'yes'),
        ('Ready?', 'yes'), ('right tendon really pulled in?', two_at(2 * STEPS_PER_MM, 0)),
        ('Ready?', 'yes'), ('left tendon really pulled in?', two_at(0, 2 * STEPS_PER_MM)),
    ], 'steps', '--distance', 2)
    assert status == 0
    assert standing(rig) == (0, 0)


def test_an_answer_that_makes_no_sense_is_asked_for_again(rig, answer):
    status, output, errors = answer([
        ('Ready?', 'maybe'), ('Ready?', 'yes'), ('Ready?', 'yes'),
        *(('really pulled in?', text) for text in ('five', '-5', 'nan', '', '300', '5')),
        ('Ready?', 'no')], 'steps')
    assert status == 1
    assert "'maybe' was typed; allowed: yes, y, no, n" in output
    assert output.count('allowed: a number from') == 4
    assert '300.00 mm measured for 5.00 mm commanded; allowed: 0.50 mm to 50.00 mm' in output
    assert 'not confirmed, so nothing more was done' in errors
    assert not rig.file.with_name('calibration_steps.yaml').exists()


def test_steps_measured_before_move_nothing_and_take_the_zero_with_them_if_they_change(rig, run):
    reference(rig)
    assert run('steps', '--yes', '--measured', 5, 5)[0] == 0
    assert is_referenced(rig)
    status, output, _ = run('steps', '--yes', '--measured', 5, 4, '--force')
    assert status == 0
    assert 'the zero must be set again' in output
    assert not is_referenced(rig)
    assert rig.grbl.motors == (0, 0, 0)


# Signs


SIGNS_SEEN = [('Ready?', 'yes'), ('right tendon', 'pulled-in'), ('left tendon', 'pulled-in')]


def test_a_tendon_that_was_paid_out_gets_the_other_sign_and_no_zero_is_left(rig, answer):
    assert answer([
        ('Ready?', 'yes'),
        ('Was the right tendon pulled in, or paid out?', 'again'),
        ('Was the right tendon pulled in, or paid out?', 'paid-out'),
        ('Was the left tendon pulled in, or paid out?', 'pulled-in')], 'signs')[0] == 0
    assert with_results(rig, 'calibration_signs.yaml')['grbl.signs'] == (-1.0, 1.0)
    assert standing(rig) == (0, 0)
    assert not is_referenced(rig)  # it had one for as long as it moved
    reference(rig)
    assert answer(SIGNS_SEEN, 'signs', '--force')[0] == 0
    assert is_referenced(rig)  # one that was known before is kept


def test_signs_seen_before_change_those_that_are_configured(rig, run):
    rig.parameters(grbl__signs=[-1.0, -1.0])
    assert run('signs', '--yes', '--force', '--seen', 'paid-out', 'pulled-in')[0] == 0
    assert with_results(rig, 'calibration_signs.yaml')['grbl.signs'] == (1.0, -1.0)


# Zero


def test_jogging_takes_up_the_slack_and_sets_the_zero(rig, answer):
    status, output, _ = answer([
        ('Ready?', 'yes'),
        *(('TENDON MM, or done:', text) for text in (
            'r 1.5', 'left 2', 'l -0.5', 'r 2.1', 'x 1', 'r', 'done now', '1.5', 'done')),
        ('Ready?', 'yes')], 'zero')
    assert status == 0
    assert output.count('was typed; allowed:') == 5
    assert 'right 1.50 mm, left 1.50 mm' in output
    assert 'The controller keeps it' in output
    assert standing(rig) == (300, 300)
    assert is_referenced(rig)


def test_slack_known_before_is_taken_up_without_asking_also_of_a_board_that_keeps_no_zero(
        rig, run, monkeypatch):
    status, output, _ = run('zero', '--yes', '--take-up', 1, 0.5)
    assert status == 0
    assert 'The straight arm is zero' in output
    assert rig.grbl.motors[:2] == (200, 100)
    assert is_referenced(rig)
    sleep = STEADY.sleep

    def reset(seconds):
        sleep(seconds)
        if seconds == calibrate_tendons.MARK_TIME:
            rig.grbl.reset()
    monkeypatch.setattr(STEADY, 'sleep', reset)
    status, output, _ = run('zero', '--yes', '--take-up', 0, 0)
    assert status == 0
    assert 'does not keep it, because opening its port resets it' in output


# Whatever moves tendons


def test_tendons_move_only_once_a_segment_is_soft(rig, run):
    rig.modbus._set_coil(0, True)
    for valve in (1, 2, 3):
        rig.modbus._set_coil(valve, True)
    until(lambda: rig.modbus.vacuum(2) > 80e3, 'all stiff')
    rig.modbus.stick_sensor(2)
    status, _, errors = run('zero', '--yes', '--take-up', 1, 1)
    assert status == 1
    assert 'segment 3 is not soft' in errors
    assert rig.grbl.motors == (0, 0, 0)
    rig.modbus.repair()
    status, _, errors = run('zero', '--yes', '--take-up', 1, 1)
    assert status == 0, errors
    assert rig.modbus.coils == (True, True, True, False)


@pytest.mark.parametrize('how', [CTRL_C, signal.SIGTERM])
def test_an_interrupt_in_motion_brings_the_motors_to_rest(rig, on_terminal, how):
    with on_terminal('steps', '--distance', '10') as terminal:
        terminal.answer('Ready?', 'yes')
        terminal.answer('note where its mark is.', 'yes')
        until(lambda: rig.grbl.motors[0] > 100, 'in motion')
        if how == CTRL_C:
            terminal.type(CTRL_C)
        else:
            terminal.process.send_signal(how)
        assert terminal.status() == 130
    assert 'Traceback' not in terminal.output
    assert 'interrupted' in terminal.output
    assert 100 < standing(rig)[0] < 10 * STEPS_PER_MM
    assert rig.grbl.energised
    assert not is_referenced(rig)
    assert not rig.file.with_name('calibration_steps.yaml').exists()


def test_a_board_that_goes_silent_in_motion_ends_the_command(rig, on_terminal):
    with on_terminal('steps', '--distance', '10') as terminal:
        terminal.answer('Ready?', 'yes')
        terminal.answer('note where its mark is.', 'yes')
        until(lambda: rig.grbl.motors[0] > 100, 'in motion')
        rig.grbl.unplug()
        assert terminal.status() == 1
    assert 'Traceback' not in terminal.output
    assert 'power-cycle it before anything else' in terminal.output
    assert standing(rig)[0] < 10 * STEPS_PER_MM


def test_without_anybody_to_answer_nothing_is_done(rig, run, monkeypatch):
    def nobody(_):
        raise EOFError
    monkeypatch.setattr('builtins.input', nobody)
    for what in ('steps', 'signs', 'zero', 'vacuum', 'all'):
        status, _, errors = run(what)
        assert status == 1
        assert 'use a terminal, or give the answers as options' in errors
    assert rig.grbl.motors == (0, 0, 0)
    assert not any(request[1] == 5 for request in rig.modbus.requests)


@pytest.mark.parametrize(('arguments', 'words'), [
    # What only a user can see must be given.
    (('steps', '--yes'), '--measured'), (('signs', '--yes'), '--seen'),
    (('zero', '--yes'), '--take-up'),
    (('zero', '--yes', '--take-up', 3, 0), 'pull_limits: -60.00 and 1.00 mm'),
    (('vacuum', '--measured', 5, 5), '--measured is for calibrate steps and calibrate all')])
def test_options_that_are_missing_out_of_bounds_or_of_another_procedure_are_a_usage_error(
        rig, run, arguments, words):
    rig.parameters(pull_limits=[-0.06, 0.001])
    status, _, errors = run(*arguments)
    assert status == 2
    assert words in errors
    assert rig.grbl.motors == (0, 0, 0)


# Vacuum


def test_the_vacuum_test_finds_what_the_emulated_plant_is(rig, run):
    shorten(rig)
    status, output, _ = run('vacuum', '--yes', '--leak-time', 2)
    assert status == 0, output
    assert output.count(' good') == 1
    found = with_results(rig, 'calibration_vacuum.yaml')
    # What the emulated rig is made of.  A busy computer samples it coarsely, so that times seem
    # longer; test/hardware/test_calibration.py claims them in time of its own.
    for name, true, longer in (('ultimate_vacuum', 94e3, 1.0), ('evacuation_time', 0.4, 3.0),
                               ('venting_time', 0.6, 3.0), ('leak_rate', 500.0, 1.0)):
        assert 0.7 * true < found[f'simulated_jamming.{name}'] < 1.3 * longer * true, name
    assert rig.modbus.coils == (False,) * 4


def test_a_segment_that_leaks_and_one_that_never_stiffens_are_named(rig, run):
    rig.modbus.segments[0].set_leak(5000.0)
    rig.modbus.segments[2].set_leak(150e3)
    status, output, errors = run('vacuum', '--yes', '--leak-time', 1)
    assert status == 1
    assert 'segment 1: leaks: the pump would start every' in output
    assert 'segment 3: never stiff' in output
    assert 'segment 2: ' not in output
    assert 'segment 3 does not become stiff' in errors
    assert with_results(rig, 'calibration_vacuum.yaml')['simulated_jamming.leak_rate'] > 1000.0


def test_a_valve_that_stays_open_does_not_keep_the_others_and_the_pump_on(rig, run):
    for coil in range(4):
        rig.modbus._set_coil(coil, True)
    rig.modbus.stuck.add(1)
    status, _, errors = run('vacuum', '--yes')
    assert status == 1
    assert 'coil 1 (valve of segment 1)' in errors
    assert rig.modbus.coils == (False, True, False, False)


def test_a_terminal_that_is_closed_while_the_pump_runs_switches_it_off(rig, on_terminal):
    interrupts = []

    def interrupt(reply):
        if rig.modbus.coils == (True, True, False, False) and not interrupts:
            interrupts.append(terminal.process.send_signal(signal.SIGHUP))
        return reply

    with on_terminal('vacuum') as terminal:
        rig.modbus.transform = interrupt
        terminal.answer('Ready?', 'yes')
        assert terminal.status() == 130
    assert interrupts
    assert 'Traceback' not in terminal.output
    assert rig.modbus.coils == (False,) * 4


# All, and the file


def test_all_goes_through_everything_and_writes_one_file(rig, run):
    shorten(rig)
    status, output, errors = run(
        'all', '--yes', '--leak-time', 1, '--seen', 'pulled-in', 'paid-out', '--measured', 5, 5,
        '--take-up', 1, 1)
    assert status == 0, errors
    found = with_results(rig, 'calibration.yaml')
    assert found['grbl.signs'] == (1.0, -1.0)
    assert found['grbl.steps_per_mm'] == (200.0, 200.0)
    assert found['simulated_jamming.leak_rate'] > 0.0
    assert rig.grbl.motors[:2] == (200, -200)  # the left motor has the other sign by now
    assert is_referenced(rig)


def test_what_went_well_is_kept_when_a_later_step_fails(rig, run):
    shorten(rig)
    status, _, errors = run(
        'all', '--yes', '--leak-time', 1, '--seen', 'pulled-in', 'pulled-in', '--measured', 1, 5,
        '--take-up', 1, 1)
    assert status == 1
    assert '$110 is 450000, needed: $110=2250000' in errors
    assert with_results(rig, 'calibration.yaml')['grbl.steps_per_mm'] == (1000.0, 200.0)
    assert rig.grbl.motors == (0, 0, 0)


def test_results_that_exist_are_overwritten_only_by_force(rig, run, tmp_path):
    file = tmp_path / 'calibration_steps.yaml'
    file.write_text('mine')
    status, _, errors = run('steps', '--yes', '--measured', 5, 5)
    assert status == 2
    assert '--force' in errors
    assert file.read_text() == 'mine'
    assert run('steps', '--yes', '--measured', 5, 5, '--force')[0] == 0
    assert 'steps_per_mm' in file.read_text()
    assert [path.name for path in tmp_path.glob('.*')] == []


def test_results_for_a_controller_that_is_not_there_are_not_kept(tmp_path, capsys):
    status = calibrate.main(['steps', '--yes', '--measured', '5', '4', '--output', str(tmp_path)])
    assert status == 0
    assert 'is not kept: tendon_driver is simulated' in capsys.readouterr().out
    assert list(tmp_path.iterdir()) == []


def test_a_simulated_rig_is_calibrated_like_a_real_one(answer, rig):
    rig.parameters(tendon_driver='simulated', jamming_driver='simulated',
                   simulated_jamming__venting_time=0.03, simulated_jamming__evacuation_time=0.03)
    status, output, _ = answer(SIGNS_SEEN, 'signs')
    assert status == 0
    assert 'The valves are simulated' in output


# More tendons than one board has, and no segment that could be stiff.

SPATIAL = {
    'segment_lengths': [0.08], 'outer_diameters': [0.02], 'bending_stiffnesses': [7e-4],
    'segment_masses': [0.004], 'disc_heights': [0.01, 0.005], 'disc_masses': [0.01, 0.003],
    'bending_angle_limits': [1.5], 'guide_offsets': [0.008], 'jamming': False,
    'tendon_names': ['north', 'east', 'south', 'west'],
    'tendon_angles': [0.0, 1.5708, 3.1416, 4.7124], 'tendon_ends': [1, 1, 1, 1]}


@pytest.fixture
def two_boards(rig, tmp_path):
    """Change the rig to an arm with two tendons on each of two boards; return both boards."""
    with GrblEmulator(str(tmp_path / 'grbl_2')) as second:
        rig.parameters(
            arm=SPATIAL, grbl__port=f'{tmp_path / "grbl"} {tmp_path / "grbl_2"}',
            grbl__steps_per_mm=[200.0] * 4, grbl__signs=[1.0] * 4, jamming_driver='simulated')
        yield rig.grbl, second


def test_signs_and_steps_of_tendons_on_several_boards(rig, two_boards, answer):
    moved = []

    def seen(text):
        def look():
            moved.append([board.motors[:2] for board in two_boards])
            return text
        return look
    words = ('pulled-in', 'paid-out', 'pulled-in', 'paid-out')
    status, output, errors = answer([('Ready?', 'yes'), *(
        (f'Was the {name} tendon pulled in', seen(word))
        for name, word in zip(SPATIAL['tendon_names'], words, strict=True))], 'signs')
    assert status == 0, errors
    assert moved == [[(400, 0), (0, 0)], [(0, 400), (0, 0)], [(0, 0), (400, 0)],
                     [(0, 0), (0, 400)]]
    assert with_results(rig, 'calibration_signs.yaml')['grbl.signs'] == (1.0, -1.0, 1.0, -1.0)
    status, output, _ = answer([], 'steps', '--measured', 5, 4, 5, 10)
    assert status == 0
    assert with_results(rig, 'calibration_steps.yaml')['grbl.steps_per_mm'] == (
        200.0, 250.0, 200.0, 100.0)


def test_the_zero_of_tendons_on_several_boards(rig, two_boards, answer):
    status, output, errors = answer([
        ('Ready?', 'yes'), ('done', 'w 1'), ('done', 'north -0.5'), ('done', 'done'),
        ('Ready?', 'yes')], 'zero')
    assert status == 0, errors
    assert [board.motors[:2] for board in two_boards] == [(-100, 0), (0, 200)]
    assert 'The controller keeps it' in output


@pytest.mark.parametrize(('arguments', 'words'), [
    (('steps', '--measured', '1', '2'),
     '--measured has 2 values; needed: one for each of north, east, south, west'),
    (('vacuum',), 'arm.jamming is false'),
    (('zero', '--yes'), 'give --take-up NORTH EAST SOUTH WEST')])
def test_what_is_not_of_this_arm_is_refused(two_boards, run, arguments, words):
    status, _, errors = run(*arguments)
    assert status == 2
    assert words in errors
