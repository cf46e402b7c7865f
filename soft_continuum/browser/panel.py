# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The controls beside the scene.  Every browser shows the same ones."""

from collections.abc import Sequence
from functools import partial
from math import isfinite
from typing import Any, TYPE_CHECKING

import viser

from soft_continuum.browser import html
from soft_continuum.browser.charts import History
from soft_continuum.browser.controls import add_button, add_group, enable, show_value
from soft_continuum.browser.scene import viewpoint, views_of
from soft_continuum.browser.session import Description, Session
from soft_continuum.browser.shapes_panel import ShapesPanel
from soft_continuum.browser.tip_panel import TipPanel
from soft_continuum.client.state import ArmState
from soft_continuum.ros.names import JAMMING_VALVES, SHAPE_SEQUENCER

if TYPE_CHECKING:  # only a replay needs it
    from soft_continuum.recordings.playback import Playback

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

    def __init__(self, server: viser.ViserServer, session: Session,
                 playback: 'Playback | None' = None) -> None:
        """Add every control; for a playback a slider, and no control that moves an arm."""
        self._server, self._session, self._playback = server, session, playback
        self._switches: list[Any] = []
        self._regulators: list[Any] = []
        self._jogs: list[Any] = []
        self._rests: list[Any] = []
        self._description = description = session.description
        gui = server.gui
        gui.configure_theme(show_logo=False, show_share_button=False, control_width='medium',
                            brand_color=(40, 48, 72))
        gui.main_panel.dock_right()
        gui.main_panel.set_width(PANEL_WIDTH)
        if playback is not None:
            self._add_playback(gui, playback)
        if description is not None:
            self._add_controls(gui, description)
        if playback is None:
            with gui.add_folder('Steering'):
                self._steering = gui.add_html('')
            with gui.add_folder('Recording'):
                self._recording = gui.add_html('')
                self._record = add_button(
                    gui, RECORD, session.record,
                    hint='Record all topics of the nodes as an MCAP file')
        with gui.add_folder('Nodes'):
            self._nodes = gui.add_html('')
        with gui.add_folder('Messages'):
            self._notices = gui.add_html('')

    def _add_playback(self, gui: viser.GuiApi, playback: 'Playback') -> None:
        async def moved(event: Any) -> None:
            if event.client is not None:  # not by the playback itself
                playback.seek(float(self._slider.value))

        with gui.add_folder('Replay'):
            self._slider = gui.add_slider(
                'Time [s]', 0.0, round(playback.duration + SLIDER_STEP, 1), SLIDER_STEP, 0.0)
            self._slider.on_update(moved)
            self._play = add_button(gui, PLAY, lambda: playback.play(not playback.playing))

    def _add_controls(self, gui: viser.GuiApi, description: Description) -> None:
        arm, moves = description.arm, self._playback is None
        self._history = History(len(arm.segments), len(arm.tendon_names),
                                description.ambient_pressure)
        with gui.add_folder('Shapes'):
            if moves:
                self._shapes = ShapesPanel(gui, self._session, description)
            self._bar = gui.add_progress_bar(0.0, color='green')
            self._sequence = gui.add_html('')
        if moves:
            with gui.add_folder('Reach', expand_by_default=False):
                self._tip = TipPanel(self._server, self._session, description)
        with gui.add_folder('Measured shape'):
            if moves:
                self._add_loop(gui)
            self._source = gui.add_html('')
            self._error = gui.add_html('')
            self._learned = gui.add_html('')
        with gui.add_folder('Segments'):
            self._segments = gui.add_html('')
            if moves and description.jamming:
                self._switches = [
                    *(add_group(gui, f'Segment {segment}', (SOFTEN, STIFFEN),
                                partial(self._switch, segment))
                      for segment in range(1, len(arm.segments) + 1)),
                    add_button(gui, 'Stiffen all', self._session.stiffen_all)]
                self._add_regulators(gui, len(arm.segments))
        with gui.add_folder('Tip and sensors'):
            self._picture = gui.add_html('')
            self._positions = gui.add_html('')
            gui.add_button_group('Look from', tuple(views_of(description))).on_click(self._look)
        with gui.add_folder('Tendons'):
            self._tendons = gui.add_html('')
            if moves:
                self._add_tendons(gui, arm.tendon_names)

    def _add_regulators(self, gui: viser.GuiApi, segments: int) -> None:
        """Add a field and a button for the vacuum of each segment; shown for regulators."""
        for segment in range(1, segments + 1):
            number = gui.add_number(
                f'Vacuum {segment} [kPa]', 0.0, min=0.0, max=MAX_VACUUM, step=1.0, visible=False)
            button = add_button(
                gui, f'Set vacuum {segment}', partial(self._set_vacuum, segment, number),
                visible=False, hint='Below ambient; between soft and stiff')
            self._switches += [number, button]
            self._regulators += [number, button]

    def _add_loop(self, gui: viser.GuiApi) -> None:
        async def switched(event: Any) -> None:
            if event.client is not None:  # not by show
                self._session.set_closed_loop(bool(event.target.value))

        self._loop = gui.add_checkbox(
            'Closed loop', False, hint='Correct every segment with sensor measurements')
        self._loop.on_update(switched)

    def _add_tendons(self, gui: viser.GuiApi, names: Sequence[str]) -> None:
        session = self._session
        self._jogs = [add_group(
            gui, name, tuple(f'{step:+g}' for step in STEPS), partial(self._jog, name))
            for name in names]
        self._hint = gui.add_html('')
        self._rests = [
            add_button(gui, 'Reference', session.reference,
                       hint='Sets the present pulls as zero. The arm must be straight'),
            add_button(gui, 'Reset shape', session.reset,
                       hint='Assumes a straight arm, when its shape was unknown')]

    def remove(self) -> None:
        """Remove the controls, to make room for those of another arm."""
        self._server.gui.reset()

    async def _look(self, event: Any) -> None:
        """Move the camera of the requesting browser only."""
        description, view = self._description, event.target.value
        if description is not None and view in views_of(description) and event.client is not None:
            camera = event.client.camera
            camera.position, camera.look_at = viewpoint(description, view)
            camera.up_direction = (0.0, 0.0, 1.0)

    def _switch(self, segment: int, choice: str) -> None:
        self._session.set_stiff(segment, choice == STIFFEN)

    def _set_vacuum(self, segment: int, number: Any) -> None:
        value = number.value
        if isinstance(value, int | float) and 0.0 <= value <= MAX_VACUUM:
            self._session.set_vacuum(segment, 1e3 * value)
        else:  # a browser may send any
            self._session.refuse('Vacuum', f'allowed: 0 to {MAX_VACUUM:g} kPa')

    def _jog(self, tendon: str, choice: str) -> None:
        self._session.jog(tendon, float(choice) * 1e-3)

    # Updates.

    def sample(self, state: ArmState) -> None:
        """Add to the charts, also without a browser."""
        if self._description is not None:
            self._history.sample(state)

    def show(self, state: ArmState) -> None:
        """Show what has changed."""
        if self._playback is not None:
            playback = self._playback
            show_value(self._server, self._slider, lambda: round(playback.position, 1))
            self._play.label = PAUSE if playback.playing else PLAY
        else:
            recorder = self._session.observed.recorder
            self._recording.content = html.recording_html(recorder)
            self._record.label = END if recorder is not None and recorder.recording else RECORD
            enable(self._record, recorder is not None)
            self._steering.content = html.steering_html(self._session.observed.teleop)
        self._nodes.content = html.nodes_html(state)
        self._notices.content = html.notices_html(
            list(self._session.notices)[-NOTICES_IN_PANEL:])
        if self._description is None:
            return
        self._segments.content = html.segments_html(state, self._description, self._history)
        self._picture.content = html.picture_html(self._session.picture.address)
        self._positions.content = html.positions_html(state, self._description.arm.axes)
        self._tendons.content = html.tendons_html(state, self._description, self._history)
        self._sequence.content = html.sequence_html(state)
        self._source.content = html.source_html(state, self._history)
        self._error.content = html.error_html(self._history)
        self._learned.content = html.parameters_html(state.estimate)
        runs = state.progress is not None
        fraction = state.progress.fraction if state.progress else 0.0
        self._bar.value = (  # type: ignore[misc]  # it can be set
            round(100 * min(1.0, max(0.0, fraction))) if isfinite(fraction) else 0.0)
        if self._playback is not None:
            return
        closed = self._session.closed_loop
        show_value(self._server, self._loop, lambda: bool(self._session.closed_loop))
        self._hint.content = html.jog_hint_html(state, self._description)
        # Controls without effect are grey.
        may_move = state.stopped == ''
        works_now = {node.name for node in state.nodes if not node.stale}
        may_switch = JAMMING_VALVES in works_now and not (runs or state.emergency_stop)
        may_run = may_move and SHAPE_SEQUENCER in works_now
        any_soft = not self._description.jamming or False in state.stiff
        self._shapes.show(may_run, runs)
        self._tip.show(state, may_run)
        for number, vacuum in zip(self._regulators[::2], state.set_vacuums, strict=False):
            if not number.visible and isfinite(vacuum):  # so that Set alone changes nothing
                number.value = round(1e-3 * vacuum, 1)
        for control in self._regulators:
            if control.visible is not bool(state.set_vacuums):
                control.visible = bool(state.set_vacuums)
        for control, works in (
                (self._loop, closed is not None and SHAPE_SEQUENCER in works_now),
                *((c, may_switch) for c in self._switches),
                *((c, may_move and not runs and any_soft) for c in self._jogs),
                *((c, not runs) for c in self._rests)):
            enable(control, works)

