# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The keyboard of a terminal moves an arm; a terminal that is closed ends the motion."""

import time

from soft_continuum.ui.teleop.joystick import MOVE
from soft_continuum_interfaces.msg import TeleopState
from support.command import Terminal
from support.ros_rig import DEADLINE, LATCHED

RIGHT = '\x1bOC'  # the arrow, as an xterm sends it
REPEAT = 0.03  # s


def test_a_key_that_is_held_moves_the_arm_until_the_terminal_is_closed(make_rig, tmp_path):
    rig = make_rig()
    rig.start_arm(arm__gravity=9.806650001)  # the servo has to have every digit
    path = tmp_path / 'patient.yaml'
    path.write_text('/**: {ros__parameters: {teleop: {timeout: 2.0}}}', encoding='utf-8')
    states = rig.record(TeleopState, 'teleop/state', LATCHED)
    terminal = Terminal(
        'teleop', '--namespace', rig.namespace, '--timeout', DEADLINE, '--params-file', path,
        size=(12, 60), ROS_DOMAIN_ID=str(rig.domain), TERM='xterm')

    def wait_for(text, **fields):
        rig.wait_for(
            lambda: states.last and text in states.last.message and all(
                getattr(states.last, name) == value for name, value in fields.items()),
            f'{text}; {states.last}; {terminal.output[-500:]}')

    wait_for('no segment is chosen', connected=True)
    terminal.type('n')
    wait_for('segment 1 is not soft', segment=1)
    terminal.type('s')
    wait_for(f'segment 1 is soft: {MOVE}')
    assert 'STOP' in terminal.output

    deadline = time.monotonic() + DEADLINE
    while not (rig.moving and abs(rig.pulls[0]) > 0.001):
        assert time.monotonic() < deadline, terminal.output[-500:]
        terminal.type(RIGHT)
        time.sleep(REPEAT)
    terminal.stop_reading()  # it closes
    assert terminal.process.wait(DEADLINE) in (0, 1)
    rig.come_to_rest()
