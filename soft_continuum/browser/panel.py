# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The controls beside the scene.  Every browser shows the same ones."""

from collections.abc import Callable
from functools import partial
from math import isfinite
from typing import Any

import viser

from soft_continuum.browser import html
from soft_continuum.browser.charts import History
from soft_continuum.browser.session import Description, Session
from soft_continuum.client.state import ArmState
from soft_continuum.ros.names import JAMMING_VALVES, SHAPE_SEQUENCER

STEPS = (-5.0, -1.0, 1.0, 5.0)  # mm
SOFTEN, STIFFEN = 'soften', 'stiffen'
NOTICES_IN_PANEL = 6
PANEL_WIDTH = 340  # px


class Panel:
    """Controls and readings of one arm, or of none yet."""

    def __init__(self, server: viser.ViserServer, session: Session) -> None:
        """Add every control."""
        self._server, self._session = server, session
        self._description = description = session.description
        gui = server.gui
        gui.configure_theme(show_logo=False, show_share_button=False, control_width='medium',
                            brand_color=(40, 48, 72))
        gui.main_panel.dock_right()
        gui.main_panel.set_width(PANEL_WIDTH)
        if description is not None:
            self._add_controls(gui, description)
        with gui.add_folder('Nodes'):
            self._nodes = gui.add_html('')
        with gui.add_folder('Messages'):
            self._notices = gui.add_html('')

    def _add_controls(self, gui: viser.GuiApi, description: Description) -> None:
        session, arm = self._session, description.arm
        self._history = History(len(arm.segments), len(arm.tendon_names),
                                description.ambient_pressure)
        with gui.add_folder('Shapes'):
            self._motions: list[Any] = [] if not description.shapes else [
                self._group('Set', tuple(description.shapes), lambda name: session.run([name]))]
            self._names = gui.add_text('Sequence', ', '.join(description.shapes))
            self._motions.append(self._button('Run sequence', self._run_sequence))
            self._cancel = self._button('Cancel', session.cancel,
                                        hint='Ends the sequence with every segment stiff')
            self._bar = gui.add_progress_bar(0.0, color='green')
            self._sequence = gui.add_html('')
        with gui.add_folder('Segments'):
            self._segments = gui.add_html('')
            self._switches: list[Any] = [
                self._group(f'Segment {segment}', (SOFTEN, STIFFEN),
                            partial(self._switch, segment))
                for segment in range(1, len(arm.segments) + 1)]
            self._switches.append(self._button('Stiffen all', session.stiffen_all))
        with gui.add_folder('Tip and sensors'):
            self._positions = gui.add_html('')
        with gui.add_folder('Tendons'):
            self._tendons = gui.add_html('')
            self._jogs = [self._group(
                f'{name} [mm]', tuple(f'{step:+g}' for step in STEPS),
                partial(self._jog, name)) for name in arm.tendon_names]
            self._hint = gui.add_html('')
            self._rests = [
                self._button('Reference', session.reference,
                             hint='Takes the present pulls as zero. The arm must be straight'),
                self._button('Reset shape', session.reset,
                             hint='Takes the arm to be straight, when its shape was not known')]

    def remove(self) -> None:
        """Take the controls away, to make room for those of another arm."""
        self._server.gui.reset()

    # What a click does.  Coroutines run before the value can be changed by another browser.

    def _button(self, label: str, work: Callable[[], None], **options: Any
                ) -> viser.GuiButtonHandle:
        async def clicked(_: object) -> None:
            work()

        button = self._server.gui.add_button(label, **options)
        button.on_click(clicked)
        return button

    def _group(self, label: str, options: tuple[str, ...],
               work: Callable[[str], None]) -> viser.GuiButtonGroupHandle:
        async def clicked(event: Any) -> None:
            if event.target.value in options:  # a browser may send any text
                work(event.target.value)

        group = self._server.gui.add_button_group(label, options)
        group.on_click(clicked)
        return group

    def _switch(self, segment: int, choice: str) -> None:
        self._session.set_stiff(segment, choice == STIFFEN)

    def _jog(self, tendon: str, choice: str) -> None:
        self._session.jog(tendon, float(choice) * 1e-3)

    def _run_sequence(self) -> None:
        self._session.run([name.strip() for name in self._names.value.split(',') if name.strip()])

    # Bringing it up to date.

    def sample(self, state: ArmState) -> None:
        """Add to the curves; they go on without a browser too."""
        if self._description is not None:
            self._history.sample(state)

    def show(self, state: ArmState) -> None:
        """Show what has changed."""
        self._nodes.content = html.nodes_html(state)
        self._notices.content = html.notices_html(
            list(self._session.notices)[-NOTICES_IN_PANEL:])
        if self._description is None:
            return
        self._segments.content = html.segments_html(state, self._description, self._history)
        self._positions.content = html.positions_html(state)
        self._tendons.content = html.tendons_html(state, self._description, self._history)
        self._sequence.content = html.sequence_html(state)
        self._hint.content = html.jog_hint_html(state)
        runs = state.progress is not None
        fraction = state.progress.fraction if state.progress else 0.0
        self._bar.value = (  # type: ignore[misc]  # it can be set
            round(100 * min(1.0, max(0.0, fraction))) if isfinite(fraction) else 0.0)
        # What would do nothing now is grey.
        may_move = state.stopped == ''
        may_switch = not (runs or state.emergency_stop or state.node(JAMMING_VALVES).stale)
        for control, works in (
                *((c, may_move and not state.node(SHAPE_SEQUENCER).stale) for c in self._motions),
                (self._cancel, runs),
                *((c, may_switch) for c in self._switches),
                *((c, may_move and not runs and False in state.stiff) for c in self._jogs),
                *((c, not runs) for c in self._rests)):
            _enable(control, works)


def _enable(control: Any, works: bool) -> None:
    """Make a control grey, or not; viser's own property refuses that for groups of buttons."""
    if control._impl.props.disabled is works:
        control._impl.props.disabled = not works
        control._queue_update('disabled', not works)
