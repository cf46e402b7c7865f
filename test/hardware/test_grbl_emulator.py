# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The emulated GRBL board answers and moves as GRBL 1.1 does."""

import os

import pytest
import serial

from soft_continuum.hardware.clock import Clock, STEADY
from soft_continuum.sim.emulators.grbl import GrblEmulator
from soft_continuum.sim.emulators.grbl_firmware import RECEIVE_BUFFER
from support.driver_waits import until
from support.grbl_rig import board

MILLIMETRES = {
    11: 0.01, 24: 25, 25: 500, 27: 1,
    **{n + i: value for n, value in ((100, 200), (110, 3000), (120, 500), (130, 200))
       for i in range(3)}}
"""Settings of a board that is used for something else: 200 steps/mm."""


class Terminal:
    """A person at a terminal."""

    def __init__(self, emulator):
        self.port = serial.Serial(emulator.port, 115200)
        self.clock = emulator.clock
        self.received = b''

    def send(self, text):
        self.port.write(text)

    def line(self):
        """The next line that is not empty."""
        while True:
            line, end, rest = self.received.partition(b'\n')
            if end:
                self.received = rest
                if text := line.decode().strip():
                    return text
            else:
                assert self.clock.wait([self.port.fileno()], 20.0), 'no more lines'
                self.received += os.read(self.port.fileno(), 4096)

    def read(self, end):
        """Lines up to one that ends so."""
        lines = []
        while not (lines and lines[-1].endswith(end)):
            lines.append(self.line())
        return lines

    def ask(self, line):
        """Answer to one line: the last is its acknowledgement."""
        self.send(line.encode() + b'\n')
        lines = []
        while not (lines and (lines[-1] == 'ok' or lines[-1].startswith('error'))):
            lines.append(self.line())
        return lines

    def status(self):
        self.send(b'?')
        return self.read('>')[-1]


@pytest.fixture
def at_terminal():
    with board(settings=MILLIMETRES) as emulator:
        terminal = Terminal(emulator)
        yield emulator, terminal
        terminal.port.close()


def test_status_settings_and_offsets_are_reported(at_terminal):
    _, terminal = at_terminal
    assert terminal.status() == '<Idle|MPos:0.000,0.000,0.000|FS:0,0|WCO:0.000,0.000,0.000>'
    assert {'$1=255', '$10=1', '$100=200.000', 'ok'} <= set(terminal.ask('$$'))
    assert '[TLO:0.000]' in terminal.ask('$#')
    assert terminal.ask('$I')[0].startswith('[VER:1.1')


@pytest.mark.parametrize(('line', 'answer'), [
    ('', 'ok'), ('$J=G91X1', 'error:22'), ('$J=X', 'error:2'), ('$J=G2X1F1', 'error:16'),
    ('$', 'ok'), ('$H', 'error:5'), ('$20=1', 'error:10'), ('$Q', 'error:3'), ('M3', 'error:20'),
    ('=', 'error:1'), ('$J=X1X1F1', 'error:25'),
    ('G1X1', 'error:22'), ('x' * 90, 'error:11'), ('$120=400', 'ok'),
    ('$X', 'ok'), (' g53 g0 x 0 ', 'ok')])
def test_every_line_is_answered_once(at_terminal, line, answer):
    _, terminal = at_terminal
    assert terminal.ask(line)[-1] == answer
    assert terminal.ask('$X')[-1] == 'ok'


@pytest.mark.parametrize(('line', 'end'), [
    ('$J=G91X5F1000', (1000, 0, 0)), ('$J=G20X1F100', (5080, 0, 0)),
    ('G0X1Y-2', (200, -400, 0)), ('G91G1X1Z1F600', (200, 0, 200)),
    ('$J=G53G90X2Y3F2000', (400, 600, 0)), ('$J=G53G91X2Y3F2000', (400, 600, 0)),
    ('$J=G91X1(Y1)F1000;Z1', (200, 0, 0)), ('$J=G91X0.00000012345F1000', (0, 0, 0))])
def test_a_motion_ends_on_its_step(at_terminal, line, end):
    emulator, terminal = at_terminal
    assert terminal.ask(line) == ['ok']
    until(emulator, lambda: terminal.status().startswith('<Idle'))
    assert emulator.motors == end


def test_work_offsets_shift_what_g90_means_but_not_the_machine(at_terminal):
    emulator, terminal = at_terminal
    terminal.ask('G92X5')
    terminal.ask('$J=G90X6F1000')
    until(emulator, lambda: emulator.motors == (200, 0, 0) and not emulator.moving)
    terminal.ask('$10=0')
    assert 'WPos:6.000,' in terminal.status()


def test_a_motion_takes_the_time_that_speed_and_acceleration_need(at_terminal):
    emulator, terminal = at_terminal
    begin = emulator.time
    terminal.ask('$J=G91X30F1800')  # 1 s at 30 mm/s, and 0.06 s for the ramps at 500 mm/s^2
    until(emulator, lambda: terminal.status().startswith('<Idle'))
    assert emulator.firmware.stood_since - begin == pytest.approx(1.06, abs=0.1)


def test_a_hold_in_a_program_waits_and_goes_on_only_when_told(at_terminal):
    emulator, terminal = at_terminal
    terminal.ask('G91G1X10F1200')
    until(emulator, lambda: emulator.motors[0] > 200)
    terminal.send(b'!')
    until(emulator, lambda: terminal.status().startswith('<Hold:0'))
    assert 200 < emulator.motors[0] < 2000
    terminal.send(b'~')
    until(emulator, lambda: emulator.motors[0] == 2000)


