# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``install-service`` in a home of its own, with boards that are not there."""

from io import StringIO
import os
from pathlib import Path
import shlex
import shutil
import subprocess
import sys
from types import SimpleNamespace

import pytest

from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.ros.environment import choose_log_folder, discard_old_logs, require_log_folder
from soft_continuum.ros.names import NODES
from soft_continuum.ui.cli import install_service
from soft_continuum.ui.cli.install_service import (
    Board,
    boards_of,
    ports_of,
    systemd_units,
    udev_rules,
)
from soft_continuum.ui.cli.main import main
from soft_continuum.user_files import description_file

RIG = """\
/**:
  ros__parameters:
    tendon_driver: grbl
    grbl: {port: %s}
    jamming_driver: modbus
    modbus: {port: %s}
"""


def board(device, **changes):
    """Return a port as pyserial lists it."""
    return SimpleNamespace(**{'device': device, 'vid': 0x0403, 'pid': 0x6014,
                              'serial_number': 'FT123', 'location': '1-2:1.0', **changes})


@pytest.fixture
def home(tmp_path, monkeypatch):
    """Return where the files of the user are; one board of two is plugged in."""
    monkeypatch.setenv('XDG_CONFIG_HOME', str(tmp_path / 'config'))
    monkeypatch.setenv('XDG_STATE_HOME', str(tmp_path / 'state'))
    monkeypatch.setattr(install_service, 'comports', lambda: [board('/dev/ttyUSB0')])
    yield tmp_path / 'config'


def files(home):
    return {path.name: path.read_text(encoding='utf-8')
            for path in home.rglob('*') if path.is_file()}


def answer(monkeypatch, text):
    monkeypatch.setattr(sys, 'stdin', StringIO(text))


def test_everything_is_shown_and_nothing_is_written_without_a_yes(
        home, tmp_path, monkeypatch, capsys):
    rig = tmp_path / 'my rig.yaml'
    rig.write_text(RIG % ('/dev/ttyUSB0', '/dev/ttyUSB9'), encoding='utf-8')
    command = ['install-service', '--params-file', str(description_file()),
               '--params-file', str(rig), '--domain', '7', '--namespace', 'left']
    for given in ('no\n', ''):
        answer(monkeypatch, given)
        assert main(command) == 1
        assert not files(home)
    capsys.readouterr()
    answer(monkeypatch, 'perhaps\nyes\n')
    assert main(command) == 0
    shown, written = capsys.readouterr().out, files(home)
    assert {*written} == {'soft_continuum_left@.service', 'soft_continuum_left.target',
                          '99-soft_continuum.rules'}
    assert all(text in shown for text in written.values())
    # What takes root, or starts something, is said.
    for line in ('sudo cp', 'udevadm control --reload', 'systemctl --user enable --now',
                 'loginctl enable-linger', '/dev/soft_continuum/grbl', 'No rule for modbus'):
        assert line in shown
    assert main(command) == 1  # the end of the input is no yes
    assert 'unchanged' in capsys.readouterr().out
    assert main(['install-service', '--remove', '--namespace', 'left', '--yes']) == 0
    assert not files(home)
    assert main(['install-service', '--remove', '--yes']) == 2
    assert 'nothing to remove' in capsys.readouterr().err


def start_line(unit):
    line, = (line for line in unit.splitlines() if line.startswith('ExecStart='))
    return shlex.split(line.partition('=')[2])


def test_a_unit_starts_one_node_again_unless_it_was_given_what_it_does_not_take(home, capsys):
    assert main(['install-service', '--nodes', 'hardware', '--yes']) == 0
    written = files(home)
    unit = written['soft_continuum@.service'].splitlines()
    words = start_line(written['soft_continuum@.service'])
    assert words[:4] == [sys.executable, '-m', 'soft_continuum', '%i']
    # The log is that of systemd, which is bounded; every path is whole.
    assert words[-1] == '--disable-external-lib-logs'
    assert Path(words[words.index('--params-file') + 1]).is_absolute()
    assert {'Restart=on-failure', 'RestartPreventExitStatus=2', 'KillSignal=SIGINT'} <= {*unit}
    # The zeros of servos are where this user's programs look for them, not where systemd would.
    assert {f'Environment="{name}={os.environ[name]}"'
            for name in ('XDG_STATE_HOME', 'XDG_CONFIG_HOME')} <= {*unit}
    target = written['soft_continuum.target']
    assert [node for node in NODES if f'@{node}.service' in target] == [
        'tendon_actuation', 'jamming_valves']


def test_an_arm_without_jamming_has_no_service_for_it(home):
    path = str(description_file('tendon_arm'))
    assert main(['install-service', '--params-file', path, '--yes']) == 0
    target = files(home)['soft_continuum.target']
    assert '@kinematics.service' in target and 'jamming' not in target


@pytest.mark.skipif(not shutil.which('systemd-analyze'), reason='needs systemd')
def test_systemd_takes_the_units(home, tmp_path):
    odd = tmp_path / 'a "b" $c %d \\e.yaml'
    shutil.copy(description_file(), odd)
    assert main(['install-service', '--params-file', str(odd), '--yes']) == 0
    folder = home / 'systemd' / 'user'
    checked = subprocess.run(
        ['systemd-analyze', '--user', 'verify', str(folder / 'soft_continuum.target'),
         str(folder / 'soft_continuum@kinematics.service')], text=True, capture_output=True,
        env={**os.environ, 'XDG_RUNTIME_DIR': str(tmp_path)}, check=False)
    assert (checked.returncode, checked.stderr) == (0, '')


