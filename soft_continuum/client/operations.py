# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Manual operations of the arm, as coroutines on the node that observes it."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import count
from typing import Any, TYPE_CHECKING

from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from soft_continuum.client.errors import (
    ClientError,
    MotionEndedError,
    NoAnswerError,
    NodesMissingError,
    RefusedError,
)
from soft_continuum.client.tasks import ATTEMPTS, Tasks, until
from soft_continuum.ros.names import (
    JAMMING_VALVES,
    KINEMATICS,
    NODES,
    RECORDER,
    SHAPE_SEQUENCER,
    TENDON_ACTUATION,
)
from soft_continuum.text import printable
from soft_continuum_interfaces.srv import SetVacuum

if TYPE_CHECKING:  # imports that stop does not need are local
    from soft_continuum.client.observed import ObservedArm
    from soft_continuum.mechanics.arm import Arm
    from soft_continuum_interfaces.msg import TendonTrajectory

CLOSED_LOOP = 'closed_loop'  # parameter of shape_sequencer
JOG_SPEED = 0.01  # m/s
JOG_MINIMUM = 0.2  # s
SWITCHING_TIMEOUT = 15.0  # s for a segment to be evacuated or vented
SETTLING_TIMEOUT = 1.0  # s for topics that a running node may not publish


class Operations(Tasks):
    """
    The part of Requests without sequences.

    Every coroutine returns when it is done, or raises a ClientError with the reason.  Run them
    with ``start``, on the thread that spins the node.
    """

    hears_feedback = True
    """Whether ``observed`` subscribes to the feedback of sequences of any client."""

    def __init__(self, node: Node, timeout: float, discovery_timeout: float | None = None) -> None:
        """``timeout``: s for a response, and for discovery of a node unless given separately."""
        super().__init__(
            node, timeout, timeout if discovery_timeout is None else discovery_timeout)
        self._numbers = count(1)
        self._jog: tuple[str, dict[str, float]] = '', {}  # id and target (m) of the running one

    @cached_property
    def observed(self) -> 'ObservedArm':
        """The observed arm, created on first use."""
        from soft_continuum.client.observed import ObservedArm
        observed = ObservedArm(self.node, feedback=self.hears_feedback)
        observed.on_change(self.step)
        return observed

    async def observe(self) -> 'ObservedArm':
        """Return the observed arm once its nodes have reported; raises NodesMissingError."""
        observed = self.observed
        if not await until(lambda: any(observed.running().values()), self.discovery_timeout):
            raise self.not_found('the arm', NODES, self.discovery_timeout)
        await until(lambda: all(observed.message(f'{name}/status') is not None
                                for name, runs in observed.running().items() if runs),
                    self.timeout)
        await until(lambda: observed.complete, SETTLING_TIMEOUT)
        return observed

    async def trigger(self, service: str, attempts: int = 1) -> str:
        """Call a std_srvs/Trigger; return its message, or raise RefusedError with it."""
        answer = await self.call(Trigger, service, attempts=attempts)
        if not answer.success:
            raise RefusedError(f'{service}: {answer.message}')
        return printable(answer.message)

    async def stop(self) -> str:
        """Stop all motion, holding tension; nothing moves until ``resume``."""
        return await self.trigger(f'{TENDON_ACTUATION}/stop', ATTEMPTS)

    async def resume(self) -> str:
        """Allow motion after a stop, from where the tendons are."""
        return await self.trigger(f'{TENDON_ACTUATION}/resume')

    async def reference(self, sure: bool = False) -> str:
        """Set the present pulls as the zero of the straight arm; sure: as in ``_say``."""
        return await self._say(f'{TENDON_ACTUATION}/reference', sure)

    async def reset(self, sure: bool = False) -> str:
        """Reset kinematics to the straight arm; sure: as in ``_say``."""
        return await self._say(f'{KINEMATICS}/reset', sure)

    async def _say(self, service: str, sure: bool) -> str:
        """Call a service that refuses with a question; sure: confirm by calling it again."""
        try:
            return await self.trigger(service)
        except RefusedError:
            if not sure:
                raise
        return await self.trigger(service)

    async def record(self, begin: bool) -> str:
        """Start or end a recording of the recorder; return its message."""
        service = f'{RECORDER}/record'
        if self.observed.recorder is None:
            raise NodesMissingError('the recorder does not run; start it with: ros2 run '
                                    'soft_continuum recorder')
        answer = await self.call(SetBool, service, data=begin)
        if not answer.success:
            raise RefusedError(f'{RECORDER}: {answer.message}')
        return printable(answer.message)

    # Parameters of the nodes.

    async def description(self) -> 'Arm':
        """Return the mechanical description used by kinematics, planar or spatial."""
        from soft_continuum.parameters.arm import arm_from_parameters, ARM_PARAMETERS
        from soft_continuum.parameters.parameter import ParameterError
        values = await self.parameters(KINEMATICS, [p.name for p in ARM_PARAMETERS])
        if len(values) < len(ARM_PARAMETERS):
            raise ClientError(f'{KINEMATICS} lacks parameters of an arm; run nodes and client '
                              'from the same version')
        try:
            return arm_from_parameters(values)
        except ParameterError as error:
            raise ClientError(f'{KINEMATICS}: {error}') from None

    async def has_jamming(self) -> bool:
        """Return whether the segments of the arm can be stiffened."""
        return bool((await self.parameters(KINEMATICS, ['arm.jamming'])).get('arm.jamming', True))

    async def shapes(self, description: 'Arm') -> dict[str, tuple[float, ...]]:
        """Return the shape library: bending angles (rad) of each segment by name."""
        from soft_continuum.parameters.parameter import ParameterError
        from soft_continuum.parameters.shapes import SHAPE_PREFIX, shapes_from_parameters
        names = (await self.parameters(SHAPE_SEQUENCER, ['shape_names'])).get('shape_names', ())
        angles = await self.parameters(SHAPE_SEQUENCER, [SHAPE_PREFIX + name for name in names])
        directions = await self._directions(names)
        try:
            return shapes_from_parameters(
                {'shape_names': tuple(names), **angles, **directions}, description)
        except ParameterError as error:
            raise ClientError(f'{SHAPE_SEQUENCER}: {error}') from None

    async def shape_directions(self) -> dict[str, tuple[float, ...]]:
        """Return the bending directions (rad) of each segment by name, for shapes with any."""
        from soft_continuum.parameters.shapes import directions_from_parameters
        names = (await self.parameters(SHAPE_SEQUENCER, ['shape_names'])).get('shape_names', ())
        return directions_from_parameters(await self._directions(names))

    async def _directions(self, names: Sequence[str]) -> dict[str, Any]:
        from soft_continuum.parameters.shapes import DIRECTION_PREFIX
        return await self.parameters(
            SHAPE_SEQUENCER, [DIRECTION_PREFIX + name for name in names])

    async def closed_loop(self) -> bool | None:
        """Return whether shape_sequencer corrects with measurements; None if not supported."""
        value = (await self.parameters(SHAPE_SEQUENCER, [CLOSED_LOOP])).get(CLOSED_LOOP)
        return value if isinstance(value, bool) else None

    async def set_closed_loop(self, closed: bool) -> None:
        """Turn the correction with measurements on or off; raises RefusedError."""
        await self.set_parameter(SHAPE_SEQUENCER, CLOSED_LOOP, closed)

    # Segments.

    async def set_stiff(self, segment: int | None, stiff: bool) -> None:
        """
        Evacuate or vent a segment (from 1), or all (None), until its pressure confirms it.

        A segment counts as soft up to the ``soft_vacuum`` of the shape_sequencer.
        """
        observed = self.observed
        await self._refuse_during_sequence()
        await self._check_segment(1 if segment is None else segment)
        numbers = list(range(1, observed.segments + 1)) if segment is None else [segment]
        limit, timeout = 0.0, SWITCHING_TIMEOUT
        if observed.running()[SHAPE_SEQUENCER]:
            values = await self.parameters(
                SHAPE_SEQUENCER, ['ambient_pressure', 'soft_vacuum', 'jamming_timeout'])
            limit = values['ambient_pressure'] - values['soft_vacuum']
            timeout = max(timeout, values['jamming_timeout'])
        name = 'set_all_stiff' if segment is None else f'segment_{segment}/set_stiff'
        answer = await self.call(SetBool, f'{JAMMING_VALVES}/{name}', data=stiff)
        if not answer.success:
            raise RefusedError(f'{JAMMING_VALVES}: {answer.message}')

        def missing() -> list[int]:
            return [n for n in numbers if observed.stiff(n) is not stiff
                    or not (stiff or (observed.pressure(n) or 0.0) > limit)]

        if not await until(lambda: not missing(), timeout):
            late = ', '.join(f'segment {n} ({observed.pressure(n) or float("nan"):.0f} Pa)'
                             for n in missing())
            raise NoAnswerError(f'not {"stiff" if stiff else "soft"} after {timeout:g} s: {late}; '
                                f'{self._jamming_faults()}')

    async def set_vacuum(self, segment: int, vacuum: float) -> None:
        """
        Set the vacuum of a segment (from 1), Pa below ambient; wait until it is reached.

        Raises RefusedError if the rig has valves, or the description has no law for it.
        """
        observed = self.observed
        await self._refuse_during_sequence()
        await self._check_segment(segment)
        values = await self.parameters(JAMMING_VALVES, ['ambient_pressure', 'vacuum_tolerance'])
        answer = await self.call(
            SetVacuum, f'{JAMMING_VALVES}/segment_{segment}/set_vacuum', vacuum=float(vacuum))
        if not answer.success:
            raise RefusedError(f'{JAMMING_VALVES}: {answer.message}')
        wanted = values['ambient_pressure'] - vacuum

        def followed() -> bool:
            pressure = observed.pressure(segment)
            return pressure is not None and abs(pressure - wanted) <= values['vacuum_tolerance']

        if not await until(followed, SWITCHING_TIMEOUT):
            raise NoAnswerError(
                f'segment {segment} has not followed its regulator to {vacuum / 1e3:g} kPa of '
                f'vacuum after {SWITCHING_TIMEOUT:g} s; {self._jamming_faults()}')

    async def _check_segment(self, segment: int) -> None:
        """Raise RefusedError unless there is such a segment, from 1."""
        observed = self.observed
        await self.found(lambda: observed.segments, f'{JAMMING_VALVES}/state', JAMMING_VALVES)
        if not 1 <= segment <= observed.segments:
            raise RefusedError(f'there is no segment {segment}; '
                               f'the segments are 1 to {observed.segments}')

    def _jamming_faults(self) -> str:
        """Return the faults that jamming_valves reports, as text."""
        state = self.observed.jamming_valves
        faults = '; '.join(filter(None, [state.fault, *state.segment_faults])) if state else ''
        return f'{JAMMING_VALVES} reports: {faults or "no fault"}'

    async def _refuse_during_sequence(self) -> None:
        """Refuse operations that would disturb a running sequence."""
        observed = self.observed
        await until(lambda: observed.shape_sequencer or not observed.running()[SHAPE_SEQUENCER],
                    self.discovery_timeout)
        progress = observed.progress()
        if progress is not None:
            raise RefusedError(f'a sequence is running ({progress.shape}: {progress.phase}); '
                               'cancel or stop it first')

    # Tendons.

    async def jog(self, changes: Mapping[str, float]) -> None:
        """
        Pull in tendons by the given lengths (m), negative: pay out; return when they rest.

        changes: by name of the tendon, such as 'right_tendon', or 'right' for short.

        A jog requested during another one starts at the end of that one. Raises RefusedError with
        the reason of tendon_actuation; MotionEndedError when it was accepted but ended early, also
        when a newer trajectory replaced it.
        """
        from trajectory_msgs.msg import JointTrajectoryPoint

        from soft_continuum.ros.motion_tracker import MotionTracker
        from soft_continuum.ros.ros_time import duration_to_ros
        from soft_continuum_interfaces.msg import MotionRequest
        observed = self.observed
        await self._refuse_during_sequence()
        await self.found(lambda: (state := observed.tendon_actuation) and (
            observed.pulls() or not state.referenced), 'tendon_states', TENDON_ACTUATION)
        names, pulls = observed.tendons, observed.pulls()
        if pulls is None:
            from soft_continuum.nodes.reported_arm import NOT_REFERENCED
            raise RefusedError(f'{TENDON_ACTUATION}: {NOT_REFERENCED}')
        now = dict(zip(names, pulls, strict=True))
        steps = {name if name in now else f'{name}_tendon': m for name, m in changes.items()}
        unknown = [name for name in changes if not {name, f'{name}_tendon'} & now.keys()]
        if unknown:
            raise RefusedError(f'there is no tendon {", ".join(unknown)}; '
                               f'the tendons are {", ".join(names)}')
        publisher = self._trajectories
        await self.found(publisher.get_subscription_count, 'a subscriber of its trajectories',
                         TENDON_ACTUATION)
        target = {name: pull + steps.get(name, 0.0)
                  for name, pull in (self._jog[1] or now).items()}
        duration = max(JOG_MINIMUM, *(abs(target[n] - now[n]) / JOG_SPEED for n in names))
        message = self._trajectory()
        message.trajectory.points.append(JointTrajectoryPoint(
            positions=[target[name] for name in names],
            time_from_start=duration_to_ros(duration)))
        motion = MotionTracker(message.id)

        def outcome() -> MotionRequest | None:
            state = observed.tendon_actuation
            request = None if state is None else motion.outcome(state)
            return request if request and request.status != MotionRequest.FOLLOWING else None

        self._jog = motion.id, target
        publisher.publish(message)
        request = await until(outcome, duration + self.timeout)
        if self._jog[0] == motion.id:
            self._jog = '', {}
        if request is None:
            raise NoAnswerError(f'the tendons did not arrive within {duration + self.timeout:g} s')
        if request.status == MotionRequest.ENDED:
            raise MotionEndedError(f'{TENDON_ACTUATION}: {request.message}', request.reason)
        if request.status == MotionRequest.REFUSED:
            raise RefusedError(f'{TENDON_ACTUATION}: {request.message}')
        # Its pulls arrive on another topic, maybe later.
        received = observed.message('tendon_states')
        await until(lambda: observed.message('tendon_states') is not received, self.timeout)

    async def hold(self) -> None:
        """Stop and hold the tendons: a trajectory without points."""
        self._trajectories.publish(self._trajectory())

    def _trajectory(self) -> 'TendonTrajectory':
        """Return a trajectory without points, with a unique identity."""
        from trajectory_msgs.msg import JointTrajectory

        from soft_continuum_interfaces.msg import TendonTrajectory
        return TendonTrajectory(
            id=f'{self.node.get_name()}/{next(self._numbers)}',
            trajectory=JointTrajectory(joint_names=list(self.observed.tendons)))

    @cached_property
    def _trajectories(self) -> Any:
        from soft_continuum.ros.qos import COMMAND
        from soft_continuum_interfaces.msg import TendonTrajectory
        return self.node.create_publisher(
            TendonTrajectory, f'{TENDON_ACTUATION}/tendon_trajectory', COMMAND)
