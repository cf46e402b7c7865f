# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The keys of a terminal, which tells no release, act as a joystick."""

import pytest

from soft_continuum.ui.cli.teleop import HELP, in_keys, screen_lines
from soft_continuum.ui.teleop.joystick import EnableButton, Keyboard, RELEASE


class Typist:
    """Presses keys, and asks every 20 ms what a joystick would say."""

    def __init__(self):
        self.keyboard, self.now = Keyboard(), 0.0
        self.enable_button = EnableButton(timeout=0.25, unchanged_timeout=5.0)

    def wait(self, seconds):
        """Return for how long the arm may move meanwhile, s."""
        moved, end = 0.0, self.now + seconds
        while self.now < end:
            self.now += 0.02
            self.enable_button.receive(self.keyboard.controls(self.now), self.now)
            moved += 0.02 * any(self.enable_button.stick(self.now) or ())
        return moved

    def hold(self, key, seconds, repeats=30.0):
        """Hold a key that repeats so often per second; return for how long the arm may move."""
        moved, end = 0.0, self.now + seconds
        while self.now < end:
            self.keyboard.press(key, self.now)
            moved += self.wait(1.0 / repeats)
        return moved


@pytest.fixture
def typist():
    typist = Typist()
    typist.wait(0.1)
    return typist


def test_a_key_that_is_hit_once_nudges_and_one_that_is_held_goes_on_and_ends_soon_after(typist):
    typist.keyboard.press('right', typist.now)
    assert 0.1 < typist.wait(2.0) <= 0.2
    assert typist.hold('left', 2.0) > 1.8
    assert typist.wait(1.0) <= 0.22


def test_space_and_any_other_key_let_go(typist):
    for key in (' ', 'x', ''):
        typist.hold('up', 0.5)
        typist.keyboard.press(key, typist.now)
        assert typist.wait(1.0) == 0.0


def test_the_other_direction_goes_the_other_way_and_slower(typist):
    keyboard = typist.keyboard
    typist.hold('right', 0.3)
    assert keyboard.controls(typist.now).stick == (keyboard.speed, 0.0, 0.0)
    before = keyboard.speed
    typist.hold('-', 0.01)
    typist.hold('left', 0.3)
    assert keyboard.speed < before
    assert keyboard.controls(typist.now).stick == (-keyboard.speed, 0.0, 0.0)


def test_a_button_is_pressed_once_and_without_the_enable_button(typist):
    typist.hold('right', 0.3)
    typist.keyboard.press('s', typist.now)
    assert typist.keyboard.controls(typist.now + 0.1).pressed == {'soften'}
    assert not typist.keyboard.controls(typist.now + 0.3).pressed


def test_who_steers_by_keys_is_told_of_no_button():
    for said in (f'refused: {RELEASE}', 'the emergency stop is on: reset turns it off',
                 'segment 2 is soft: hold the enable button and move the stick'):
        assert not {'button', 'stick', 'reset'} & {*in_keys(said).split()}
    assert in_keys('nothing moves before ~/resume') == 'nothing moves before r'
    assert in_keys('the emergency stop is on: reset turns it off').endswith(': r turns it off')


@pytest.mark.parametrize('size', [(24, 79), (12, 60), (6, 39), (3, 20), (1, 8)])
def test_the_screen_fits_and_shows_the_state_first(size):
    lines = screen_lines(('segment 2, held', 'moving segment 2'), 0.5, *size)
    assert len(lines) <= size[0]
    assert 'segment 2'[:size[1] - 8] in lines[0]
    shown = ' '.join(' '.join(lines).split())
    assert ('space STOP' in shown) == (size[0] >= 6)  # the keys are left out first
    if size[0] == 24:
        assert {*HELP} <= {*lines}
