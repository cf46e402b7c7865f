# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Buttons of the page, and which of them are grey.

Callbacks are coroutines, which run before another browser can change the selection.
"""

from collections.abc import Callable
from typing import Any

import viser


def add_button(gui: viser.GuiApi, label: str, work: Callable[[], None], **options: Any
               ) -> viser.GuiButtonHandle:
    """Add a button with a callback."""
    async def clicked(_: object) -> None:
        work()

    button = gui.add_button(label, **options)
    button.on_click(clicked)
    return button


def add_group(gui: viser.GuiApi, label: str, options: tuple[str, ...],
              work: Callable[[str], None], **more: Any) -> viser.GuiButtonGroupHandle:
    """Add buttons side by side; the callback receives the label of the clicked one."""
    async def clicked(event: Any) -> None:
        if event.target.value in options:  # a browser may send any text
            work(event.target.value)

    group = gui.add_button_group(label, options, **more)
    group.on_click(clicked)
    return group


def enable(control: Any, works: bool) -> None:
    """Make a control grey, or not; viser's own property refuses that for groups of buttons."""
    if control._impl.props.disabled is works:
        control._impl.props.disabled = not works
        control._queue_update('disabled', not works)


def show_value(server: viser.ViserServer, control: Any, value: Callable[[], Any]) -> None:
    """
    Show a value in a control that browsers set; call it on viser's thread, where they do.

    On another thread it could undo a browser's change before the callback runs.
    """
    def show() -> None:
        now = value()
        if control.value != now:
            control.value = now

    server.get_event_loop().call_soon_threadsafe(show)


def number_of(value: Any, low: float, high: float) -> float:
    """Return a number clamped to limits, 0 for no number: a browser may send anything."""
    known = isinstance(value, int | float) and low <= value <= high
    return float(value) if known else min(max(0.0, low), high)
