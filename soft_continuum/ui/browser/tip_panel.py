# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Goal of the tip: a handle to drag, the same in numbers, and its plan.

Both are equivalent, for users who cannot drag.
"""

from collections.abc import Sequence
from functools import partial
from math import atan2, cos, degrees, hypot, isfinite, radians, sin
from typing import Any

import numpy as np
import viser

from soft_continuum.client import ArmState, own_file, Pose, Tip
from soft_continuum.colours import GHOST
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.rotations import matrices
from soft_continuum.ui.browser import html
from soft_continuum.ui.browser.controls import Controls, may_run, number_of, on_change, runs
from soft_continuum.ui.browser.limits import TIP_HANDLE
from soft_continuum.ui.browser.meshes import line
from soft_continuum.ui.browser.session import Description, PageSession

HANDLE = 110.0  # px
ROPE = 0.006  # of the length of the arm: the path of the tip
REACH = 1.2  # times the length of the arm: range of the handle


class TipPanel:
    """The goal of the tip of one arm; every browser shows and drags the same."""

    def __init__(self, server: viser.ViserServer, controls: Controls, session: PageSession,
                 description: Description) -> None:
        """Add the controls at the present position of the GUI, and a hidden handle."""
        self._session, self._description = session, description
        self._place: Array = np.zeros(3)
        self._tilt, self._towards = 0.0, 0.0  # rad, its direction
        self._situation: object = None  # what a plan begins with
        self._shown: object = None  # what handle and numbers show
        self._tip: Pose | None = None  # of the arm, the last that was shown
        session.tip.leave()
        gui, far = server.gui, 1e3 * REACH * description.arm.length
        self._on = gui.add_checkbox(
            'Drag the tip', False, hint='Shows a handle for the goal of the tip; nothing moves '
            'before Go')
        self._along = np.array(description.moves_along)
        self._numbers = [gui.add_number(f'Tip {axis} [mm]', 0.0, min=-far, max=far, step=0.1)
                         for axis in description.arm.axes]
        self._directed = gui.add_checkbox(
            'Point it too', False, hint='Also use the direction of the handle')
        self._angles = [gui.add_number(f'{name} [°]', 0.0, min=-180.0, max=180.0, step=0.1)
                        for name in (('Tilt', 'Towards') if self._along.all() else ('Angle',))]
        controls.updates.append(self._show)
        controls.text(lambda _: html.plan_html(
            session.tip.planned, session.tip.late) if self._is_on else '')
        controls.button('Go', self._send, lambda state: (
            self._is_on and may_run(state) and not runs(state) and session.tip.found))
        self._name = gui.add_text('Shape name', '')
        controls.button(
            'Save planned shape', self._save_shape,
            lambda _: self._is_on and bool(session.tip.planned and session.tip.planned.points),
            hint='Saves the shape in green under this name')
        self._add_handle(server.scene)
        on_change(self._on, self._switched)
        for control in (self._directed, *self._numbers):
            controls.grey(control, lambda _: self._is_on)
        for control in self._angles:
            controls.grey(control, lambda _: self._is_on and self._is_directed)
        for control in (self._directed, *self._numbers, *self._angles):
            on_change(control, self._typed)

    def _add_handle(self, scene: viser.SceneApi) -> None:
        length = self._description.arm.length
        self._handle = scene.add_transform_controls(
            TIP_HANDLE, HANDLE, fixed=True, active_axes=self._description.moves_along,
            disable_rotations=True, depth_test=False, visible=False)
        on_change(self._handle, self._dragged)
        self._path = scene.add_line_segments(
            '/arm/tip_path', np.zeros((1, 2, 3)), GHOST, thickness=ROPE * length, visible=False)
        self._drawn: object = None  # the plan whose path is drawn

    # What a browser does.  Whatever it sends, the goal stays a place.

    @property
    def _is_on(self) -> bool:
        return self._on.value is True

    @property
    def _is_directed(self) -> bool:
        return self._directed.value is True

    def _switched(self, _: Any) -> None:
        if not self._on.value:
            self._session.tip.leave()
            return
        tip = self._tip
        if tip is not None and all(map(isfinite, (*tip.position, *tip.orientation))):
            self._take(np.array(tip.position), _matrix(tip.orientation))
        else:
            self._take(np.array([0.0, 0.0, self._description.arm.length]), np.eye(3))
        self._aim()

    def _typed(self, _: Any) -> None:
        if not self._on.value:
            return
        far = REACH * self._description.arm.length
        place = [1e-3 * number_of(number.value, -1e3 * far, 1e3 * far) for number in self._numbers]
        self._place = np.zeros(3)
        self._place[self._along] = place
        self._tilt, *rest = (radians(number_of(angle.value, -180.0, 180.0))
                             for angle in self._angles)
        self._towards = rest[0] if rest else 0.0
        self._aim()

    def _dragged(self, event: Any) -> None:
        if not self._on.value:
            return
        far = REACH * self._description.arm.length
        w, x, y, z = event.target.wxyz
        turned = self._is_directed and hypot(w, x, y, z) > 0.0
        self._take(np.clip(event.target.position, -far, far),
                   _matrix((x, y, z, w)) if turned else None)
        self._aim(dragged=event.phase != 'end')

    def _take(self, place: Array, turn: Array | None) -> None:
        """Keep a position (3,), m, and the direction of a frame (3, 3), if one is given."""
        self._place = place * self._along
        if turn is None:
            return
        x, y, z = turn[:, 2]
        if len(self._angles) > 1:
            across = hypot(x, y)
            self._tilt, self._towards = atan2(across, z), atan2(y, x) if across > 1e-6 else 0.0
        else:
            self._tilt = atan2(x, z)

    @property
    def _direction(self) -> tuple[float, float, float]:
        """The direction of the tip."""
        across = sin(self._tilt)
        return across * cos(self._towards), across * sin(self._towards), cos(self._tilt)

    def _aim(self, dragged: bool = False) -> None:
        position = tuple(self._place[self._along].tolist())
        direction = self._direction if self._is_directed else None
        self._session.tip.aim(
            Tip(position, direction=direction), self._description.arm, dragged)

    def _send(self) -> None:
        goal = self._session.tip.goal
        if goal is not None:
            self._session.run([goal])

    def _save_shape(self) -> None:
        planned = self._session.tip.planned
        if planned is not None and planned.plan is not None and planned.points:
            end = planned.plan.steps[-1]
            shape = (tuple(zip(end.bending_angles, end.bending_directions, strict=True))
                     if end.bending_directions else end.bending_angles)
            self._session.saved.change(partial(
                own_file.save_shape, str(self._name.value).strip(), shape,
                self._description.shapes))

    # Updates.

    def _show(self, state: ArmState) -> None:
        """Show the goal and its path."""
        situation = runs(state), state.stiff, id(self._session.obstacles)
        if self._is_on and situation != self._situation and not runs(state):
            self._aim()  # from the arm, and among the obstacles, as they are now
        self._situation, self._tip = situation, state.tip
        self._show_handle(self._is_on)
        planned = self._session.tip.planned
        if planned is not self._drawn:
            self._drawn = planned
            path = np.array(planned.path if planned else ())
            if len(path) > 1:
                self._path.points = line(path).astype(np.float32)
            self._path.visible = len(path) > 1

    def _show_handle(self, on: bool) -> None:
        """
        Move handle and numbers to the goal when it has changed.

        What a browser sets is there before ``_typed`` and ``_dragged`` know of it, which come on
        another thread: to set it back then would lose it.
        """
        self._handle.visible = on
        directed = self._is_directed
        shown = (directed, *self._place.tolist(), self._tilt, self._towards) if on else None
        if shown == self._shown:
            return
        self._shown = shown
        if not on:
            return
        self._handle.disable_rotations = not directed
        if not np.abs(self._handle.position - self._place).max() < 1e-9:
            self._handle.position = tuple(self._place)
        w, x, y, z = self._handle.wxyz
        tilt, direction = (self._tilt, self._direction) if directed else (0.0, (0.0, 0.0, 1.0))
        if not float(_matrix((x, y, z, w))[:, 2] @ direction) > 1.0 - 1e-9:
            self._handle.wxyz = (cos(tilt / 2), -sin(self._towards) * sin(tilt / 2),
                                 cos(self._towards) * sin(tilt / 2), 0.0)
        for number, value in (
                *((number, round(1e3 * value, 1)) for number, value in zip(
                    self._numbers, self._place[self._along], strict=True)),
                *((number, round(degrees(value), 1)) for number, value in zip(
                    self._angles, (self._tilt, self._towards), strict=False))):
            if number.value != value:
                number.value = value  # type: ignore[misc]  # it can be set


def _matrix(quaternion: Sequence[float]) -> Array:
    """Return the rotation (3, 3) of a quaternion x, y, z, w of any length."""
    found: Array = matrices(np.array(quaternion) / max(hypot(*quaternion), 1e-9))
    return found
