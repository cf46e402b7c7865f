# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The controls beside the scene.  Every browser shows the same ones."""

from functools import partial
from math import isfinite, nan
from typing import Any, TYPE_CHECKING

import viser

from soft_continuum.client import ArmState
from soft_continuum.ros.names import JAMMING_VALVES, SHAPE_SEQUENCER
from soft_continuum.ui.browser import html
from soft_continuum.ui.browser.controls import Controls, is_there, on_change, runs
from soft_continuum.ui.browser.html import History
from soft_continuum.ui.browser.scene import viewpoint, views_of
from soft_continuum.ui.browser.session import Description, PageSession
from soft_continuum.ui.browser.shapes_panel import ShapesPanel
from soft_continuum.ui.browser.tip_panel import TipPanel

if TYPE_CHECKING:  # only a replay needs it
    from soft_continuum.lab.recordings.playback import Playback

STEPS = (-5.0, -1.0, 1.0, 5.0)  # mm
SOFTEN, STIFFEN = 'soften', 'stiffen'
RECORD, END = 'Record', 'End recording'
PLAY, PAUSE = 'Play', 'Pause'
SLIDER_STEP = 0.1  # s
NOTICES_IN_PANEL = 6
MAX_VACUUM = 100.0  # kPa that can be entered; regulators accept less
PANEL_WIDTH = 340  # px


