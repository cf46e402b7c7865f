# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Requests to the arm, as coroutines on the node that observes it."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import count
from math import inf
from typing import Any, TYPE_CHECKING
from uuid import uuid4

from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from soft_continuum.client.errors import (
    ClientError,
    LostError,
    MotionEndedError,
    NoAnswerError,
    NodesMissingError,
    RefusedError,
    SequenceError,
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
from soft_continuum.ros.ros_time import Age
from soft_continuum.sequencing import AIMS
from soft_continuum.text import printable
from soft_continuum.user_files import saved_shapes
from soft_continuum_interfaces.srv import SetVacuum

if TYPE_CHECKING:  # imports that stop does not need are local
    from soft_continuum.client.observed import ObservedArm
    from soft_continuum.client.sequence import Plan, RunningSequence, ShapeLike
    from soft_continuum.client.state import SequenceResult
    from soft_continuum.mechanics.arm import Arm
    from soft_continuum_interfaces.msg import TendonTrajectory

TARE = 'tare'
CLOSED_LOOP = 'closed_loop'  # parameter of shape_sequencer
JOG_SPEED = 0.01  # m/s
JOG_MINIMUM = 0.2  # s
SWITCHING_TIMEOUT = 15.0  # s for a segment to be evacuated or vented
SETTLING_TIMEOUT = 1.0  # s for topics that a running node may not publish
PLANNING_TIMEOUT = 30.0  # s for the shape_sequencer to plan before it answers
TIP_TIMEOUT = 130.0  # s more for each goal of the tip: more than reach.time_limit
LOST_TIMEOUT = 10.0  # s without messages from the shape_sequencer until a sequence counts as lost
ANSWER_PAUSE = 1.0
"""s to wait for a response once the state of the sequencer shows that it was sent."""
REASON_TIMEOUT = 1.0  # s between the answer to a goal and the reason of its rejection
PLAN_SHAPES = f'{SHAPE_SEQUENCER}/plan_shapes'


class Requests(Tasks):
    """
    Requests to the four nodes: sequences and manual operations.

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

    async def ask(self, service: str, kind: Any = Trigger, *, who: str = '', attempts: int = 1,
                  **request: Any) -> str:
        """
        Call a service with a success; return its message, or raise RefusedError with it.

        who: refuses, by default the service.
        """
        answer = await self.call(kind, service, attempts=attempts, **request)
        if not answer.success:
            raise RefusedError(f'{who or service}: {answer.message}')
        return printable(answer.message)

    async def stop(self) -> str:
        """Stop all motion, holding tension; nothing moves until ``resume``."""
        return await self.ask(f'{TENDON_ACTUATION}/stop', attempts=ATTEMPTS)

    async def resume(self) -> str:
        """Allow motion after a stop, from where the tendons are."""
        return await self.ask(f'{TENDON_ACTUATION}/resume')

    async def reference(self, sure: bool = False) -> str:
        """Set the present pulls as the zero of the straight arm; sure: as in ``_say``."""
        return await self._say(f'{TENDON_ACTUATION}/reference', sure)

    async def reset(self, sure: bool = False) -> str:
        """Reset kinematics to the straight arm; sure: as in ``_say``."""
        return await self._say(f'{KINEMATICS}/reset', sure)

    async def _say(self, service: str, sure: bool) -> str:
        """Call a service that refuses with a question; sure: confirm by calling it again."""
        try:
            return await self.ask(service)
        except RefusedError:
            if not sure:
                raise
        return await self.ask(service)

    async def record(self, begin: bool) -> str:
        """Start or end a recording of the recorder; return its message."""
        if self.observed.recorder is None:
            raise NodesMissingError('the recorder does not run; start it with: ros2 run '
                                    'soft_continuum recorder')
        return await self.ask(f'{RECORDER}/record', SetBool, who=RECORDER, data=begin)

    async def tare(self) -> dict[str, str]:
        """Call ~/tare of every node that has it; return the responses by node, as Arm.tare."""
        node = self.node
        space = f'{node.get_namespace().rstrip("/")}/'

        def nodes() -> list[str]:
            found = [name.removeprefix(space).split('/')
                     for name, _ in node.get_service_names_and_types() if name.startswith(space)]
            return sorted(parts[0] for parts in found if parts[1:] == [TARE])

        if not await until(nodes, self.discovery_timeout):
            raise NodesMissingError(f'no node that can be tared runs in namespace {space}: '
                                    'neither a camera nor disc_sensors')
        return {name: await self.ask(f'{name}/{TARE}') for name in nodes()}

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
        await self.ask(f'{JAMMING_VALVES}/{name}', SetBool, who=JAMMING_VALVES, data=stiff)

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
        await self.ask(f'{JAMMING_VALVES}/segment_{segment}/set_vacuum', SetVacuum,
                       who=JAMMING_VALVES, vacuum=float(vacuum))
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

        from soft_continuum.ros.motion_tracker import MotionTracker, NOT_REFERENCED
        from soft_continuum.ros.ros_time import duration_to_ros
        from soft_continuum_interfaces.msg import MotionRequest
        observed = self.observed
        await self._refuse_during_sequence()
        await self.found(lambda: (state := observed.tendon_actuation) and (
            observed.pulls() or not state.referenced), 'tendon_states', TENDON_ACTUATION)
        names, pulls = observed.tendons, observed.pulls()
        if pulls is None:
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
        from soft_continuum.ros.entries import COMMAND
        from soft_continuum_interfaces.msg import TendonTrajectory
        return self.node.create_publisher(
            TendonTrajectory, f'{TENDON_ACTUATION}/tendon_trajectory', COMMAND)

    # Sequences of shapes.

    async def plan(self, shapes: 'Sequence[ShapeLike]', time_limit: float = 0.0, states: int = 0
                   ) -> 'Plan':
        """
        Return the plan to set shapes from the present state; nothing moves.

        shapes: as for Arm.run.  time_limit: maximum duration of the search for each, s; 0: the
        parameter reach.time_limit.  states: number of states to evaluate in the search for a
        better plan for each; 0: as many as the action.  Raises ValueError for invalid arguments,
        NodesMissingError or NoAnswerError.
        """
        from soft_continuum.client.sequence import goal, plan_from_ros
        from soft_continuum_interfaces.srv import PlanShapes
        if not 0.0 <= time_limit < inf:
            raise ValueError(f'time_limit is {time_limit} s; allowed: 0 and more')
        if not 0 <= states < 2**32:
            raise ValueError(f'states is {states}; allowed: 0 to {2**32 - 1}')
        messages = goal(shapes, 0.0).shapes
        return plan_from_ros(await self.call(
            PlanShapes, PLAN_SHAPES, shapes=messages, time_limit=time_limit,
            states=states, within=PLANNING_TIMEOUT + TIP_TIMEOUT * len(messages)
            + 2.0 * time_limit * len(messages)))

    async def send(self, shapes: 'Sequence[ShapeLike]', hold: 'float | Sequence[float]',
                   aim: str = AIMS[0]) -> 'RunningSequence':
        """
        Set shapes in sequence, each held for ``hold`` s; return when accepted.

        shapes: names in the library or of saved shapes, or the bending of each segment, base
        first, as for Arm.run.  hold: may also be one for each shape.  aim: controlled quantity,
        'angles' or 'tip'. Raises RefusedError with the reason of the shape_sequencer; ValueError
        for an invalid hold time or aim.
        """
        from soft_continuum.client.sequence import goal, RunningSequence
        message = goal(shapes, hold, aim)
        if saved_shapes().exists():
            await self._look_up_saved(message)
        await self.found(self._action.server_is_ready, 'the action run_shape_sequence',
                         SHAPE_SEQUENCER)
        sequence = RunningSequence()
        handle = await self._handle(message, sequence.on_feedback)
        if not handle.accepted:
            observed = self.observed
            state = await until(lambda: (state := observed.shape_sequencer)
                                and state.rejected_goal_id == handle.goal_id and state,
                                REASON_TIMEOUT)
            raise RefusedError(f'{SHAPE_SEQUENCER}: '
                               f'{state.rejected if state else "the goal was rejected"}')
        sequence.begin(lambda: self.node.executor.create_task(handle.cancel_goal_async),
                       self.start(self._follow(handle)))
        return sequence

    async def _look_up_saved(self, goal: Any) -> None:
        """Replace names of saved shapes in a goal that are not in the library."""
        from soft_continuum.client.own_file import read_saved
        saved = read_saved()
        if any(shape.name in saved.names for shape in goal.shapes):
            library = await self.shapes(await self.description())
            goal.shapes = saved.replaced(goal.shapes, library)

    async def _handle(self, message: Any, on_feedback: Any) -> Any:
        """
        Send a goal; return its handle once it is accepted or rejected.

        If the response is lost, as on a busy machine, the state of the shape_sequencer shows the
        outcome.
        """
        from rclpy.action.client import ClientGoalHandle
        from unique_identifier_msgs.msg import UUID

        from soft_continuum_interfaces.action import RunShapeSequence
        goal_id, known, observed = UUID(uuid=list(uuid4().bytes)), Age(), self.observed
        accepted = False

        def reported() -> bool:
            nonlocal accepted
            state = observed.shape_sequencer
            if known.seconds == inf and state and goal_id in (state.goal_id,
                                                              state.rejected_goal_id):
                accepted = goal_id == state.goal_id
                known.refresh()
            return ANSWER_PAUSE <= known.seconds < inf

        answer = self._action.send_goal_async(message, on_feedback, goal_id)
        answer.add_done_callback(self.step)
        timeout = PLANNING_TIMEOUT + TIP_TIMEOUT * sum(
            bool(shape.tips) for shape in message.shapes)
        await until(lambda: answer.done() or reported(), timeout)
        if answer.done():
            return answer.result()
        if known.seconds < inf:
            return ClientGoalHandle(self._action, goal_id, (
                RunShapeSequence.Impl.SendGoalService.Response(accepted=accepted)))
        answer.add_done_callback(lambda late: late.result().cancel_goal_async())
        raise NoAnswerError(f'no answer from {SHAPE_SEQUENCER} within {timeout:g} s')

    async def _follow(self, handle: Any) -> 'SequenceResult':
        """Return the result of a sequence; raises SequenceError or LostError."""
        from soft_continuum.client.sequence import sequence_result
        result = sequence_result(await self._result(handle))
        if result.outcome != 'SUCCESSFUL':
            raise SequenceError(result)
        return result

    async def _result(self, handle: Any) -> Any:
        """
        Return the result of a goal; raises LostError.

        It arrives when the goal ends, unless it is lost, as on a busy machine: it is requested
        again when the goal has not run for 1 s, then 2 s and so on, ``ATTEMPTS * timeout`` s in
        all.
        """
        observed, accepted, runs, asked = self.observed, Age.now(), Age(), list[Any]()
        began = False

        def answers() -> list[Any]:
            return [one for one in asked if one.done()]

        def lost() -> bool:
            return min(accepted.seconds, observed.age(SHAPE_SEQUENCER)) >= LOST_TIMEOUT

        def late() -> bool:  # for ``pause`` s
            nonlocal began
            if (state := observed.shape_sequencer) is not None:
                began = began or state.goal_id == handle.goal_id
                if state.running and (state.goal_id == handle.goal_id or not began):
                    runs.refresh()  # running, or waiting for the previous one to end
            return runs.seconds >= pause

        pause, patience = ANSWER_PAUSE, ATTEMPTS * self.timeout
        while patience > 0.0:
            asked.append(handle.get_result_async())
            asked[-1].add_done_callback(self.step)
            runs.refresh()
            await until(lambda: answers() or lost() or late(), inf)
            if found := answers():
                return found[0].result().result
            if lost():
                raise LostError(
                    f'nothing received from {SHAPE_SEQUENCER} for {LOST_TIMEOUT:g} s; a segment '
                    'of the arm may still be soft: check its state, restart the nodes, stiffen '
                    'all segments')
            patience, pause = patience - pause, min(2.0 * pause, self.timeout)
        raise LostError(f'{SHAPE_SEQUENCER} no longer runs the sequence, but has not reported its '
                        f'result within {ATTEMPTS * self.timeout:g} s; see its state')

    async def cancel_all(self) -> None:
        """Cancel every sequence of any client."""
        from action_msgs.srv import CancelGoal
        await self.call(
            CancelGoal, 'run_shape_sequence/_action/cancel_goal', attempts=ATTEMPTS)

    @cached_property
    def _action(self) -> Any:
        from rclpy.action import ActionClient

        from soft_continuum_interfaces.action import RunShapeSequence
        self.observed  # noqa: B018  (this subscribes to the sequencer)
        return ActionClient(self.node, RunShapeSequence, 'run_shape_sequence')

    def destroy(self) -> None:
        """
        Destroy the action client: before its node, and after its executor was shut down.

        A spinning events executor crashes the process at a message for a destroyed action client
        or server (rclpy 7.1 does not hold the GIL there).
        """
        if '_action' in self.__dict__:
            self._action.destroy()
