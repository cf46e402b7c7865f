# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What a joystick says is read as its parameters describe it, or refused with the reason."""

from math import inf, nan

import pytest

from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.ros.parameter_table import NODE_PARAMETERS
from soft_continuum.ui.teleop.joystick import Pad, PadError, PadState

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
