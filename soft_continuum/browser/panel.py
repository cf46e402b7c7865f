# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The controls beside the scene.  Every browser shows the same ones."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import viser

from soft_continuum.browser import words
from soft_continuum.browser.charts import Chart, History, SEGMENT_COLOURS, TENDON_COLOURS
from soft_continuum.browser.node import Browser
from soft_continuum.browser.state import Description
from soft_continuum.mechanics.chain import LEFT, RIGHT, RigidChain

STEPS = (-5.0, -1.0, 1.0, 5.0)  # mm
SOFTEN, STIFFEN = 'soften', 'stiffen'
SHOWN = 6  # notices in the panel
POPUPS = 3  # notices over the scene
WIDTH = 350  # px
LARGE_NEXT = ('<style class="large-next">div:has(> .large-next) + * button '
              '{height: 64px; font-size: 1.7em; letter-spacing: 0.1em}</style>')
"""The button after it is a large one: viser has only one size."""


class Panel:
    """Controls and words for one arm, or for none yet."""

    def __init__(self, server: viser.ViserServer, node: Browser,
                 description: Description | None) -> None:
        """Add every control."""
        self._server, self._node, self._description = server, node, description
        self._popups: dict[int, list[viser.NotificationHandle]] = {}
        self._notified = node.notices[-1].number if node.notices else 0
        gui = server.gui
        gui.configure_theme(show_logo=False, show_share_button=False, control_width='medium',
                            brand_color=(41, 98, 155))
        gui.main_panel.dock_right()
        gui.main_panel.set_width(WIDTH)
        self._missing = gui.add_html('')
        gui.add_html(LARGE_NEXT)
        self._button('STOP', node.stop, color='red', icon=viser.Icon.HAND_STOP,
                     hint='Brakes and holds the tendons; nothing moves before Resume')
        self._button('Resume', node.resume, icon=viser.Icon.PLAYER_PLAY,
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
        self._side.set_width(WIDTH)
        if description is not None:
            self._add_controls(gui, description)

    def _add_controls(self, gui: viser.GuiApi, description: Description) -> None:
        node = self._node
        count = len(description.arm.segments)
        self._chain = RigidChain(description.arm)
        with gui.add_folder('Shapes'):
            for name in description.shapes:
                self._button(name, partial(node.run, [name]), color='indigo')
            self._names = gui.add_text('Sequence', ', '.join(description.shapes))
            self._button('Run sequence', self._run_sequence, color='indigo')
            self._button('Cancel', node.cancel, color='gray',
                         hint='Ends the sequence with every segment stiff')
            self._bar = gui.add_progress_bar(0.0)
            self._sequence = gui.add_html('')
        with gui.add_folder('Segments'):
            self._segments = gui.add_html('')
            for s in range(count):
                self._group(f'Segment {s + 1}', (SOFTEN, STIFFEN),
                            partial(self._switch, s))
            self._button('Stiffen all', node.stiffen_all, color='gray')
        with gui.add_folder('Tendons'):
            self._tendons = gui.add_html('')
            self._jogs = [self._group(
                f'{name} [mm]', tuple(f'{step:+g}' for step in STEPS),
                partial(self._jog, tendon))
                for name, tendon in (('Right', RIGHT), ('Left', LEFT))]
            self._hint = gui.add_html('')
            self._button('Reference', node.reference, color='gray',
                         hint='Takes the present pulls as zero. The arm must be straight')
            self._button('Reset shape', node.reset, color='gray',
                         hint='Takes the arm to be straight, when its shape was not known')

    def _add_charts(self, gui: viser.GuiApi, description: Description) -> None:
        count = len(description.arm.segments)
        self._history = History(count)
        self._vacuum = Chart(gui, 'Vacuum in kPa, last minute',
                             [f'segment {s + 1}' for s in range(count)], SEGMENT_COLOURS, 100.0)
        self._tensions = Chart(gui, 'Tension in N, last minute', ('right', 'left'),
                               TENDON_COLOURS, 10.0)

    def remove(self) -> None:
        """Take the controls away, to make room for those of another arm."""
        self._side.remove()
        self._server.gui.reset()

    def _button(self, label: str, work: Callable[[], None], **options: Any) -> None:
        button = self._server.gui.add_button(label, **options)
        button.on_click(lambda _: self._node.soon(work))

    def _group(self, label: str, options: tuple[str, ...],
               work: Callable[[str], None]) -> viser.GuiButtonGroupHandle:
        group = self._server.gui.add_button_group(label, options)

        def clicked(event: Any) -> None:
            choice = event.target.value
            self._node.soon(lambda: work(choice))

        group.on_click(clicked)
        return group

    def _switch(self, segment: int, choice: str) -> None:
        self._node.set_stiff(segment, choice == STIFFEN)

    def _jog(self, tendon: int, choice: str) -> None:
        self._node.jog(tendon, float(choice) * 1e-3)

    def _run_sequence(self) -> None:
        self._node.run([name.strip() for name in self._names.value.split(',') if name.strip()])

    # Bringing it up to date.

    def sample(self) -> None:
        """Go on with the curves; they do so without a browser too."""
        if self._description is not None:
            self._history.sample(self._node.state)

    def show(self) -> None:
        """Say what has changed."""
        state = self._node.state
        self._missing.content = words.missing_html(state)
        self._nodes.content = words.nodes_html(state)
        self._notices.content = words.notices_html(list(self._node.notices)[-SHOWN:])
        self._notify()
        if self._description is None:
            return
        known = len(state.joint_angles) == self._chain.joints and state.hears('kinematics')
        angles = self._chain.bending_angles(np.array(state.joint_angles)) if known else np.full(
            self._chain.segments, np.nan)
        self._segments.content = words.segments_html(state, angles)
        self._tendons.content = words.tendons_html(state, self._description)
        self._sequence.content = words.sequence_html(state)
        self._bar.value = (  # type: ignore[misc]  # it can be set
            round(100 * state.running.fraction) if state.running else 0.0)
        for jog in self._jogs:
            jog.visible = bool(state.soft) and state.running is None
        self._hint.content = words.jog_hint_html(state)
        self._vacuum.show(self._history.vacuum)
        self._tensions.show(self._history.tensions)

    def _notify(self) -> None:
        """Show what is new to everyone; it stays until it is closed or three newer ones came."""
        clients = self._server.get_clients()
        self._popups = {i: popups for i, popups in self._popups.items() if i in clients}
        for notice in self._node.notices:
            if notice.number <= self._notified:
                continue
            self._notified = notice.number
            for number, client in clients.items():
                popups = self._popups.setdefault(number, [])
                popups.append(client.add_notification(
                    notice.title, notice.text, color='red' if notice.refused else 'green',
                    auto_close_seconds=None if notice.refused else 6.0))
                if len(popups) > POPUPS:
                    popups.pop(0).remove()
