# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The controls that set shapes: library, sequences, saved shapes, sliders."""

from collections.abc import Callable
from functools import partial
from html import escape
from math import degrees, floor, radians
from typing import Any, TYPE_CHECKING

import viser

from soft_continuum.client import own_file
from soft_continuum.client.own_file import (
    Kind,
    MAX_ROUNDS,
    OwnShapesError,
    Saved,
    sequence_text,
    steps_from_text,
    steps_text,
)
from soft_continuum.client.state import angles_text, ArmState
from soft_continuum.mechanics.chain import Chain
from soft_continuum.sequencing import AIMS
from soft_continuum.ui.browser import html
from soft_continuum.ui.browser.controls import Controls, may_run, number_of, on_change, runs
from soft_continuum.ui.browser.meshes import Points, points_of
from soft_continuum.ui.browser.session import Description, PageSession, SEQUENCE_HOLD

if TYPE_CHECKING:
    from soft_continuum.client.sequence import Bending

SET, SHOW, RUN, EDIT, RENAME, DELETE = 'set', 'show', 'run', 'edit', 'rename', 'delete'
MAX_SAVED = 50  # rows of saved shapes, and of saved sequences
NOTHING = html.caption('nothing yet')
ROUNDING = 1e-3  # degrees: limits are written with so many digits


class ShapesPanel:
    """Shapes of one arm; every browser shows the same."""

    def __init__(self, gui: viser.GuiApi, controls: Controls, session: PageSession,
                 description: Description) -> None:
        """Add the controls at the present position of the GUI."""
        self._gui, self._controls = gui, controls
        self._session, self._description = session, description
        self._saved = Saved()
        self._rows: list[Any] = []
        if description.shapes:
            controls.group('Set', tuple(description.shapes), lambda name: self._run([name]),
                           may_run)
        self._names = gui.add_text(
            'Sequence', ', '.join(description.shapes), hint='Shapes, each followed by its hold '
            'time in s (default: 1): c_form 2.5, s_form')
        self._rounds = gui.add_number(
            'Rounds', 1, min=0, max=MAX_ROUNDS, step=1,
            hint='Number of repetitions; 0: until Cancel or STOP')
        self._aim = gui.add_dropdown(
            'Aim', AIMS, hint='Controlled quantity in closed loop: the angle of every segment, or '
            'the position of the tip')
        controls.button('Run sequence', self._run_sequence, may_run)
        controls.button('Cancel', session.cancel, runs, hint='Ends the sequence' + (
            ' with every segment stiff' if description.jamming else ''))
        with gui.add_folder('Own shape', expand_by_default=False):
            self._own = OwnShape(gui, description, lambda: session.preview(self._own.points))
            controls.button('Set own shape',
                            lambda: session.run([self._own.shape], self._chosen_aim), may_run)
        self._folder = gui.add_folder('Saved', expand_by_default=False)
        with self._folder:
            self._list = gui.add_html(NOTHING)  # its rows come here
            self._name = gui.add_text('Name', '', hint='Name for saving or renaming')
            controls.button('Save own shape', self._save_shape,
                            hint='Saves the sliders of Own shape under this name')
            controls.button('Save sequence', self._save_sequence,
                            hint='Saves Sequence and Rounds under this name')
            self._which = gui.add_dropdown('Which', ('',))
            controls.group('Change', (RENAME, DELETE), self._change_which,
                           lambda _: bool(self._saved.names),
                           hint='Renames it to Name, or deletes it')
        controls.updates.append(self._follow_saved)

    @property
    def _chosen_aim(self) -> str:
        """The aim selected on the page; a browser may send any text."""
        return self._aim.value if self._aim.value in AIMS else AIMS[0]

    @property
    def _chosen_name(self) -> str:
        return str(self._name.value).strip()

    def _run(self, shapes: list[str], hold: Any = SEQUENCE_HOLD, rounds: int = 1) -> None:
        self._session.run(shapes, self._chosen_aim, hold, rounds)

    def _run_sequence(self) -> None:
        def run(steps: list[tuple[str, float]]) -> None:
            self._run([name for name, _ in steps], [hold for _, hold in steps],
                      self._chosen_rounds)
        self._with_steps(run)

    def _with_steps(self, work: Callable[[list[tuple[str, float]]], None]) -> None:
        """Use the sequence of the page, or report its problem."""
        try:
            steps = steps_from_text(str(self._names.value), SEQUENCE_HOLD)
        except OwnShapesError as error:
            self._session.refuse('Sequence', str(error))
        else:
            work(steps)

    @property
    def _chosen_rounds(self) -> int:
        return int(number_of(self._rounds.value, 0, MAX_ROUNDS))

    # What was saved.

    def _change(self, change: Callable[..., str], *arguments: Any) -> None:
        self._session.saved.change(
            partial(change, *arguments, library=self._description.shapes))

    def _save_shape(self) -> None:
        self._change(own_file.save_shape, self._chosen_name, self._own.shape)

    def _save_sequence(self) -> None:
        self._with_steps(lambda steps: self._change(
            own_file.save_sequence, self._chosen_name, steps, self._chosen_rounds))

    def _change_which(self, choice: str) -> None:
        name = str(self._which.value)
        kind: Kind = 'sequences' if name in self._saved.sequences else 'shapes'
        if choice == RENAME:
            self._change(own_file.rename, kind, name, self._chosen_name)
        else:
            self._session.saved.change(partial(own_file.delete, kind, name))

    def _on_shape(self, name: str, choice: str) -> None:
        """Carry out a button of a saved shape."""
        if choice == SET:
            self._run([name])
        else:
            shape = self._saved.shapes[name]
            self._session.preview(points_of(self._own.chain, shape.angles, shape.directions))

    def _on_sequence(self, name: str, choice: str) -> None:
        """Carry out a button of a saved sequence."""
        sequence = self._saved.sequences[name]
        if choice == RUN:
            self._run([name], rounds=sequence.rounds)
        else:
            for control, value in ((self._names, steps_text(sequence.steps)),
                                   (self._rounds, sequence.rounds), (self._name, name)):
                control.value = value  # type: ignore[misc]  # it can be set

    def _follow_saved(self, _: ArmState) -> None:
        """Make a row of buttons for each saved item."""
        saved = self._session.saved.offered
        if saved == self._saved:
            return
        self._saved = saved
        for row in self._rows:
            row.remove()
        self._rows = []
        with self._folder:
            for name, shape in list(saved.shapes.items())[:MAX_SAVED]:
                self._add_row(name, (SET, SHOW), self._on_shape,
                              angles_text(shape.angles, shape.directions))
            for name, sequence in list(saved.sequences.items())[:MAX_SAVED]:
                self._add_row(name, (RUN, EDIT), self._on_sequence, sequence_text(sequence))
        names = [*saved.shapes, *saved.sequences]
        shown = len(self._rows) // 2
        self._list.content = ('' if len(names) == shown else
                              html.caption(f'{len(names) - shown} more are not listed')
                              ) if names else NOTHING
        self._which.options = names or ['']

    def _add_row(self, name: str, choices: tuple[str, str], work: Callable[[str, str], None],
                 text: str) -> None:
        order = self._list.order + len(self._rows) / (5 * MAX_SAVED)
        self._rows += [
            self._controls.group(name, choices, partial(work, name), order=order),
            self._gui.add_html(html.caption(escape(text)), order=order)]


