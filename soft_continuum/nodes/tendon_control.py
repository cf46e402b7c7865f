# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The control thread of tendon_actuation."""

from collections.abc import Callable
from dataclasses import dataclass

from soft_continuum.hardware.clock import STEADY
from soft_continuum.hardware.protocols import HardwareError, TendonReading
from soft_continuum.hardware.tendon_controller import (
    MotionRefusedError,
    Reason,
    TendonController,
    TensionGuard,
)
from soft_continuum.mechanics.arm import Array
from soft_continuum.nodes.managed_node import DeviceControl, RestingStream
from soft_continuum.nodes.reported_arm import Interlock, ReportedArm, UNPULLED
from soft_continuum.ros.conversions import accuracy_to_ros, Stiffness
from soft_continuum.ros.entries import Confirmation
from soft_continuum.ros.motion_tracker import replaced_by
from soft_continuum_interfaces.msg import MotionRequest, TendonActuationState

MAX_POINTS = 1000
"""Largest number of points of a trajectory."""
MAX_LATENESS = 0.5
"""Largest delay of a control cycle, s: after it the queued motion has run out."""
MAX_JUMP = 0.5
"""Largest jump of ROS time, s, that does not end a motion with a stamp."""
CHANGED = 'a segment changed between soft and stiff, or its vacuum was set'
REST_CHANGE = 1e-6  # m of pull
MAX_REVOKED = 20  # motions whose further parts are refused


@dataclass(frozen=True)
class Request:
    """
    A trajectory to be validated.

    times: (k,) s from its start.  pulls: (k, tendons) m.  start: s (steady), None for as soon as
    it is accepted.  revocation: number of revocations when it was received.  stamp: ns of ROS
    time, the start as it was sent; 0 for none.
    """

    id: str
    times: Array
    pulls: Array
    start: float | None
    revocation: int
    stamp: int = 0


@dataclass(frozen=True)
class Report:
    """
    State after a cycle or a request.

    ended, refused: why the last motion was, for people; empty once a later one is accepted.
    unmeasured: which load cell is stale or implausible.  reading: the last one or None; its pulls
    are only valid if referenced.  time, start: of the reading and of the accepted trajectory, s
    (steady).
    """

    state: TendonActuationState
    ended: str
    refused: str
    unmeasured: str
    reading: TendonReading | None
    time: float
    start: float


