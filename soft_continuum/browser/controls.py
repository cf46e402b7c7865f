# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Buttons of the page, and which of them are grey.

Their callbacks are coroutines: these run before another browser can change what was chosen.
"""

from collections.abc import Callable
from typing import Any

import viser


def add_button(gui: viser.GuiApi, label: str, work: Callable[[], None], **options: Any
               ) -> viser.GuiButtonHandle:
    """Add a button that does some work."""
    async def clicked(_: object) -> None:
        work()

    button = gui.add_button(label, **options)
    button.on_click(clicked)
    return button


def add_group(gui: viser.GuiApi, label: str, options: tuple[str, ...],
              work: Callable[[str], None], **more: Any) -> viser.GuiButtonGroupHandle:
    """Add buttons side by side; the work is told which of them was clicked."""
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
    Let a control that browsers set show a value, called for where they set it: on viser's thread.

    On another one it could be set back after a browser has set it and before its callback is run.
    """
    def show() -> None:
        now = value()
        if control.value != now:
            control.value = now

    server.get_event_loop().call_soon_threadsafe(show)


def number_of(value: Any, low: float, high: float) -> float:
    """Return a number within limits, 0 or the nearest for what is none: a browser may send any."""
    known = isinstance(value, int | float) and low <= value <= high
    return float(value) if known else min(max(0.0, low), high)
