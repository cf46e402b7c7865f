# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""The keyboard of a terminal moves an arm; a terminal that is closed ends the motion."""

from collections.abc import Callable
import fcntl
import os
from pathlib import Path
import pty
import struct
import subprocess
import sys
import termios
import threading
import time
from typing import Any

from soft_continuum.teleop.dead_man import MOVE
from soft_continuum_interfaces.msg import TeleopState
from support.ros_rig import DEADLINE, LATCHED, Rig

RIGHT = b'\x1bOC'  # the arrow, as an xterm sends it
REPEAT = 0.03  # s


class Terminal:
    """An xterm in which soft_continuum teleop runs."""

    def __init__(self, rig: Rig, parameters: Path) -> None:
        self._master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack('HHHH', 12, 60, 0, 0))
        self.process = subprocess.Popen(
            [sys.executable, '-m', 'soft_continuum', 'teleop', '--namespace', rig.namespace,
             '--timeout', str(DEADLINE), '--params-file', str(parameters)],
            stdin=slave, stdout=slave, stderr=slave, start_new_session=True,
            preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
            env={**os.environ, 'ROS_DOMAIN_ID': str(rig.domain), 'TERM': 'xterm'})
        os.close(slave)
        self._screen = b''
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        try:
            while data := os.read(self._master, 4096):
                self._screen += data
        except OSError:  # closed
            pass

    @property
    def screen(self) -> str:
        """All that it has shown."""
        return self._screen.decode(errors='replace')

    def type(self, keys: bytes) -> None:
        """Type."""
        os.write(self._master, keys)

    def close(self) -> None:
        """Close the window."""
        os.close(self._master)


def test_a_key_that_is_held_moves_the_arm_until_the_terminal_is_closed(
        make_rig: Callable[..., Rig], tmp_path: Path) -> None:
    rig = make_rig()
    rig.start_arm(arm__gravity=9.806650001)  # the servo has to have every digit
    path = tmp_path / 'patient.yaml'
    path.write_text('/**: {ros__parameters: {teleop: {timeout: 2.0}}}', encoding='utf-8')
    states = rig.record(TeleopState, 'teleop/state', LATCHED)
    terminal = Terminal(rig, path)

    def wait_for(text: str, **fields: Any) -> None:
        rig.wait_for(
            lambda: states.last and text in states.last.message and all(
                getattr(states.last, name) == value for name, value in fields.items()),
            f'{text}; {states.last}; {terminal.screen[-500:]}')

    wait_for('no segment is chosen', connected=True)
    terminal.type(b'n')
    wait_for('segment 1 is not soft', segment=1)
    terminal.type(b's')
    wait_for(f'segment 1 is soft: {MOVE}')
    assert 'STOP' in terminal.screen

    deadline = time.monotonic() + DEADLINE
    while not (rig.moving and abs(rig.pulls[0]) > 0.001):
        assert time.monotonic() < deadline, terminal.screen[-500:]
        terminal.type(RIGHT)
        time.sleep(REPEAT)
    terminal.close()
    assert terminal.process.wait(DEADLINE) in (0, 1)
    rig.wait_for(lambda: rig.at_rest, 'rest')
    rig.assert_rests()
