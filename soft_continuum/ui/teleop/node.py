# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The node that steers an arm by messages of a joystick."""

from typing import Any

from sensor_msgs.msg import Joy

from soft_continuum.hardware.clock import STEADY
from soft_continuum.nodes.conflicts import Conflicts
from soft_continuum.nodes.suite_node import OK, StatePublisher, SuiteNode, WARN
from soft_continuum.ros.entries import repeat, SENSOR, subscribe
from soft_continuum.ros.names import TELEOP, UNKNOWN_NODE
from soft_continuum.text import plain
from soft_continuum.ui.teleop.joystick import (
    EMERGENCY_STOP,
    EnableButton,
    MODE,
    NEXT_SEGMENT,
    Pad,
    PadError,
    RESET,
    SOFTEN,
    STIFFEN,
)
from soft_continuum.ui.teleop.steered_arm import BENDING, SteeredArm
from soft_continuum_interfaces.msg import TeleopState

JOY = 'joy'
PERIOD = 0.05  # s between two looks at whether messages still come
DESCRIPTION_PERIOD = 2.0  # s between two requests for the description of the arm
MAX_JOY_BYTES = 4096
NO_DEVICE = ('no joystick: nothing received on joy; start joy_node, or `soft_continuum teleop` '
             'for the keyboard')


class Teleop(SuiteNode):
    """
    Steers one segment by a joystick while its enable button is held.

    Subscribes to joy (sensor_msgs/Joy), and to the topics of a client.  Publishes targets of the
    servo, emergency_stop (std_msgs/Bool), ~/state (TeleopState, latched), ~/status and
    /diagnostics.  All requests go through the services of the other nodes, which may refuse them.
    It does not use the mechanics.
    """

    def __init__(self, **options: Any) -> None:
        """Declare parameters and topics; raises ParameterError."""
        super().__init__(TELEOP, 'joystick', **options)
        self._pad = Pad.from_parameters(self.parameters)
        self._states = StatePublisher(self, TeleopState)
        self._conflicts = Conflicts(self, 0)
        self._enable_button = EnableButton(
            self.parameters['teleop.timeout'], self.parameters['teleop.unchanged_timeout'])
        self._arm = SteeredArm(self, self.parameters)
        self._device_problem = ''  # why steering is impossible: two devices, or two of this node
        self._pressed: frozenset[str] | None = None  # by the last message; None: not known
        self._refusal = ''  # why a button did nothing, as long as the enable button is held
        self._actions = {
            MODE: self._arm.change_mode, NEXT_SEGMENT: self._arm.next_segment,
            SOFTEN: self._arm.soften, STIFFEN: self._arm.stiffen, RESET: self._arm.reset}
        subscribe(self, Joy, JOY, self._on_joy, SENSOR, MAX_JOY_BYTES)
        repeat(self, PERIOD, self._tick)

    def start(self) -> None:
        """Request the description of the arm, repeatedly."""
        self._arm.follow_description()
        repeat(self, DESCRIPTION_PERIOD, self._arm.follow_description)
        self._report()

    def quit(self) -> None:
        """Let the arm come to rest before the process ends."""
        self._arm.release()
        self._enable_button.lose('the node ended')
        self._report()

    def callback_failed(self, error: Exception) -> None:
        """Let the arm come to rest, and report what a callback raised."""
        super().callback_failed(error)
        self._enable_button.lose('teleop failed')
        self._arm.release()

    def _on_joy(self, message: Joy) -> None:
        now, stamp = STEADY(), message.header.stamp
        try:
            controls = self._pad.read(message.axes, message.buttons)
        except PadError as error:
            self._enable_button.lose(str(error))
            self._pressed = None
        else:
            seconds = stamp.sec + 1e-9 * stamp.nanosec
            self._enable_button.receive(controls, now, seconds or None)
            if not self._enable_button.held:
                self._refusal = ''
            before, self._pressed = self._pressed, controls.pressed
            if before is not None:  # else it may have been pressed long ago
                self._press(controls.pressed - before)
            elif EMERGENCY_STOP in controls.pressed:
                self._arm.stop_all()
        self._steer(now)
        self._report()

    def _press(self, pressed: frozenset[str]) -> None:
        """Do what buttons ask for; while the enable button is held, only the emergency stop."""
        if EMERGENCY_STOP in pressed:
            self._arm.stop_all()
        for name, action in self._actions.items():
            if name in pressed and not self._device_problem:  # two would seem to press by turns
                if self._enable_button.held:
                    self._refusal = 'release the enable button first'
                else:
                    action()

    def _tick(self) -> None:
        now = STEADY()
        self._device_problem = self._find_device_problem()
        self._arm.choose()
        self._arm.keep_stopped()
        if not self._enable_button.connected(now):
            self._pressed = None
        self._steer(now)
        self._report()

    def _steer(self, now: float) -> None:
        stick, arm = self._enable_button.stick(now), self._arm
        interruption = arm.interruption()
        if not self._enable_button.connected(now):
            arm.release()
        elif stick is None:
            arm.rest()
        elif problem := self._device_problem or arm.problem() or interruption:
            arm.rest()
            self._enable_button.end(problem)  # afterwards nothing moves automatically
        else:
            arm.move(stick)

    def _find_device_problem(self) -> str:
        if problem := self._conflicts.problem:
            return problem
        names = sorted(info.node_name for info in self.get_publishers_info_by_topic(
            self.resolve_topic_name(JOY)) if info.node_name != UNKNOWN_NODE)
        if len(names) > 1:
            return (f'{JOY} is published by {" and ".join(map(plain, names[:5]))}: end all but '
                    'one; a program that was killed counts for 20 s')
        return ''

    def _report(self) -> None:
        now, arm = STEADY(), self._arm
        connected, enabled = self._enable_button.connected(now), self._enable_button.held
        what = f'segment {arm.segment}' if arm.mode == BENDING else (
            f'the tip with segment {arm.segment}')
        wrong = self._device_problem or self._enable_button.problem or (
            '' if connected else NO_DEVICE) or (arm.problem() if arm.stopped else '')
        motion = f'ready to move {what}' if not arm.moving else '; '.join(
            filter(None, (f'moving {what}', arm.servo_text)))
        text = wrong or '; '.join(filter(None, (
            self._refusal, arm.doing or arm.note or arm.problem() or motion)))
        self._states.publish(TeleopState(
            connected=connected, enabled=enabled, mode=arm.mode, segment=arm.segment,
            message=text))
        self.status.set(WARN if wrong and connected else OK, text,
                        connected=str(connected).lower(), enabled=str(enabled).lower(),
                        segment=arm.segment)