class OwnShape:
    """The shape selected on the page."""

    def __init__(self, gui: viser.GuiApi, description: Description,
                 changed: Callable[[], None]) -> None:
        """Add the sliders, all at 0; changed: called when one is moved."""
        self.chain = Chain(description.arm)
        self._limits = description.arm.bending_angle_limits.tolist()
        self._angles, self._directions = [], []
        for number, (limit, directed) in enumerate(zip(
                self._limits, description.directed, strict=True), start=1):
            most = max(1, floor(degrees(limit) + ROUNDING))
            self._angles.append(gui.add_slider(
                f'Angle {number}', 0 if directed else -most, most, 1, 0))
            if directed:
                self._directions.append(gui.add_slider(f'Direction {number}', -180, 180, 1, 0))
        for slider in (*self._angles, *self._directions):
            on_change(slider, lambda _: changed())
        gui.add_html(html.own_shape_html(description))

    @property
    def shape(self) -> 'tuple[Bending, ...]':
        """Bending of each segment: its angle or, for spatial arms, angle and direction, rad."""
        angles, directions = self._values()
        return tuple(zip(angles, directions, strict=True)) if directions else angles

    @property
    def points(self) -> Points:
        """Points along the backbone of that shape, x, y, z, m."""
        return points_of(self.chain, *self._values())

    def _values(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        angles, directions = (
            tuple(radians(number_of(slider.value, -360.0, 360.0)) for slider in sliders)
            for sliders in (self._angles, self._directions))
        return (tuple(max(-limit, min(limit, angle))
                      for angle, limit in zip(angles, self._limits, strict=True)), directions)
