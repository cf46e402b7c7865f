# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A joystick moves an arm only while its enable button is held, and all is as it should be."""

import pytest

from soft_continuum.ui.teleop.joystick import EnableButton, PadState

HELD = frozenset({'enable'})
REST = PadState()
GRIP = PadState(pressed=HELD)
PUSH = PadState((0.5, 0.0, 0.0), HELD)
PERIOD = 0.05


class Sender:
    """Sends what a joystick shows, twenty times per second; its clock is 1000 s ahead."""

    def __init__(self):
        self.enable_button = EnableButton(timeout=0.25, unchanged_timeout=5.0)
        self.now = 10.0

    def show(self, *controls, count=1, delay=0.0):
        for one in controls * count:
            self.now += PERIOD
            self.enable_button.receive(one, self.now, self.now + 1000.0 - delay)
        return self.enable_button.stick(self.now)


@pytest.fixture
def joystick():
    return Sender()


def test_it_moves_while_the_button_is_held_and_not_a_message_longer(joystick):
    assert joystick.show(REST, PadState((1.0, 0.0, 0.0))) is None
    assert joystick.show(REST, GRIP, PUSH) == PUSH.stick
    assert joystick.show(PadState(PUSH.stick)) is None


def test_a_stick_that_was_not_at_rest_does_nothing_until_it_was(joystick):
    assert joystick.show(REST, PUSH, count=3) is None
    assert 'not at rest (x +0.50)' in joystick.enable_button.problem
    assert joystick.show(GRIP, PUSH) == PUSH.stick


def test_a_button_that_was_held_from_the_beginning_has_to_be_released(joystick):
    assert joystick.show(GRIP, PUSH) is None
    assert 'release the enable button' in joystick.enable_button.problem
    assert joystick.show(REST, GRIP, PUSH) == PUSH.stick


def test_without_messages_it_ends_and_does_not_go_on_by_itself(joystick):
    enable_button = joystick.enable_button
    joystick.show(REST, GRIP, PUSH)
    assert enable_button.stick(joystick.now + 0.25) == PUSH.stick
    assert enable_button.stick(joystick.now + 0.26) is None
    assert not enable_button.connected(joystick.now + 0.26)
    assert 'nothing received' in enable_button.problem
    joystick.now += 1.0
    assert joystick.show(PUSH, GRIP, PUSH) is None
    assert joystick.show(REST, GRIP, PUSH) == PUSH.stick


def test_messages_that_only_repeat_end_it(joystick):
    joystick.show(REST, GRIP)
    assert joystick.show(PUSH, count=99) == PUSH.stick
    assert joystick.show(PUSH, count=3) is None
    assert 'nothing changed for 5 s' in joystick.enable_button.problem
    assert joystick.show(PadState((0.6, 0.0, 0.0), HELD)) is None


def test_a_message_that_was_on_its_way_for_long_ends_it(joystick):
    joystick.show(REST, GRIP, PUSH)
    assert joystick.show(PUSH, delay=0.2) == PUSH.stick
    assert joystick.show(PUSH, delay=0.4) is None
    assert '0.40 s late' in joystick.enable_button.problem
    assert joystick.show(PUSH) is None
    assert joystick.show(REST, GRIP, PUSH) == PUSH.stick
    # When the clock of the sender was set, it can be pressed again.
    assert joystick.show(PUSH, delay=3600.0) is None
    assert joystick.show(REST, GRIP, PUSH, delay=3600.0) == PUSH.stick


def test_after_a_problem_the_button_has_to_be_pressed_again(joystick):
    joystick.show(REST, GRIP, PUSH)
    joystick.enable_button.end('motion is stopped')
    assert joystick.show(PUSH, GRIP, PUSH) is None
    assert joystick.enable_button.problem.startswith('motion is stopped: release')
    joystick.show(REST)
    assert not joystick.enable_button.problem
    assert joystick.show(GRIP, PUSH) == PUSH.stick