class Panel:
    """Controls and readings of one arm, or of none yet."""

    def __init__(self, server: viser.ViserServer, session: PageSession,
                 playback: 'Playback | None' = None) -> None:
        """Add every control; for a playback a slider, and no control that moves an arm."""
        self._server, self._session, self._playback = server, session, playback
        self._description = description = session.description
        self._controls = Controls(server)
        self.show = self._controls.show
        gui, text = server.gui, self._controls.text
        gui.configure_theme(show_logo=False, show_share_button=False, control_width='medium',
                            brand_color=(40, 48, 72))
        gui.main_panel.dock_right()
        gui.main_panel.set_width(PANEL_WIDTH)
        if playback is not None:
            self._add_playback(playback)
        if description is not None:
            self._add_controls(description)
        if playback is None:
            with gui.add_folder('Steering'):
                text(lambda _: html.steering_html(session.observed.teleop))
            with gui.add_folder('Recording'):
                self._add_recording()
        with gui.add_folder('Nodes'):
            text(html.nodes_html)
        with gui.add_folder('Messages'):
            text(lambda _: html.notices_html(list(session.notices)[-NOTICES_IN_PANEL:]))

    def _add_playback(self, playback: 'Playback') -> None:
        gui, controls = self._server.gui, self._controls
        with gui.add_folder('Replay'):
            slider = gui.add_slider(
                'Time [s]', 0.0, round(playback.duration + SLIDER_STEP, 1), SLIDER_STEP, 0.0)
            on_change(slider, lambda _: playback.seek(float(slider.value)))
            controls.follow_value(slider, lambda: round(playback.position, 1))
            play = controls.button(PLAY, lambda: playback.play(not playback.playing))
            controls.follow(play, 'label', lambda _: PAUSE if playback.playing else PLAY)

    def _add_recording(self) -> None:
        session, observed, controls = self._session, self._session.observed, self._controls
        controls.text(lambda _: html.recording_html(observed.recorder))
        record = controls.button(RECORD, session.record, lambda _: observed.recorder is not None,
                                 hint='Record all topics of the nodes as an MCAP file')
        controls.follow(record, 'label', lambda _: (
            END if observed.recorder and observed.recorder.recording else RECORD))

    def _add_controls(self, description: Description) -> None:
        arm, moves, session = description.arm, self._playback is None, self._session
        gui, controls, text = self._server.gui, self._controls, self._controls.text
        self._history = history = History(len(arm.segments), len(arm.tendon_names),
                                          description.ambient_pressure)
        with gui.add_folder('Shapes'):
            if moves:
                ShapesPanel(gui, controls, session, description)
            controls.follow(
                gui.add_progress_bar(0.0, color='green'), 'value',
                lambda state: round(100 * state.progress.fraction) if state.progress else 0)
            text(html.sequence_html)
        if moves:
            with gui.add_folder('Reach', expand_by_default=False):
                TipPanel(self._server, controls, session, description)
        with gui.add_folder('Measured shape'):
            if moves:
                self._add_loop()
            text(lambda state: html.source_html(state, history))
            text(lambda _: html.error_html(history))
            text(lambda state: html.parameters_html(state.estimate))
        with gui.add_folder('Segments'):
            text(lambda state: html.segments_html(state, description, history))
            if moves and description.jamming:
                self._add_switches(len(arm.segments))
        with gui.add_folder('Tip and sensors'):
            text(lambda _: html.picture_html(session.picture.address))
            text(lambda state: html.positions_html(state, arm.axes))
            gui.add_button_group('Look from', tuple(views_of(description))).on_click(self._look)
        with gui.add_folder('Tendons'):
            text(lambda state: html.tendons_html(state, description, history))
            if moves:
                self._add_tendons(description)

    def _add_switches(self, segments: int) -> None:
        """Add what makes segments stiff or soft; the vacuums are shown for regulators."""
        controls, session = self._controls, self._session

        def may_switch(state: ArmState) -> bool:
            return is_there(state, JAMMING_VALVES) and not (runs(state) or state.emergency_stop)

        for segment in range(1, segments + 1):
            controls.group(f'Segment {segment}', (SOFTEN, STIFFEN),
                           partial(self._switch, segment), may_switch)
        controls.button('Stiffen all', lambda: session.start(
            'Stiffen all segments', session.requests.set_stiff(None, True)), may_switch)
        for segment in range(1, segments + 1):
            number = controls.grey(self._server.gui.add_number(
                f'Vacuum {segment} [kPa]', 0.0, min=0.0, max=MAX_VACUUM, step=1.0, visible=False),
                may_switch)
            button = controls.button(
                f'Set vacuum {segment}', partial(self._set_vacuum, segment, number), may_switch,
                visible=False, hint='Below ambient; between soft and stiff')
            controls.updates.append(partial(_show_vacuum, segment, number))
            for control in (number, button):
                controls.follow(control, 'visible', lambda state: bool(state.set_vacuums))

    def _add_loop(self) -> None:
        session = self._session
        loop = self._controls.grey(self._server.gui.add_checkbox(
            'Closed loop', False, hint='Correct every segment with sensor measurements'),
            lambda state: session.closed_loop is not None and is_there(state, SHAPE_SEQUENCER))
        on_change(loop, lambda _: session.set_closed_loop(bool(loop.value)))
        self._controls.follow_value(loop, lambda: bool(session.closed_loop))

    def _add_tendons(self, description: Description) -> None:
        session, requests, controls = self._session, self._session.requests, self._controls

        def may_jog(state: ArmState) -> bool:
            any_soft = not description.jamming or False in state.stiff
            return state.stopped == '' and not runs(state) and any_soft

        for name in description.arm.tendon_names:
            controls.group(name, tuple(f'{step:+g}' for step in STEPS), partial(self._jog, name),
                           may_jog)
        controls.text(lambda state: html.jog_hint_html(state, description))
        controls.button('Reference', lambda: session.trigger('Reference', requests.reference()),
                        lambda state: not runs(state),
                        hint='Sets the present pulls as zero. The arm must be straight')
        controls.button('Reset shape', lambda: session.trigger('Reset shape', requests.reset()),
                        lambda state: not runs(state),
                        hint='Assumes a straight arm, when its shape was unknown')

    async def _look(self, event: Any) -> None:
        """Move the camera of the requesting browser only."""
        description, view = self._description, event.target.value
        if description is not None and view in views_of(description) and event.client is not None:
            camera = event.client.camera
            camera.position, camera.look_at = viewpoint(description, view)
            camera.up_direction = (0.0, 0.0, 1.0)

    def _switch(self, segment: int, choice: str) -> None:
        self._session.start(f'{choice.capitalize()} segment {segment}',
                            self._session.requests.set_stiff(segment, choice == STIFFEN))

    def _set_vacuum(self, segment: int, number: Any) -> None:
        value = number.value
        if isinstance(value, int | float) and 0.0 <= value <= MAX_VACUUM:
            self._session.start(f'Vacuum of segment {segment}',
                                self._session.requests.set_vacuum(segment, 1e3 * value))
        else:  # a browser may send any
            self._session.refuse('Vacuum', f'allowed: 0 to {MAX_VACUUM:g} kPa')

    def _jog(self, tendon: str, choice: str) -> None:
        self._session.start('Jog', self._session.requests.jog({tendon: float(choice) * 1e-3}))

    def sample(self, state: ArmState) -> None:
        """Add to the charts, also without a browser."""
        if self._description is not None:
            self._history.sample(state)


def _show_vacuum(segment: int, number: Any, state: ArmState) -> None:
    """Show the set vacuum when the field appears, so that its button alone changes nothing."""
    vacuum, = state.set_vacuums[segment - 1:segment] or (nan,)
    if not number.visible and isfinite(vacuum):
        number.value = round(1e-3 * vacuum, 1)
