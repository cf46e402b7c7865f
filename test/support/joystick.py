# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A joystick, a servo and a teleop that listens to it."""

from threading import Lock
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
import pytest
from sensor_msgs.msg import Joy

from soft_continuum.ui.teleop.joystick import RELEASE
from soft_continuum_interfaces.msg import TeleopState, TendonTrajectory
from support.ros_rig import DEADLINE, LATCHED, RELIABLE, Rig, trajectory

PERIOD = 0.05  # s, as joy_node repeats
LB, A, B, X, BACK, START, RB = 4, 0, 1, 2, 6, 7, 5
PATIENT = {'teleop.timeout': 2.0}  # of a busy machine, on which messages come late
RIGHT, LEFT = -1.0, 1.0  # as joy_node counts
MARK_PERIOD = 2.0  # s after which another mark is sent: one is lost while too many wait


class Joystick:
    """An Xbox pad as joy_node publishes it, with a servo and a teleop that listens to it."""

    def __init__(self, rig: Rig, teleop: bool = True, **description: Any) -> None:
        self.rig = rig
        self.nodes = [rig.start('servo', ready=False, tendon_speed=0.02, **description)[0]]
        if teleop:
            self.nodes += rig.start('teleop', ready=False, **PATIENT)
        self.statuses = rig.record(DiagnosticStatus, 'servo/status', LATCHED)
        self.states = rig.record(TeleopState, 'teleop/state', LATCHED)
        self.sent = rig.record(
            TendonTrajectory, 'tendon_actuation/tendon_trajectory', RELIABLE)
        self._publisher = rig.publisher(Joy, 'joy')
        self._trajectories = rig.publisher(
            TendonTrajectory, 'tendon_actuation/tendon_trajectory')
        self._marks = 0
        self._message = Joy(axes=[0.0] * 8, buttons=[0] * 11)
        self._lock = Lock()  # so that the timer does not send what was held before
        self._unrest = 0.0  # part by which the stick is less far than it is held
        self._timer = rig.observer.create_timer(PERIOD, self._publish)
        rig.wait_for(lambda: len(self.statuses), 'a status of the servo')

    def _publish(self) -> None:
        with self._lock:
            # A hand never holds a stick quite still; one that does not change has lost its radio.
            self._unrest = 1e-3 - self._unrest
            message = Joy(buttons=self._message.buttons, axes=[
                axis * (1.0 - self._unrest) for axis in self._message.axes])
            message.header.stamp = self.rig.observer.get_clock().now().to_msg()
            self._publisher.publish(message)

    def unplug(self) -> None:
        """Say nothing more; its executor would end if that came while it takes the timer."""
        self.rig.on_ros_thread(self._timer.cancel)

    def close(self) -> None:
        """Release everything, unplug it, and end its nodes."""
        self.show()
        self.unplug()
        for node in self.nodes:
            self.rig.end(node)

    def plug(self) -> None:
        """Go on."""
        self.rig.on_ros_thread(self._timer.reset)

    def show(self, *pressed: int, x: float = 0.0, y: float = 0.0) -> None:
        """Hold these buttons, and the left stick like this, from now on."""
        with self._lock:
            self._message = Joy(axes=[x, y] + [0.0] * 6,
                                buttons=[int(n in pressed) for n in range(11)])
        self._publish()

    def wait_for(self, text: str, **fields: Any) -> TeleopState:
        """Wait until teleop says so."""
        def found() -> bool:
            state = self.states.last
            return state is not None and text in state.message and all(
                getattr(state, name) == value for name, value in fields.items())

        if not self.rig.until(found, DEADLINE):
            pytest.fail(f'not within {DEADLINE:g} s: {text} {fields}; is: {self.states.last}')
        state: TeleopState = self.states.last
        return state

    def press(self, button: int, text: str, **fields: Any) -> None:
        """Press a button, wait for what teleop says of it, release it."""
        self.show(button)
        self.wait_for(text, **fields)
        self.show()

    def steer(self, x: float = 0.0, y: float = 0.0) -> None:
        """Hold the button, then deflect the stick, again if told so, and wait for a motion."""
        def moves() -> bool:
            message = self.states.last.message
            if RELEASE in message:  # messages came later than PATIENT, which ends a motion
                self.show()
                self.wait_for('', enabled=False)
                self._deflect(x, y)
            return 'moving' in message

        self._deflect(x, y)
        self.rig.wait_for(moves, 'a teleop that moves the arm', 2.0 * DEADLINE)
        self.rig.wait_for(lambda: self.rig.moving, 'a motion')
        self.rig.wait_for(lambda: not self._without_target(), 'a servo that follows')

    def _deflect(self, x: float, y: float) -> None:
        self.show(LB)
        self.wait_for('', enabled=True)
        self.show(LB, x=x, y=y)

    def _without_target(self) -> bool:
        return any(text in self.statuses.last.message for text in ('no target', 'disabled'))

    def _all_judged(self) -> bool:
        """
        Wait until tendon_actuation has judged what was sent; whether the servo sent no more since.

        On a busy machine that takes a while, and what waits moves a tendon that has come to rest.
        """
        before, states = len(self.sent), self.rig.states['tendon_actuation']
        self._marks += 1
        mark = TendonTrajectory(id=f'mark {self._marks}',
                                trajectory=trajectory([(1.0, [0.0])], ('of no tendon',)))
        self._trajectories.publish(mark)
        judged = self.rig.until(lambda: mark in self.sent and any(
            state.refused.id == mark.id for state in list(states)), MARK_PERIOD)
        return bool(judged) and len(self.sent) == before + 1

    def assert_rests(self) -> None:
        """Claim that the servo follows nothing, the tendons rest, and nothing more is sent."""
        self.rig.wait_for(self._without_target, 'a servo without a target')
        self.rig.wait_for(self._all_judged, 'an end of what the servo sent')
        self.rig.wait_for(lambda: self.rig.at_rest, 'rest')
        sent = len(self.sent)
        self.rig.assert_rests()
        assert len(self.sent) == sent
