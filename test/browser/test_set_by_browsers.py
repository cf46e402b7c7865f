# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What a browser sets is taken, however busy the computer is."""

import asyncio
from typing import TypeVar
from unittest.mock import Mock

import pytest

from soft_continuum.browser.access import open_server
from soft_continuum.browser.controls import Controls, show_value
from soft_continuum.browser.session import Description
from soft_continuum.browser.tip_panel import TipPanel
from soft_continuum.parameters.files import load_arm
from soft_continuum.user_files import description_file
from support.arm_states import READY

T = TypeVar('T')


def test_what_is_typed_is_not_set_back_before_the_panel_knows_of_it():
    server = open_server('127.0.0.1', 0)
    session = Mock()
    session.tip.planned = None
    controls = Controls(server)
    panel = TipPanel(server, controls, session, Description(load_arm(description_file())))
    panel._on.value = True
    controls.show(READY)
    x, z = panel._numbers
    # As viser does: first the value, and then, on its own thread, the callback.
    z._impl.value = 250.0
    controls.show(READY)
    panel._typed(Mock())
    assert session.tip.aim.call_args.args[0].position == pytest.approx((0.0, 0.25))
    controls.show(READY)
    assert (x.value, z.value) == (0.0, 250.0)
    assert panel._handle.position == pytest.approx((0.0, 0.0, 0.25))
    server.stop()


def test_a_slider_that_is_dragged_is_not_set_back_before_its_callback_is_run():
    server = open_server('127.0.0.1', 0)
    slider = server.gui.add_slider('Time', 0.0, 10.0, 0.1, 0.0)
    position, sought = 2.0, []

    async def drag():
        # As viser does: first the value, and then, on its own thread, the callback.
        nonlocal position
        slider._impl.value = 7.0
        show_value(server, slider, lambda: position)
        position = slider.value
        sought.append(position)

    async def shown():
        return float(slider.value)

    show_value(server, slider, lambda: position)
    assert _on_its_thread(server, shown()) == 2.0
    _on_its_thread(server, drag())
    assert sought == [7.0]
    assert _on_its_thread(server, shown()) == 7.0
    server.stop()


def _on_its_thread(server, work):
    return asyncio.run_coroutine_threadsafe(work, server.get_event_loop()).result(10.0)
