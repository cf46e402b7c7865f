# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Controls of the page that follow the state of the arm, and which of them are grey.

Callbacks are coroutines, which run before another browser can change the selection.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import viser

from soft_continuum.client import ArmState
from soft_continuum.ros.names import SHAPE_SEQUENCER

T = TypeVar('T')
Condition = Callable[[ArmState], bool]


class Controls:
    """
    Adds controls at the present position of the page, and brings them up to date.

    updates: what is done then.  works: whether a control has an effect; None: it always has.
    """

    def __init__(self, server: viser.ViserServer) -> None:
        """Start without controls."""
        self._server, self._gui = server, server.gui
        self.updates: list[Callable[[ArmState], None]] = []

    def show(self, state: ArmState) -> None:
        """Bring all controls up to date."""
        for update in self.updates:
            update(state)

    def follow(self, control: Any, name: str, value: Callable[[ArmState], Any]) -> None:
        """Keep a property of a control at a function of the state; viser sends changes only."""
        self.updates.append(lambda state: setattr(control, name, value(state)))

    def follow_value(self, control: Any, value: Callable[[], Any]) -> None:
        """Show a value in a control that browsers set, too."""
        self.updates.append(lambda _: show_value(self._server, control, value))

    def grey(self, control: T, works: Condition | None) -> T:
        """Keep a control grey while it has no effect; return it."""
        if works is not None:
            self.updates.append(lambda state: enable(control, works(state)))
        return control

    def text(self, content: Callable[[ArmState], str]) -> None:
        """Add HTML."""
        self.follow(self._gui.add_html(''), 'content', content)

    def button(self, label: str, work: Callable[[], None], works: Condition | None = None,
               **options: Any) -> viser.GuiButtonHandle:
        """Add a button with a callback."""
        async def clicked(_: object) -> None:
            work()

        button = self._gui.add_button(label, **options)
        button.on_click(clicked)
        return self.grey(button, works)

    def group(self, label: str, options: tuple[str, ...], work: Callable[[str], None],
              works: Condition | None = None, **more: Any) -> viser.GuiButtonGroupHandle:
        """Add buttons side by side; the callback receives the label of the clicked one."""
        async def clicked(event: Any) -> None:
            if event.target.value in options:  # a browser may send any text
                work(event.target.value)

        group = self._gui.add_button_group(label, options, **more)
        group.on_click(clicked)
        return self.grey(group, works)


def on_change(control: Any, work: Callable[[Any], None]) -> None:
    """Call a function with the event when a browser, not this program, changes a control."""
    async def changed(event: Any) -> None:
        if event.client is not None:
            work(event)

    control.on_update(changed)


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
    server.get_event_loop().call_soon_threadsafe(lambda: setattr(control, 'value', value()))


def number_of(value: Any, low: float, high: float) -> float:
    """Return a number clamped to limits, 0 for no number: a browser may send anything."""
    known = isinstance(value, int | float) and low <= value <= high
    return float(value) if known else min(max(0.0, low), high)


def runs(state: ArmState) -> bool:
    """Whether a sequence runs."""
    return state.progress is not None


def is_there(state: ArmState, node: str) -> bool:
    """Whether a node that the arm needs runs."""
    return any(report.name == node and not report.stale for report in state.nodes)


def may_run(state: ArmState) -> bool:
    """Whether a sequence may begin."""
    return state.stopped == '' and is_there(state, SHAPE_SEQUENCER)
