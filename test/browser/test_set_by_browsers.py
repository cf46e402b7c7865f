# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What a browser sets is taken, however busy the computer is; vacuums only by regulators."""

import asyncio
from dataclasses import replace
from math import nan
from unittest.mock import Mock

import pytest

from soft_continuum.ros.description import load_arm
from soft_continuum.ui.browser.access import open_server
from soft_continuum.ui.browser.controls import Controls, show_value
from soft_continuum.ui.browser.panel import Panel
from soft_continuum.ui.browser.session import Description
from soft_continuum.ui.browser.tip_panel import TipPanel
from soft_continuum.user_files import description_file
from support.arm_states import READY


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


def test_vacuums_can_be_typed_only_where_regulators_are(monkeypatch):
    for other in ('TipPanel', 'ShapesPanel'):
        monkeypatch.setattr(f'soft_continuum.ui.browser.panel.{other}', Mock())
    server = open_server('127.0.0.1', 0)
    session = Mock(description=Description(load_arm(description_file())), notices=[],
                   closed_loop=None)
    session.picture.address = ''
    session.observed.recorder = session.observed.teleop = None
    panel = Panel(server, session)
    number, button = (handle for handle in server.gui._gui_input_handle_from_uuid.values()
                      if getattr(handle, 'label', '') in ('Vacuum 2 [kPa]', 'Set vacuum 2'))
    for vacuums in ((), (80e3, 80e3, 80e3), ()):
        panel.show(replace(READY, set_vacuums=vacuums))
        assert number.visible is button.visible is bool(vacuums)
    assert number.value == 80.0, 'what is set already, so that the button alone softens nothing'
    panel._set_vacuum(2, Mock(value=30.0))
    session.requests.set_vacuum.assert_called_once_with(2, 30e3)
    for typed in (1e9, -1.0, nan, 'much', None):
        panel._set_vacuum(2, Mock(value=typed))
    session.requests.set_vacuum.assert_called_once()
    assert session.refuse.call_count == 5
    server.stop()