class TendonControl(DeviceControl):
    """
    Moves the tendons, within limits and interlocks; its snapshots are Reports.

    Other threads only read ``revocations`` and ``lost``.
    """

    _controller: TendonController | None

    def __init__(self, tendons: tuple[str, ...], arm: ReportedArm, period: float,
                 jump: Callable[[], float], tension_limit: Callable[[], float],
                 report: Callable[[Report], None],
                 release: Callable[[TendonController], None]) -> None:
        """
        Start without a device.

        period: of the control cycle, s.  jump: returns the jump of ROS time since its last call,
        s.  tension_limit: N, of measured tensions.  release: called with a device that failed,
        to close it elsewhere.
        """
        super().__init__(report)
        self._tendons, self._arm, self._period, self._jump = tendons, arm, period, jump
        self._tension_limit, self._release = tension_limit, release
        self._guard = TensionGuard(tendons)
        self._stream = RestingStream(REST_CHANGE)
        self._stops = 0
        self._path = 0, 0.0  # stamp (ns) and start (s) of the accepted trajectory; 0: no stamp
        self._time = STEADY()  # of the last reading, s
        self._accepted, self._refused = MotionRequest(), MotionRequest()
        self._start = 0.0  # of the accepted trajectory, s (steady)
        self._stiffness_at_start = Stiffness(())
        self._stopped, self._stop_message = TendonActuationState.NOT_STOPPED, ''
        self._emergency = False  # whether emergency_stop is on
        self._ended = self._refusal = ''  # why the last motion was ended, refused, for people
        self._known_pulls = (0.0,) * len(tendons)  # the last ones that were referenced, m
        self._question = Confirmation()
        self._revoked: tuple[int, Reason, str] = (0, Reason.NO_REASON, '')
        self._over: dict[str, tuple[Reason, str]] = {}  # motions that were revoked, by their id

    @property
    def revocations(self) -> int:
        """Number of revocations, each of which cancels all earlier requests."""
        return self._revoked[0]

    # The device.

    def attach(self, device: TendonController) -> None:
        """Control a device from now on; a stop remains in force."""
        super().attach(device)
        self._time = STEADY()
        if self._stop_message:
            device.stop(self._stop_message)
        self.report()

    def deactivate(self) -> None:
        """Brake, hold and accept no trajectories."""
        self._active = False
        self._stops += 1
        self.hold(Reason.INACTIVE, 'the node was deactivated')

    def _lose(self, error: HardwareError) -> None:
        """Let go of a device that failed; nothing moves before it is back and resumed."""
        if self._controller is not None:
            self._release(self._controller)
        self._controller = None
        self._fault, self.lost = str(error), True
        self._stops += 1
        if not self._stop_message:
            self._stopped = TendonActuationState.STOPPED_BY_DEVICE
            self._stop_message = f'the device failed: {error}'
        self._revoke(Reason.DEVICE, str(error))
        self.report()

    def failed(self, error: Exception) -> None:
        """Treat an error of this program like a failed device."""
        self._lose(HardwareError(f'control failed: {type(error).__name__}: {error}'))

    # Trajectories.

    def prepare(self, request: Request) -> Array:
        """
        Make the quick checks of a trajectory; return the pulls (k, tendons) m to predict.

        Raises MotionRefusedError.
        """
        controller = self._checked(request)
        trajectory, _ = self._trajectory(controller, request)
        return controller.plan(*trajectory, self._goes_on(request))[1]

    def follow(self, request: Request, stiffness: Stiffness) -> None:
        """
        Follow a trajectory whose tensions were predicted for ``stiffness``.

        Raises MotionRefusedError.
        """
        controller = self._checked(request)
        if stiffness != self._arm.stiffness:
            raise MotionRefusedError(
                Reason.STIFFNESS_CHANGED, f'{CHANGED} before the motion began')
        limit = self._tension_limit()
        if problem := self._guard.unmeasured(controller.reading, limit):
            raise MotionRefusedError(Reason.DEVICE, problem)
        if problem := self._guard.refusal(controller.reading, request.pulls, limit):
            raise MotionRefusedError(Reason.TENSION, problem)
        begins = not controller.busy
        if not controller.following:
            self._jump()  # what it was at rest does not count
        trajectory, delay = self._trajectory(controller, request)
        controller.accept(*trajectory, self._goes_on(request))
        controller.delay, self._path = delay, (request.stamp, trajectory[3] - delay)
        if begins:
            self._guard.begin(controller.reading)
        if request.id != self._accepted.id and self._accepted.status == MotionRequest.FOLLOWING:
            self._end_request(Reason.REPLACED, replaced_by(request.id))
            self.report()
        self._accepted = MotionRequest(id=request.id, status=MotionRequest.FOLLOWING)
        self._start = trajectory[3]
        self._stiffness_at_start = stiffness
        self._ended = self._refusal = ''
        self.report()

    def _checked(self, request: Request) -> TendonController:
        count, reason, message = self._revoked
        if count != request.revocation:
            self._forbid(request.id, reason, message)
            raise MotionRefusedError(reason, message)
        if request.id in self._over:
            reason, message = self._over[request.id]
            raise MotionRefusedError(
                reason, f'the motion {request.id} has ended ({message}); send another one with '
                'another id')
        if self._controller is None or not self._active:
            raise MotionRefusedError(
                Reason.DEVICE if self._fault else Reason.INACTIVE,
                self._fault or 'the node is not active')
        if interlock := self._arm.motion_interlock():
            raise MotionRefusedError(interlock.reason, interlock.message)
        return self._controller

    def _trajectory(self, controller: TendonController, request: Request
                    ) -> tuple[tuple[Array, Array, float, float], float]:
        """
        Return times, pulls, the present and the start on one clock, and the delay in it, s.

        A motion in parts keeps its path: what comes late of it makes the rest as much later.
        """
        now, delay = STEADY(), 0.0
        controller.postpone(now)
        start = now if request.start is None else request.start
        if request.start is not None and self._continues(request):
            delay = controller.delay
            if self._goes_on(request):
                start = self._path[1]
                if not controller.following:  # the part before this one ended already
                    delay += max(0.0, now - controller.end)
        elif request.id and len(request.times) and request.times[0] == 0.0:
            delay = max(0.0, now - start)
        start += delay
        return (start + request.times, request.pulls, now, start), delay

    def _continues(self, request: Request) -> bool:
        """Return whether a trajectory is a further part of the motion that was accepted last."""
        return bool(request.id) and request.id == self._accepted.id

    def _goes_on(self, request: Request) -> bool:
        """Return whether it is also of the same path: its times count from the same start."""
        return self._continues(request) and request.stamp == self._path[0] != 0

    def refuse(self, request_id: str, reason: Reason, message: str) -> None:
        """Report that a trajectory is refused; a present motion continues."""
        self._refusal = message
        self._refused = _early(request_id, MotionRequest.REFUSED, reason, message)
        self.report()

    # Holding, stopping, referencing.

    def _revoke(self, reason: Reason, message: str) -> None:
        """End the motion, and refuse the trajectories that are being judged."""
        self._revoked = (self._revoked[0] + 1, reason, message)
        self._end_request(reason, message)

    def _end_request(self, reason: Reason, message: str) -> None:
        if self._accepted.status == MotionRequest.FOLLOWING:
            self._forbid(self._accepted.id, reason, message)
            self._accepted = _early(self._accepted.id, MotionRequest.ENDED, reason, message)

    def _forbid(self, request_id: str, reason: Reason, message: str) -> None:
        """Accept no further part of a motion: it may come in parts that share an id."""
        if request_id:
            self._over[request_id] = reason, message
            if len(self._over) > MAX_REVOKED:
                del self._over[next(iter(self._over))]

    def give_up(self, request_id: str) -> None:
        """Withdraw the trajectory of an id, which was reported to its sender as failed."""
        if self._accepted.id == request_id:
            self.hold(Reason.HELD, 'its sender withdrew it')
        self._forbid(request_id, Reason.HELD, 'its sender withdrew it')

    def hold(self, reason: Reason, message: str) -> None:
        """Brake and hold, ready for the next trajectory."""
        self._revoke(reason, message)
        if self._controller is not None:
            try:
                self._controller.hold()
            except HardwareError as error:
                self._lose(error)
        self.report()

    def stop(self, kind: int, message: str) -> tuple[bool, str]:
        """
        Brake and hold; nothing moves before ``resume``.

        kind: of TendonActuationState.  Returns success (the device was reached) and a message.
        """
        self._stopped, self._stop_message = kind, message
        self._stops += 1
        self._revoke(Reason.STOPPED,
                     f'stopped ({message}); call ~/resume before any motion')
        answer = True, 'stopped, holding tension; nothing moves before ~/resume'
        if self._controller is None:
            answer = True, 'not connected; stopped nevertheless'
            if self._fault:
                answer = False, f'the stop did not reach the device: {self._fault}'
        else:
            try:
                self._controller.stop(message)
            except HardwareError as error:
                self._lose(error)
                answer = False, f'the stop did not reach the device: {error}'
        self.report()
        return answer

    def emergency(self, on: bool) -> None:
        """Stop while emergency_stop is on; when it goes off, wait for ``resume``."""
        self._emergency = on
        if on:
            self.stop(TendonActuationState.STOPPED_BY_EMERGENCY, 'emergency_stop is on')
        else:
            self.report()

    def resume(self) -> tuple[bool, str]:
        """Accept motion again, from where the tendons are; return success and a message."""
        if self._emergency:
            return False, ('emergency_stop is on; the program that turned it on must first '
                           'publish false, as the only publisher')
        if not self._active or self._controller is None:
            return False, self._fault or 'the node is not active'
        self._controller.resume()
        self._stopped, self._stop_message = TendonActuationState.NOT_STOPPED, ''
        self._ended = ''
        self.report()
        return True, 'ready, from the present position'

    def reference(self) -> tuple[bool, str]:
        """
        Take the position as zero pull, or begin to home; return success and a message.

        If the arm was last known to be bent, the request must be repeated.
        """
        if not self._active or self._controller is None:
            return False, self._fault or 'the node is not active'
        homes = self._controller.driver.reference_moves
        if homes and (interlock := self._arm.homing_interlock()):
            return False, interlock.message
        reading = self._controller.reading
        if homes and (problem := self._guard.unmeasured(reading, self._tension_limit())):
            return False, problem
        try:
            self._controller.check_reference()
            if question := self._question.ask(self._arm.last_bent or self._pulled(), (
                    'every pull would count as 0 here, and every later shape would be off by that '
                    'bend; straighten the arm, with its tendons just taut')):
                return False, question
            self._controller.reference()
        except MotionRefusedError as error:
            return False, str(error)
        except HardwareError as error:
            self._lose(error)
            return False, str(error)
        self._ended = ''
        self._guard.begin(reading)
        self.report()
        return True, ('homing; the tendons are at zero pull when they rest' if homes else
                      'the present position counts as the straight arm, every pull as 0; '
                      'call kinematics/reset if the shape of the arm was not known, or bent')

    def _pulled(self) -> str:
        """Return which tendon was pulled most where it was last known; empty for none."""
        name, pull = max(zip(self._tendons, self._known_pulls, strict=True),
                         key=lambda one: abs(one[1]))
        return f'{name} was pulled by {1e3 * pull:.1f} mm' * (abs(pull) > UNPULLED)

    # The control cycle.

    def cycle(self, late: float) -> None:
        """Send the next set-points to the driver unless an interlock is active; late: s."""
        controller = self._controller
        if controller is None:
            return
        jump = self._jump() if controller.following else 0.0
        try:
            if not self._ended and (
                    interlock := self._cycle_interlock(controller, late, jump)):
                self._end(controller, interlock)
            self._time = STEADY()
            reading = controller.update(self._time, self._period)
            if controller.busy and not self._ended and (
                    interlock := self._tension_interlock(reading)):
                self._end(controller, interlock)
        except HardwareError as error:
            self._lose(error)
            return
        busy = controller.busy
        if not busy and self._accepted.status == MotionRequest.FOLLOWING:
            self._accepted = MotionRequest(id=self._accepted.id, status=MotionRequest.DONE)
        if self._stream.due(self._time, (busy, reading.referenced), reading.pulls) or busy:
            self.report()

    def _tension_interlock(self, reading: TendonReading) -> Interlock | None:
        limit = self._tension_limit()
        if problem := self._guard.unmeasured(reading, limit):
            return Interlock(Reason.DEVICE, problem)
        if problem := self._guard.problem(reading, limit):
            return Interlock(Reason.TENSION, problem)
        return None

    def _end(self, controller: TendonController, interlock: Interlock) -> None:
        """Brake and hold, for a reason other than a request."""
        controller.hold()
        self._revoke(interlock.reason, interlock.message)
        self._ended = f'motion ended: {interlock.message}'

    def _cycle_interlock(self, controller: TendonController, late: float, jump: float
                         ) -> Interlock | None:
        if not controller.busy:
            return None
        if controller.homing:
            return self._arm.homing_interlock()
        if interlock := self._arm.motion_interlock():
            return interlock
        if self._stiffness_at_start != self._arm.stiffness:
            return Interlock(Reason.STIFFNESS_CHANGED, f'{CHANGED} during the motion')
        if controller.following and late > MAX_LATENESS:
            return Interlock(
                Reason.LATE, f'the control cycle came {late:.3f} s late; allowed: '
                f'{MAX_LATENESS:g} s; the computer is too busy')
        if controller.following and self._path[0] and abs(jump) > MAX_JUMP:
            return Interlock(
                Reason.CLOCK, f'ROS time jumped by {jump:.3f} s while a trajectory with a '
                f'header.stamp was followed; allowed: {MAX_JUMP:g} s; send it again')
        return None

    def snapshot(self) -> Report:
        """Return the state as it is now."""
        controller = self._controller
        state = TendonActuationState(
            tendons=list(self._tendons), connected=controller is not None, fault=self._fault,
            stopped=self._stopped, stop_message=self._stop_message, stops=self._stops,
            emergency_stop=self._emergency, accepted=self._accepted, refused=self._refused)
        reading = None
        if controller is not None:
            state.referenced = controller.reading.referenced
            state.moving, state.homing = controller.busy, controller.homing
            accuracy_to_ros(controller.reading.accuracy, state)
            if state.referenced:
                self._known_pulls = controller.reading.pulls
            if self._active:
                reading = controller.reading
        unmeasured = self._guard.unmeasured(reading, self._tension_limit()) if reading else ''
        return Report(state, self._ended, self._refusal, unmeasured, reading, self._time,
                      self._start)


def _early(request_id: str, status: int, reason: Reason, message: str) -> MotionRequest:
    """Return a request that was refused or ended before its end."""
    return MotionRequest(id=request_id, status=status, message=message,
                         reason=getattr(MotionRequest, reason.name))
