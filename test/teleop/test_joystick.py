# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A joystick, its enable button, and the keys of a terminal that act as one."""

from math import inf, nan

import pytest

from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.ros.parameter_table import NODE_PARAMETERS
from soft_continuum.ui.cli.teleop import HELP, in_keys, screen_lines
from soft_continuum.ui.teleop.joystick import (
    EnableButton,
    Keyboard,
    Pad,
    PadError,
    PadState,
    RELEASE,
)

DEFAULTS = {p.name: p.default for p in NODE_PARAMETERS['teleop']}
XBOX_AXES, XBOX_BUTTONS = 8, 11  # that joy_node publishes


def pad(**changes):
    return Pad.from_parameters(
        DEFAULTS | {f'teleop.{name}': value for name, value in changes.items()})


def message(axes=(), buttons=()):
    """Return axes and buttons of an Xbox pad, given the deflected and the pressed ones."""
    deflected = dict(axes)
    return ([deflected.get(n, 0.0) for n in range(XBOX_AXES)],
            [int(n in buttons) for n in range(XBOX_BUTTONS)])


def test_an_xbox_pad_of_joy_node_is_read():
    # LB and A; the left stick half to the right, which joy_node counts as negative, and up.
    controls = pad(dead_zone=0.0).read(*message({0: -0.5, 1: 1.0}, [4, 0]))
    assert controls == PadState((0.5, 1.0, 0.0), frozenset({'enable', 'soften'}))


def test_within_the_dead_zone_a_stick_is_at_rest_and_beyond_it_begins_at_zero():
    read = pad(dead_zone=0.2).read
    assert read(*message({0: 0.2, 1: -0.2, 4: 0.1})).at_rest
    assert read(*message({1: 0.6})).stick == pytest.approx((0.0, 0.5, 0.0))
    assert read(*message({1: -1.0})).stick == pytest.approx((0.0, -1.0, 0.0))


@pytest.mark.parametrize(('axes', 'buttons', 'reason'), [
    ([nan] + [0.0] * 7, [0] * 11, 'axis 0 is nan; allowed: -1 to 1'),
    ([0.0, inf] + [0.0] * 6, [0] * 11, 'axis 1 is inf'),
    ([0.0] * 4 + [-1.5] + [0.0] * 3, [0] * 11, 'axis 4 is -1.5'),
    ([0.0, 0.0], [0] * 11, r'has 2 axes, none with the number 4 \(teleop.z_axis\)'),
    ([0.0] * 8, [0] * 4, r'has 4 buttons, none with the number 4 \(teleop.enable_button\)'),
    ([], [], 'no axes and no buttons'),
])
def test_what_is_no_message_of_the_described_pad_is_refused(axes, buttons, reason):
    with pytest.raises(PadError, match=reason):
        pad().read(axes, buttons)


def test_an_axis_that_is_not_used_may_show_anything():
    assert pad().read(*message({2: nan, 5: 7.0})).at_rest
    assert pad(z_axis=-1).read([0.0, 0.0], [0] * 11).at_rest


def test_one_button_cannot_mean_two_things():
    with pytest.raises(ParameterError, match='teleop.enable_button and teleop.soften_button'):
        pad(soften_button=4)
    with pytest.raises(ParameterError, match='teleop.x_axis and teleop.y_axis are both 0'):
        pad(y_axis=0)
    pad(reset_button=-1, mode_button=-1)


@pytest.mark.parametrize('changes', [{}, {'x_scale': 0.5, 'dead_zone': 0.0}, {
    'x_axis': 3, 'y_axis': 2, 'z_axis': 0, 'enable_button': 9, 'dead_zone': 0.4}])
def test_what_a_keyboard_writes_is_read_as_it_was_meant(changes):
    described = pad(**changes)
    meant = PadState((-0.3, 0.5, 1.0), frozenset({'enable', 'mode'}))
    read = described.read(*described.write(meant))
    assert read.stick == pytest.approx(meant.stick)
    assert read.pressed == meant.pressed


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
