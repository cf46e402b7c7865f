# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The controls beside the scene.  Every browser shows the same ones."""

from collections.abc import Callable
from functools import partial
from typing import Any

import viser

from soft_continuum.browser import html
from soft_continuum.browser.charts import Chart, History, SEGMENT_COLOURS, TENDON_COLOURS
from soft_continuum.browser.session import Description, Session
from soft_continuum.client.state import ArmState

STEPS = (-5.0, -1.0, 1.0, 5.0)  # mm
SOFTEN, STIFFEN = 'soften', 'stiffen'
NOTICES_IN_PANEL = 6
NOTICES_OVER_SCENE = 3
PANEL_WIDTH = 350  # px
LARGE_NEXT = ('<style class="large-next">div:has(> .large-next) + * button '
              '{height: 64px; font-size: 1.7em; letter-spacing: 0.1em}</style>')
"""The button after it is a large one: viser has only one size."""


class Panel:
    """Controls and readings of one arm, or of none yet."""

    def __init__(self, server: viser.ViserServer, session: Session) -> None:
        """Add every control."""
        self._server, self._session = server, session
        self._description = description = session.description
        self._popups: dict[int, list[viser.NotificationHandle]] = {}
        self._notified = session.notices[-1].number if session.notices else 0
        gui = server.gui
        gui.configure_theme(show_logo=False, show_share_button=False, control_width='medium',
                            brand_color=(41, 98, 155))
        gui.main_panel.dock_right()
        gui.main_panel.set_width(PANEL_WIDTH)
        self._missing = gui.add_html('')
        gui.add_html(LARGE_NEXT)
        self._button('STOP', session.stop, color='red', icon=viser.Icon.HAND_STOP,
                     hint='Brakes and holds the tendons; nothing moves before Resume')
        self._button('Resume', session.resume, icon=viser.Icon.PLAYER_PLAY,
                     hint='Allows motion again; moves nothing by itself')
        self._side = gui.add_panel()
        with self._side.add_tab('State', viser.Icon.ACTIVITY):
            if description is not None:
                self._add_charts(gui, description)
            with gui.add_folder('Nodes'):
                self._nodes = gui.add_html('')
            with gui.add_folder('Messages'):
                self._notices = gui.add_html('')
        self._side.dock_left()
        self._side.set_width(PANEL_WIDTH)
        if description is not None:
            self._add_controls(gui, description)

    def _add_controls(self, gui: viser.GuiApi, description: Description) -> None:
        session = self._session
        with gui.add_folder('Shapes'):
            for name in description.shapes:
                self._button(name, partial(session.run, [name]), color='indigo')
            self._names = gui.add_text('Sequence', ', '.join(description.shapes))
            self._button('Run sequence', self._run_sequence, color='indigo')
            self._button('Cancel', session.cancel, color='gray',
                         hint='Ends the sequence with every segment stiff')
            self._bar = gui.add_progress_bar(0.0)
            self._sequence = gui.add_html('')
        with gui.add_folder('Segments'):
            self._segments = gui.add_html('')
            for segment in range(1, len(description.arm.segments) + 1):
                self._group(f'Segment {segment}', (SOFTEN, STIFFEN),
                            partial(self._switch, segment))
            self._button('Stiffen all', session.stiffen_all, color='gray')
        with gui.add_folder('Tendons'):
            self._tendons = gui.add_html('')
            self._jogs = [self._group(
                f'{name} [mm]', tuple(f'{step:+g}' for step in STEPS),
                partial(self._jog, name)) for name in description.arm.tendon_names]
            self._hint = gui.add_html('')
            self._button('Reference', session.reference, color='gray',
                         hint='Takes the present pulls as zero. The arm must be straight')
            self._button('Reset shape', session.reset, color='gray',
                         hint='Takes the arm to be straight, when its shape was not known')

    def _add_charts(self, gui: viser.GuiApi, description: Description) -> None:
        count, tendons = len(description.arm.segments), description.arm.tendon_names
        self._history = History(count, len(tendons), description.ambient_pressure)
        self._vacuum = Chart(gui, 'Vacuum in kPa, last minute',
                             [f'segment {s + 1}' for s in range(count)], SEGMENT_COLOURS, 100.0)
        self._tensions = Chart(gui, 'Tension in N, last minute', tendons, TENDON_COLOURS,
                               10.0)

    def remove(self) -> None:
        """Take the controls away, to make room for those of another arm."""
        self._side.remove()
        self._server.gui.reset()

    def _button(self, label: str, work: Callable[[], None], **options: Any) -> None:
        self._server.gui.add_button(label, **options).on_click(lambda _: work())

    def _group(self, label: str, options: tuple[str, ...],
               work: Callable[[str], None]) -> viser.GuiButtonGroupHandle:
        group = self._server.gui.add_button_group(label, options)
        group.on_click(lambda event: work(event.target.value))
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
        self._missing.content = html.missing_html(state)
        self._nodes.content = html.nodes_html(state)
        self._notices.content = html.notices_html(
            list(self._session.notices)[-NOTICES_IN_PANEL:])
        self._notify()
        if self._description is None:
            return
        self._segments.content = html.segments_html(state, self._description)
        self._tendons.content = html.tendons_html(state, self._description)
        self._sequence.content = html.sequence_html(state)
        self._bar.value = (  # type: ignore[misc]  # it can be set
            round(100 * state.progress.fraction) if state.progress else 0.0)
        for jog in self._jogs:
            jog.visible = False in state.stiff and state.progress is None
        self._hint.content = html.jog_hint_html(state)
        self._vacuum.show(self._history.vacuum)
        self._tensions.show(self._history.tensions)

    def _notify(self) -> None:
        """Show what is new to everyone; it stays until it is closed or three newer ones came."""
        clients = self._server.get_clients()
        self._popups = {i: popups for i, popups in self._popups.items() if i in clients}
        for notice in self._session.notices:
            if notice.number <= self._notified:
                continue
            self._notified = notice.number
            for number, client in clients.items():
                popups = self._popups.setdefault(number, [])
                popups.append(client.add_notification(
                    notice.title, notice.text, color='red' if notice.is_problem else 'green',
                    auto_close_seconds=None if notice.is_problem else 6.0))
                if len(popups) > NOTICES_OVER_SCENE:
                    popups.pop(0).remove()