@pytest.mark.parametrize(('options', 'reason'), [
    (('--params-file', 'missing.yaml'), 'missing.yaml'),
    (('--namespace', 'a b'), 'namespace'),
    (('--domain', '233'), '0 to 232'),
    (('--nodes', 'some'), 'hardware'),
    (('--yess',), '--yes'),
])
def test_wrong_input_is_refused_and_nothing_is_written(home, capsys, options, reason):
    try:
        status = main(['install-service', '--yes', *options])
    except SystemExit as end:
        status = end.code
    said = capsys.readouterr().err
    assert status == 2 and reason in said and said.count('\n') == 1
    assert not files(home)


def test_a_folder_that_cannot_be_written_is_named(tmp_path, monkeypatch, capsys):
    (tmp_path / 'config').write_text('a file, not a folder')
    monkeypatch.setenv('XDG_CONFIG_HOME', str(tmp_path / 'config'))
    assert main(['install-service', '--yes']) == 2
    assert 'XDG_CONFIG_HOME' in capsys.readouterr().err


def test_a_line_break_reaches_no_unit():
    with pytest.raises(ParameterError, match='control character'):
        systemd_units('', ['kinematics'], ['python', '%i', 'my\nExecStartPre=evil.yaml'], {})
    with pytest.raises(ParameterError, match='control character'):
        systemd_units('', ['kinematics'], ['python', '%i'], {'PATH': '/bin\n[Install]'})


def test_boards_get_names_by_what_they_are_and_by_their_socket_without_a_number():
    ports = ports_of({'grbl.port': '/dev/ttyUSB0 /dev/ttyUSB1', 'modbus.port': '/dev/ttyUSB2',
                      'other.port': '', 'grbl.baud_rate': 115200})
    found = boards_of(ports, [board('/dev/ttyUSB0'), board(
        '/dev/ttyUSB2', vid=0x1a86, serial_number=None, location='1-3.4:1.0')])
    assert found == {'grbl_1': Board('grbl_1', 0x0403, 0x6014, 'FT123', '1-2'),
                     'modbus': Board('modbus', 0x1a86, 0x6014, '', '1-3.4')}
    rules = udev_rules(found.values())
    first, latency, comment, second = rules.splitlines()[1:]
    assert 'ATTRS{idVendor}=="0403"' in first and 'ATTRS{serial}=="FT123"' in first
    assert 'SYMLINK+="soft_continuum/grbl_1"' in first and 'GROUP="dialout"' in first
    assert 'ATTR{latency_timer}="1"' in latency
    assert comment.startswith('#') and 'KERNELS=="1-3.4"' in second
    # What a device calls itself is no part of the language of rules.
    evil = Board('grbl', 1, 2, 'x", RUN+="/bin/sh\n*[', '')
    line = udev_rules([evil]).splitlines()[1:]
    assert len(line) == 1 and 'RUN' in line[0] and line[0].count('"') == 16 and '*' not in line[0]


@pytest.mark.parametrize('blocked', ['a file', 'a folder in /proc'])
def test_a_folder_for_logs_that_cannot_be_written_is_named(tmp_path, blocked):
    (tmp_path / 'file').write_text('')
    folder = tmp_path / 'file' / 'log' if blocked == 'a file' else Path('/proc/none')
    with pytest.raises(ParameterError, match=f'logs to {folder}: .*; set ROS_LOG_DIR to a folder'):
        require_log_folder({'ROS_LOG_DIR': str(folder)})
    with pytest.raises(ParameterError, match=f'logs to {folder}/log: .*ROS_LOG_DIR'):
        require_log_folder({'ROS_HOME': str(folder)})
    require_log_folder({'ROS_LOG_DIR': str(tmp_path / 'new' / 'log')})


def test_old_logs_are_discarded_and_those_of_others_are_not(tmp_path, monkeypatch):
    environment = {'ROS_HOME': str(tmp_path)}
    choose_log_folder(environment)
    folder = Path(environment['ROS_LOG_DIR'])
    assert folder == tmp_path / 'log' / 'soft_continuum'
    discard_old_logs(environment)  # there is none yet
    folder.mkdir(parents=True)
    other = folder.parent / 'python_1.log'
    kept = folder / 'notes.txt'
    for number, path in enumerate([other, kept, *(folder / f'{n}.log' for n in range(6))]):
        path.write_bytes(b'x' * 100)
        os.utime(path, (number, number))
    left = lambda: {path.stem for path in folder.glob('*.log')}  # noqa: E731
    discard_old_logs(environment, max_files=5)
    assert left() == {'1', '2', '3', '4', '5'}
    discard_old_logs(environment, max_bytes=350)
    assert left() == {'3', '4', '5'} and other.exists() and kept.exists()
    discard_old_logs({**environment, 'ROS_LOG_DIR': str(folder.parent)}, max_files=0)
    assert other.exists()
