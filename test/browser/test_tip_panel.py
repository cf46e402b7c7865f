# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""A goal that is typed is taken, however busy the computer is."""

import asyncio
from unittest.mock import Mock

import pytest

from soft_continuum.browser.access import open_server
from soft_continuum.browser.session import Description
from soft_continuum.browser.tip_panel import TipPanel
from soft_continuum.parameters.files import load_arm
from soft_continuum.user_files import description_file
from support.arm_states import READY


def test_what_is_typed_is_not_set_back_before_the_panel_knows_of_it() -> None:
    server = open_server('127.0.0.1', 0)
    session = Mock()
    session.tip.planned = None
    panel = TipPanel(server, session, Description(load_arm(description_file())))
    panel._on.value = True
    panel.show(READY, True)
    x, z = panel._numbers
    # As viser does: first the value, and then, on its own thread, the callback.
    z._impl.value = 250.0
    panel.show(READY, True)
    asyncio.run(panel._typed(Mock()))
    assert session.tip.aim.call_args.args[0].position == pytest.approx((0.0, 0.25))
    panel.show(READY, True)
    assert (x.value, z.value) == (0.0, 250.0)
    assert panel._handle.position == pytest.approx((0.0, 0.0, 0.25))
    server.stop()