@pytest.mark.parametrize('byte', [b'!', b'\x85'])
def test_a_jog_is_cancelled_and_forgotten(at_terminal, byte):
    emulator, terminal = at_terminal
    terminal.ask('$J=G91X10F1200')
    until(emulator, lambda: emulator.motors[0] > 200)
    terminal.send(byte)
    until(emulator, lambda: terminal.status().startswith('<Idle'))
    where = emulator.motors[0]
    assert 200 < where < 2000
    terminal.ask('$J=G91X1F1200')
    until(emulator, lambda: emulator.motors[0] == where + 200)


def test_a_feed_hold_at_rest_stays_pending(at_terminal):
    emulator, terminal = at_terminal
    terminal.send(b'!')
    assert terminal.status().startswith('<Hold:0')
    terminal.send(b'\x18')
    terminal.read('help]')
    assert emulator.energised


def test_a_soft_reset_in_motion_drops_the_load_and_locks(at_terminal):
    emulator, terminal = at_terminal
    terminal.ask('$J=G91X10F1200')
    until(emulator, lambda: emulator.motors[0] > 200)
    terminal.send(b'\x18')
    assert 'ALARM:3' in terminal.read('unlock]')
    assert not emulator.energised
    where = emulator.motors[0]
    assert terminal.ask('$J=G91X1F100')[-1] == 'error:8'
    assert terminal.ask('G0X0')[-1] == 'error:9'
    assert f'MPos:{where / 200:.3f},' in terminal.status()
    assert terminal.ask('$X')[-1] == 'ok'
    assert terminal.status().startswith('<Idle')
    until(emulator, lambda: emulator.energised)


def test_a_reset_at_the_board_says_zero_wherever_the_motors_are(at_terminal):
    emulator, terminal = at_terminal
    terminal.ask('$J=G91X1F1200')
    until(emulator, lambda: emulator.motors[0] == 200)
    emulator.reset()
    assert terminal.status().startswith('<Idle|MPos:0.000,')
    assert emulator.motors[0] == 200


@pytest.mark.parametrize('number', [1, 2])
def test_a_critical_alarm_is_silent_until_a_soft_reset(at_terminal, number):
    emulator, terminal = at_terminal
    emulator.alarm(number)
    terminal.read('continue]')
    terminal.send(b'?$X\n')
    assert not terminal.clock.wait([terminal.port.fileno()], 0.5)
    terminal.send(b'\x18')
    terminal.read('unlock]')
    assert terminal.ask('$X')[-1] == 'ok'


def test_homing_is_silent_and_soft_limits_follow():
    with board(settings={**MILLIMETRES, 22: 1, 23: 2}, switches=(3.0, -4.0)) as emulator:
        terminal = Terminal(emulator)
        terminal.ask('$20=1')
        assert terminal.ask('$J=G91X1F100') == ['error:8']
        terminal.send(b'$H\n?')
        assert terminal.read('ok') == ['ok']
        # Off the switches by $27; X counts from its switch down, Y from the other end up.
        assert emulator.motors[:2] == (400, -600)
        assert terminal.status().startswith('<Idle|MPos:-1.000,-199.000,0.000')
        assert terminal.ask('$J=G53X1F100') == ['error:15']
        assert 'ALARM:2' in terminal.ask('G53G0X1')
        terminal.port.close()


def test_homing_without_switches_is_an_alarm(at_terminal):
    emulator, terminal = at_terminal
    terminal.ask('$22=1')
    assert 'ALARM:9' in terminal.ask('$H')
    assert emulator.firmware.state == 'Alarm'


def test_fifteen_motions_are_planned_and_what_no_buffer_holds_is_lost(at_terminal):
    emulator, terminal = at_terminal
    for _ in range(40):
        terminal.send(b'$J=G91X0.5F60\n')
    until(emulator, lambda: len(emulator.firmware.received) >= 16)
    terminal.status()
    assert len(emulator.firmware.planner.blocks) == 15
    line = len('$J=G91X0.5F60\n')
    assert RECEIVE_BUFFER - line <= len(emulator.firmware.buffer) <= RECEIVE_BUFFER
    assert len(emulator.firmware.received) < 20


def test_a_junction_is_passed_without_stopping_and_a_corner_is_not():
    times = []
    for second in ('X5', 'X-5'):
        with board(settings=MILLIMETRES) as emulator:
            terminal = Terminal(emulator)
            begin = emulator.time
            terminal.send(f'$J=G91X5F1800\n$J=G91{second}F1800\n'.encode())
            terminal.read('ok')
            firmware = emulator.firmware
            until(emulator, lambda f=firmware: f.state == 'Idle' and len(f.received) == 2)
            times.append(emulator.firmware.stood_since - begin)
            terminal.port.close()
    assert times[1] - times[0] == pytest.approx(0.06, abs=0.03)


def test_time_can_pass_faster():
    with GrblEmulator(clock=Clock(20.0), settings=MILLIMETRES) as emulator:
        terminal = Terminal(emulator)
        begin, real = emulator.time, STEADY()
        terminal.ask('$J=G91X30F600')
        until(emulator, lambda: emulator.motors[0] == 6000)
        assert emulator.time - begin == pytest.approx(20.0 * (STEADY() - real), abs=0.5)
        terminal.port.close()
