# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The arm, as a client sees it."""

from collections.abc import Callable, Mapping, Sequence
from math import isfinite
from time import monotonic
from typing import Any, TYPE_CHECKING

from std_srvs.srv import SetBool, Trigger

from soft_continuum.client.connection import Connection
from soft_continuum.client.errors import ClientError, NoAnswerError, RefusedError

if TYPE_CHECKING:  # stop() must not wait for any of these
    from matplotlib.axes import Axes

    from soft_continuum.client.monitor import Monitor, Said
    from soft_continuum.client.sequence import Progress, RunningSequence
    from soft_continuum.client.state import ArmState, SequenceResult
    from soft_continuum.mechanics.arm import Arm as Description

JOG_SPEED = 0.005  # m/s
JOG_MINIMUM = 0.2  # s
THERE = 2e-5  # m from its target at which a jog has arrived
PLANNING = 30.0  # s that the shape_sequencer may take to plan before it answers
ENDING = 15.0  # s for a sequence to end when the client leaves
SWITCHING = 15.0  # s for a segment to be evacuated or vented


class Arm:
    """
    A running arm: ``with Arm() as arm: arm.run('c_form')``.

    Every call blocks until what it asks for is done, or raises a ClientError that says why it is
    not.  Leaving the ``with`` block cancels the sequences that were started in it.  May be used
    from several threads; a callback of ``run`` comes in the thread that called.
    """

    def __init__(self, namespace: str = '', *, timeout: float = 10.0) -> None:
        """
        Join the ROS graph; nothing is asked of the arm yet.

        namespace: that of the four nodes.  timeout: s to wait for nodes to be found and to answer.
        Raises ClientError for a namespace that ROS does not take.
        """
        if not timeout > 0.0:
            raise ValueError(f'timeout is {timeout} s; it must be positive')
        self._connection = Connection(namespace, timeout)
        self._known: Monitor | None = None
        self._action: Any = None
        self._jog_topic: Any = None
        self._sequences: list[RunningSequence] = []
        self._description: Description | None = None

    def __enter__(self) -> 'Arm':
        """Return this arm."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close."""
        self.close()

    def close(self) -> None:
        """Cancel the sequences that this client started, wait for their end, disconnect."""
        for sequence in self._sequences:
            if not sequence.done and sequence.accepted is not False:
                sequence.cancel()
                self._connection.wait_for(lambda s=sequence: s.done, ENDING)  # type: ignore[misc]
        self._sequences = []
        self._connection.close(lambda: self._action.destroy() if self._action else None)

    # What is known of it.

    @property
    def _monitor(self) -> 'Monitor':
        if self._known is None:
            from soft_continuum.client.monitor import Monitor
            self._known = Monitor(self._connection)
        return self._known

    @property
    def state(self) -> 'ArmState':
        """What is known now; raises NodesMissingError when none of the nodes runs."""
        return self._monitor.snapshot()

    @property
    def shapes(self) -> Mapping[str, tuple[float, ...]]:
        """The shape library: bending angles (rad) of each segment by name."""
        from soft_continuum.parameters.parameter import ParameterError
        from soft_continuum.parameters.shapes import SHAPE_PREFIX, shapes_from_parameters
        node = 'shape_sequencer'
        names = self._connection.parameters(node, ['shape_names'])['shape_names']
        angles = self._connection.parameters(node, [SHAPE_PREFIX + name for name in names])
        try:
            return shapes_from_parameters(
                {'shape_names': tuple(names), **angles}, self.description)
        except ParameterError as error:
            raise ClientError(f'{node}: {error}') from None

    @property
    def description(self) -> 'Description':
        """The mechanical description that the kinematics node works with."""
        if self._description is None:
            from soft_continuum.parameters.arm import arm_from_parameters, ARM_PARAMETERS
            self._description = arm_from_parameters(self._connection.parameters(
                'kinematics', [p.name for p in ARM_PARAMETERS]))
        return self._description

    def plot(self, axes: 'Axes | None' = None) -> 'Axes':
        """
        Draw the present shape, in mm, into ``axes`` or a new figure; return the axes.

        Soft segments are in colour.

        Raises ClientError while the shape is unknown.
        """
        from matplotlib import pyplot
        import numpy as np

        from soft_continuum.analysis.figures import draw_arm
        from soft_continuum.mechanics.chain import RigidChain
        chain, state = RigidChain(self.description), self.state
        if state.joint_angles is None:
            raise ClientError('kinematics publishes no shape; it says: '
                              + (state.node('kinematics').message or 'nothing'))
        axes = pyplot.subplots()[1] if axes is None else axes
        soft = [i for i, stiff in enumerate(state.stiff) if stiff is False]
        draw_arm(axes, chain, np.array(state.joint_angles), soft)
        axes.set_ylabel('z in mm')
        return axes

    # Sequences of shapes.

    def run(self, *shapes: str | Sequence[float], hold: float = 0.0,
            progress: 'Callable[[Progress], object] | None' = None) -> 'SequenceResult':
        """
        Set one shape after the other, hold each for ``hold`` s; return when all is done.

        shapes: names in the library, or bending angles (rad) of each segment, base first.
        progress: called whenever there is any.

        Raises RefusedError before anything moves, SequenceError when it ends early, LostError
        when the shape_sequencer falls silent.  When the wait is left by an exception, such as
        KeyboardInterrupt, the sequence is canceled.
        """
        sequence = self.start(*shapes, hold=hold)
        try:
            for now in sequence.updates():
                if progress is not None:
                    progress(now)
            return sequence.result()
        except BaseException:
            sequence.cancel()
            self._connection.wait_for(lambda: sequence.done, ENDING)
            raise

    def start(self, *shapes: str | Sequence[float], hold: float = 0.0) -> 'RunningSequence':
        """Send a sequence as ``run`` does; return as soon as it is accepted."""
        from rclpy.action import ActionClient

        from soft_continuum.client.goals import goal
        from soft_continuum.client.sequence import RunningSequence
        from soft_continuum_interfaces.action import RunShapeSequence
        message = goal(shapes, hold)
        monitor, connection, node = self._monitor, self._connection, 'shape_sequencer'
        if self._action is None:
            self._action = connection.do(lambda: ActionClient(
                connection.node, RunShapeSequence, 'run_shape_sequence'))
        if not connection.wait_for(self._action.server_is_ready, connection.timeout):
            raise connection.not_found('the action run_shape_sequence', [node])
        self._said_by_sequencer()
        before = monitor.said_count[node]
        sequence = RunningSequence(connection, lambda: monitor.age(node))
        self._sequences = [s for s in self._sequences if not s.done] + [sequence]
        connection.do(lambda: sequence.send(self._action, message))
        connection.wait_for(lambda: sequence.accepted is not None, PLANNING)
        if sequence.accepted is None:
            sequence.cancel()
            raise NoAnswerError(f'no answer of shape_sequencer within {PLANNING:g} s')
        if not sequence.accepted:
            self._sequences.remove(sequence)
            # A reason that is the same as last time is not said again.
            connection.wait_for(lambda: monitor.said_since(node, before), 1.0)
            reason = monitor.last_said(node).values.get('rejected', '')
            raise RefusedError(f'shape_sequencer: {reason or "the goal was rejected"}')
        return sequence

    # Segments.

    def stiffen(self, segment: int | None = None) -> None:
        """Evacuate a segment (from 1 at the base), or all; wait until it is confirmed stiff."""
        self._switch(segment, True)

    def soften(self, segment: int) -> None:
        """Vent a segment (from 1 at the base); wait until it is soft enough to be bent."""
        self._switch(segment, False)

    def _switch(self, segment: int | None, stiff: bool) -> None:
        monitor = self._monitor
        if segment is not None and segment not in range(1, monitor.segments + 1):
            raise RefusedError(f'there is no segment {segment}; '
                               f'the segments are 1 to {monitor.segments}')
        self._refuse_during_sequence()
        limit = None
        if not stiff:
            values = self._connection.parameters(
                'shape_sequencer', ['ambient_pressure', 'soft_vacuum'])
            limit = values['ambient_pressure'] - values['soft_vacuum']
        name = 'set_all_stiff' if segment is None else f'segment_{segment}/set_stiff'
        answer = self._connection.call(SetBool, f'jamming_valves/{name}', data=stiff)
        if not answer.success:
            raise RefusedError(f'jamming_valves: {answer.message}')
        waiting = [segment] if segment else list(range(1, monitor.segments + 1))

        def done(number: int) -> bool:
            pressure = monitor.pressure(number)
            return monitor.stiff(number) is stiff and (
                limit is None or (pressure is not None and pressure > limit))

        if not self._connection.wait_for(lambda: all(done(n) for n in waiting), SWITCHING):
            late = ', '.join(f'segment {n} ({monitor.pressure(n) or float("nan"):.0f} Pa)'
                             for n in waiting if not done(n))
            raise NoAnswerError(
                f'not {"stiff" if stiff else "soft"} after {SWITCHING:g} s: {late}; '
                f'jamming_valves says: {monitor.last_said("jamming_valves").message or "nothing"}')

    def _said_by_sequencer(self) -> 'Said':
        """Return its latest status; if it runs, wait for the first."""
        monitor, connection, node = self._monitor, self._connection, 'shape_sequencer'
        connection.wait_for(lambda: monitor.said_count[node] or not connection.running()[node],
                            connection.timeout)
        return monitor.last_said(node)

    def _refuse_during_sequence(self) -> None:
        said = self._said_by_sequencer()
        if said.values.get('phase'):
            raise RefusedError(f'a sequence is running ({said.message}); cancel or stop it first')

    # Tendons.

    def jog(self, right: float = 0.0, left: float = 0.0) -> None:
        """
        Pull the tendons by this much further (m, negative: let out); wait until they are there.

        A segment has to be soft.  Raises RefusedError, with the reason, when tendon_actuation
        does not take it or ends it early.
        """
        if not (isfinite(right) and isfinite(left)):
            raise ValueError(f'right is {right}, left is {left}; give finite numbers, m')
        from soft_continuum.client.goals import jog_trajectory
        monitor, connection, node = self._monitor, self._connection, 'tendon_actuation'
        self._refuse_during_sequence()
        now = connection.wait_for(monitor.pulls, connection.timeout)
        if now is None:
            raise connection.not_found('tendon_states', [node])
        target = now[0] + right, now[1] + left
        duration = max(JOG_MINIMUM, abs(right) / JOG_SPEED, abs(left) / JOG_SPEED)
        publisher = self._jog_publisher()
        before = monitor.said_count[node]
        message = jog_trajectory(target, duration, connection.node.get_clock().now().to_msg())
        stamp = f'{message.header.stamp.sec}.{message.header.stamp.nanosec:09d}'

        def trouble() -> str:
            said = monitor.said_since(node, before)
            last = said[-1].values if said else {}
            if last.get('refused_stamp') == stamp:
                return last.get('refused', '')
            if last.get('stopped'):
                return f'stopped: {last["stopped"]}'
            taken = any(not s.values.get('ended') for s in said)
            return last.get('ended', '') if taken else ''

        def there() -> bool:
            pulls, speeds = monitor.pulls(), monitor.speeds()
            # Even if it is there already: by then tendon_actuation has said whether it was taken.
            return monotonic() > ended and pulls is not None and speeds is not None and (
                not any(speeds)) and all(
                    abs(p - t) < THERE for p, t in zip(pulls, target, strict=True))

        ended = monotonic() + duration
        connection.do(lambda: publisher.publish(message))
        try:
            arrived = connection.wait_for(lambda: trouble() or there(),
                                          duration + connection.timeout)
        except BaseException:
            connection.do(lambda: publisher.publish(jog_trajectory(None, 0.0, None)))
            raise
        if trouble():
            raise RefusedError(f'tendon_actuation: {trouble()}')
        if not arrived:
            raise NoAnswerError(f'the tendons did not arrive within '
                                f'{duration + connection.timeout:g} s')

    def _jog_publisher(self) -> Any:
        from trajectory_msgs.msg import JointTrajectory
        connection, topic = self._connection, 'tendon_actuation/joint_trajectory'
        if self._jog_topic is None:
            self._jog_topic = connection.do(
                lambda: connection.node.create_publisher(JointTrajectory, topic, 5))
        if not connection.wait_for(self._jog_topic.get_subscription_count, connection.timeout):
            raise connection.not_found(f'a subscriber of {topic}', ['tendon_actuation'])
        return self._jog_topic

    def stop(self) -> str:
        """Stop all motion, holding tension; nothing moves before ``resume``."""
        return self._trigger('tendon_actuation/stop')

    def resume(self) -> str:
        """Allow motion after a stop, from where the tendons are."""
        return self._trigger('tendon_actuation/resume')

    def reference(self) -> str:
        """Take the present pulls as those of the straight arm."""
        return self._trigger('tendon_actuation/reference')

    def reset(self) -> str:
        """Tell kinematics that the arm is straight."""
        return self._trigger('kinematics/reset')

    def _trigger(self, name: str) -> str:
        answer = self._connection.call(Trigger, name)
        if not answer.success:
            raise RefusedError(f'{name}: {answer.message}')
        return str(answer.message)
