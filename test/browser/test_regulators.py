# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Where regulators are, the page can set the vacuum of each segment, and nowhere else."""

from dataclasses import replace
from math import nan
from unittest.mock import Mock

from soft_continuum.browser.access import open_server
from soft_continuum.browser.panel import Panel
from soft_continuum.browser.session import Description
from soft_continuum.parameters.files import load_arm
from soft_continuum.user_files import description_file
from support.arm_states import READY


def test_vacuums_can_be_typed_only_where_regulators_are(monkeypatch):
    for other in ('TipPanel', 'ShapesPanel'):
        monkeypatch.setattr(f'soft_continuum.browser.panel.{other}', Mock())
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
