# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What the programs of all emulated devices have in common: a port, typed faults, an end."""

import os
import subprocess
import sys

import pytest

from soft_continuum.hardware.serial_ports import open_serial
from soft_continuum.sim.emulators import dynamixel, grbl, modbus
from soft_continuum.sim.emulators.dynamixel_packets import Instruction, packet
from support.grbl_rig import board
from support.modbus_line import emulated
from support.servo_rig import servos

PROGRAMS = {'grbl': grbl, 'dynamixel': dynamixel, 'modbus': modbus}
MAKE = {'grbl': board, 'dynamixel': lambda **options: servos(2, **options), 'modbus': emulated}


@pytest.mark.parametrize('name', PROGRAMS)
def test_the_link_is_there_while_the_device_is_plugged_in(name, tmp_path):
    link = tmp_path / 'rig'
    with MAKE[name](link=link) as emulator:
        for _ in range(2):
            assert emulator.port == str(link) and os.path.realpath(link) == emulator.name
            PROGRAMS[name].execute_command(emulator, 'unplug')
            assert not os.path.lexists(link)
            PROGRAMS[name].execute_command(emulator, 'plug')
    assert not os.path.lexists(link)


@pytest.mark.parametrize('name', PROGRAMS)
def test_a_link_never_replaces_a_file_and_what_cannot_be_made_is_an_error(name, tmp_path, capsys):
    path = tmp_path / 'rig'
    path.write_text('precious')
    for link in path, tmp_path / 'missing' / 'port':
        assert PROGRAMS[name].main(['--link', str(link)]) == 1
        assert f'emulate {name}:' in capsys.readouterr().err
    assert path.read_text() == 'precious'


@pytest.mark.parametrize('name', PROGRAMS)
def test_every_command_is_listed_and_does_something(name):
    with MAKE[name]() as emulator:
        module = PROGRAMS[name]
        listed = module.execute_command(emulator, 'help')
        for command, each in module.COMMANDS.items():
            assert command in listed
            if command not in ('stuck-output', 'stuck-regulator'):  # of rigs with regulators
                assert module.execute_command(
                    emulator, ' '.join([command, *('1' for _ in each.arguments.split())]))


@pytest.mark.parametrize(('name', 'line', 'words'), [
    ('grbl', 'dance', 'unknown command dance; type help'), ('grbl', 'alarm', 'takes: ALARM'),
    ('grbl', 'alarm 0', 'allowed: 1 to 9'), ('grbl', 'alarm 1.5', 'whole numbers'),
    ('grbl', 'late-ok nan', 'SECONDS is nan'), ('grbl', 'drop-ok -1', 'allowed'),
    ('grbl', 'drop-ok 1 2', 'takes: COUNT'), ('grbl', 'reset 1', 'takes: no arguments'),
    ('dynamixel', 'hang 3', 'N is 3; allowed: 1 to 2'),
    ('modbus', 'late', 'takes: SECONDS'), ('modbus', 'drop 2', 'allowed: 0 to 1'),
    ('modbus', 'late x', 'SECONDS is x'), ('modbus', 'stuck-coil 4', 'allowed: 0 to 3'),
    ('modbus', 'broken-wire 0', 'allowed: 1 to 3'), ('modbus', 'leak 1.5 10', 'whole numbers'),
    ('modbus', 'refuse 1e999', 'CODE is 1e999')])
def test_a_line_that_is_wrong_is_explained(name, line, words):
    with MAKE[name]() as emulator, pytest.raises(ValueError, match=words):
        PROGRAMS[name].execute_command(emulator, line)


@pytest.mark.parametrize(('name', 'options', 'printed', 'request_', 'reply', 'state'), [
    ('grbl', (), 'steps_per_mm: [200.0, 200.0]', b'?', b'<Idle|', 'holding'),
    ('dynamixel', ('--baud-rate', '57600'), 'ids: [1, 2]', packet(1, Instruction.PING),
     b'\xff\xff\xfd\x00\x01\x07\x00\x55', 'torque off'),
    ('modbus', ('--stiff', '--segments', '2', '--baud-rate', '0'), 'valve_coils: [1.0, 2.0]',
     bytes.fromhex('01 01 0000 0003 7c0b'), bytes.fromhex('01 01 01 07 104a'), 'segment 2')])
def test_a_program_serves_the_port_that_it_says_until_it_is_ended(
        name, options, printed, request_, reply, state, tmp_path):
    link = tmp_path / 'rig'
    with subprocess.Popen(
            [sys.executable, '-m', 'soft_continuum', f'{name}_emulator', '--link', str(link),
             *options], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            shown = ''
            while 'Type a fault' not in shown:
                shown += process.stdout.readline()
            assert f'{link}' in shown and printed in shown
            with open_serial(str(link), 57600) as line:
                line.timeout = 20.0  # s
                line.write(request_)
                assert line.read(len(reply)) == reply
            rest, _ = process.communicate('nonsense\nstate\nquit\n', timeout=60)
        finally:
            process.kill()
        assert 'unknown command nonsense' in rest and state in rest
        assert process.returncode == 0
    assert not link.is_symlink()
