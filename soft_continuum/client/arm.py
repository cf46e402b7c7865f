# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The arm, as a client sees it."""

from collections.abc import Callable, Coroutine, Iterable, Mapping, Sequence
from contextlib import suppress
from html import escape
from io import StringIO
from itertools import count
from math import isfinite
import os
from typing import Any, TYPE_CHECKING, TypeVar

from soft_continuum.client.connection import Connection
from soft_continuum.client.errors import ClientError, NoAnswerError
from soft_continuum.client.tasks import until
from soft_continuum.ros.graph import running_nodes
from soft_continuum.ros.names import SHAPE_SEQUENCER, TWIN
from soft_continuum.sequencing.progress import AIMS

if TYPE_CHECKING:  # stop must not wait for any of these
    from matplotlib.axes import Axes

    from soft_continuum.client.measured import MeasuredArm, MeasuredDisc
    from soft_continuum.client.observed import ObservedArm
    from soft_continuum.client.obstacles import ArmObstacles
    from soft_continuum.client.plan import Plan
    from soft_continuum.client.sequence import RunningSequence, ShapeLike
    from soft_continuum.client.state import ArmState, Progress, SequenceResult
    from soft_continuum.client.tip import Tip
    from soft_continuum.mechanics import arm as mechanics

T = TypeVar('T')

ENDING_TIMEOUT = 15.0  # s for a sequence to end when the client leaves
_numbers = count(1)


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
        self._namespace = namespace
        self._connection = Connection(
            f'client_{os.getpid()}_{next(_numbers)}', namespace, timeout)
        self._requests = self._connection.requests
        self._observed: ObservedArm | None = None
        self._sequences: list[RunningSequence] = []
        self._description: mechanics.Arm | None = None
        self._measured: MeasuredArm | None = None
        self._obstacles: ArmObstacles | None = None

    def __enter__(self) -> 'Arm':
        """Return this arm."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close."""
        self.close()

    def close(self) -> None:
        """Cancel the sequences that this client started, wait for their end, disconnect."""
        for sequence in self._sequences:
            self._end(sequence)
        self._sequences = []
        self._connection.close()

    def __repr__(self) -> str:
        """Return how it was made."""
        return f'Arm({self._namespace!r})'

    def _repr_html_(self) -> str:
        """Return what a notebook shows: shape and state, or why they are not known."""
        try:
            page = self.state._repr_html_()
        except ClientError as error:
            return f'<pre>{escape(f"{self!r}: {error}")}</pre>'
        with suppress(ClientError):  # the state says why the shape is not known
            from matplotlib.figure import Figure
            picture = StringIO()
            figure = Figure(figsize=(4.0, 4.0))
            self.plot(figure.subplots())
            figure.savefig(picture, format='svg')
            page = picture.getvalue() + page
        return page

    def _do(self, work: Coroutine[Any, None, T]) -> T:
        return self._requests.start(work).result()

    @staticmethod
    def _end(sequence: 'RunningSequence') -> None:
        """Cancel a sequence and wait for its end, however it ends."""
        if not sequence.done:
            sequence.cancel()
            with suppress(ClientError):
                sequence.result(ENDING_TIMEOUT)

    # What is known of it.

    @property
    def state(self) -> 'ArmState':
        """What is known now; raises NodesMissingError when none of the nodes runs."""
        return self._observe().snapshot()

    def wait_for(self, condition: 'Callable[[ArmState], T]', timeout: float | None = None) -> T:
        """
        Wait until ``condition`` of the state is true, and return what it gives.

        Raises NoAnswerError after ``timeout`` s, by default that of this Arm.
        """
        observed = self._observe()
        seconds = self._connection.requests.timeout if timeout is None else timeout
        value = self._do(until(lambda: condition(observed.snapshot()), seconds))
        if not value:
            raise NoAnswerError(
                f'not so within {seconds:g} s; the arm is: {observed.snapshot()!r}')
        return value

    def _observe(self) -> 'ObservedArm':
        """Return the observed arm; the first time as soon as its nodes have reported."""
        if self._observed is None:
            self._observed = self._do(self._requests.observe())
        return self._observed

    @property
    def shapes(self) -> Mapping[str, tuple[float, ...]]:
        """The shape library: bending angles (rad) of each segment by name."""
        return self._do(self._requests.shapes(self.description))

    @property
    def shape_directions(self) -> Mapping[str, tuple[float, ...]]:
        """Directions (rad) of each segment by name, of the shapes in the library that have any."""
        return self._do(self._requests.shape_directions())

    @property
    def description(self) -> 'mechanics.Arm':
        """The mechanical description that the kinematics node works with, planar or spatial."""
        if self._description is None:
            self._description = self._do(self._requests.description())
        return self._description

    @property
    def has_jamming(self) -> bool:
        """Whether segments can be stiffened; without jamming they are always soft."""
        return self._do(self._requests.has_jamming())

    def plot(self, axes: 'Axes | None' = None) -> 'Axes':
        """
        Draw the present shape, in mm, into ``axes`` or a new figure; return the axes.

        Soft segments are in colour; the obstacles that shape_sequencer knows are seen along y.  A
        spatial arm needs axes that were made with ``projection='3d'``.

        Raises ClientError while the shape is unknown, and for axes of the wrong kind.
        """
        from soft_continuum.client.plot import plot
        description, observed = self.description, self._observe()
        if observed.snapshot().joint_angles is None:
            raise ClientError('kinematics publishes no shape; it reports: '
                              + (self.state.node('kinematics').message or 'nothing'))
        return plot(observed, description, axes, self.obstacles.known if running_nodes(
            self._connection.node, [SHAPE_SEQUENCER])[SHAPE_SEQUENCER] else ())

    def measure(self, duration: float = 1.0) -> 'dict[int, MeasuredDisc]':
        """
        Return where sensors see the discs, by number from the base disc, 0.

        Means over ``duration`` s.  Raises ClientError when no disc is measured.
        """
        return self._do(self._measure(duration))

    async def _measure(self, duration: float) -> 'dict[int, MeasuredDisc]':
        from soft_continuum.client.measured import MeasuredArm
        observed = await self._requests.observe()
        if self._measured is None:
            description = await self._requests.description()
            self._measured = MeasuredArm(
                observed, self._connection.node.get_clock(), description.pose_axes)
        return await self._measured.measure(duration)

    @property
    def obstacles(self) -> 'ArmObstacles':
        """What is around the arm: ``arm.obstacles.load('obstacles.yaml')``."""
        if self._obstacles is None:
            from soft_continuum.client.obstacles import ArmObstacles
            self._obstacles = ArmObstacles(self._requests)
        return self._obstacles

    @property
    def is_simulated(self) -> bool:
        """Whether a twin publishes beside the nodes."""
        return running_nodes(self._connection.node, [TWIN])[TWIN]

    # Sequences of shapes.

    def run(self, *shapes: 'ShapeLike', hold: float = 0.0, aim: str = AIMS[0],
            progress: 'Callable[[Progress], object] | None' = None) -> 'SequenceResult':
        """
        Set one shape after the other, hold each for ``hold`` s; return when all is done.

        shapes: names in the library; what each segment bends by, base first: its bending angle
        or, of a spatial arm, (angle, direction), rad; a Tip; or several as a path.
        aim: what is to be right in the end where measurements close the loop: 'angles' of every
        segment, or the position of the 'tip', at other angles if need be.
        progress: called whenever it has changed.
        The ``reached`` of the result says where the last shape ended, measured or predicted.

        Raises RefusedError before anything moves, SequenceError when it ends early, LostError
        when the shape_sequencer reports nothing any more.  When the wait is left by an exception,
        such as KeyboardInterrupt, the sequence is canceled.
        """
        sequence = self.start(*shapes, hold=hold, aim=aim)
        try:
            for now in sequence.updates():
                if progress is not None:
                    progress(now)
            return sequence.result()
        except BaseException:
            self._end(sequence)
            raise

    def reach(self, *position: float, angle: float | None = None,
              direction: tuple[float, float, float] | None = None, tolerance: float = 0.0,
              angle_tolerance: float = 0.0, hold: float = 0.0,
              progress: 'Callable[[Progress], object] | None' = None) -> 'SequenceResult':
        """
        Bring the tip to a position; return when it is there.

        position: x, z in the plane of a planar arm, or x, y, z, m.  angle: of the tip about +y
        from +z, rad.  direction: in which it points, x, y, z.  tolerance, angle_tolerance: m, rad;
        0: those of the shape_sequencer.  The others, and what is raised, are as of ``run``.
        """
        from soft_continuum.client.tip import Tip
        return self.run(Tip(position, angle, direction, None, tolerance, angle_tolerance),
                        hold=hold, progress=progress)

    def follow(self, points: 'Iterable[Tip | Sequence[float]]', *, tolerance: float = 0.0,
               hold: float = 0.0, progress: 'Callable[[Progress], object] | None' = None
               ) -> 'SequenceResult':
        """
        Bring the tip through points in their order, as near as it can be; as ``reach``.

        points: positions, m, or Tips.  tolerance: m, of the positions.
        """
        from soft_continuum.client.tip import Tip
        return self.run([point if isinstance(point, Tip) else Tip(
            tuple(point), tolerance=tolerance) for point in points], hold=hold, progress=progress)

    def plan(self, *shapes: 'ShapeLike', time_limit: float = 0.0, states: int = 0) -> 'Plan':
        """
        Return how ``run`` would set shapes from where the arm is; nothing moves.

        ``run`` of the same shapes takes this plan, as long as all is as it was.  states: of the
        arm to judge in search of a better plan to each goal of the tip; 0: as many as ``run``
        would.  time_limit: s after which that search ends at the latest; 0: as the parameter
        reach.time_limit says.  The Plan says whether all can be set, and why not.
        """
        from soft_continuum.client.plan import plan_shapes
        return self._do(plan_shapes(self._requests, shapes, time_limit, states))

    def start(self, *shapes: 'ShapeLike', hold: float = 0.0, aim: str = AIMS[0]
              ) -> 'RunningSequence':
        """
        Send a sequence as ``run`` does; return as soon as it is accepted.

        Left by Ctrl-C while it is planned, it is canceled as soon as it is accepted.
        """
        sending = self._requests.start(self._requests.send(shapes, hold, aim))
        try:
            sequence = sending.result()
        except BaseException:
            if sending.exception() is None:  # which waits: else it would move with nobody there
                self._end(sending.result())
            raise
        self._sequences = [s for s in self._sequences if not s.done] + [sequence]
        return sequence

    @property
    def closed_loop(self) -> bool | None:
        """
        Whether sequences are corrected by measurements; None where shape_sequencer cannot.

        It can be set; raises RefusedError where shape_sequencer has no such parameter.
        """
        return self._do(self._requests.closed_loop())

    @closed_loop.setter
    def closed_loop(self, closed: bool) -> None:
        self._do(self._requests.set_closed_loop(closed))

    # Segments.

    def stiffen(self, segment: int | None = None) -> None:
        """Evacuate a segment (from 1 at the base), or all; wait until it is confirmed stiff."""
        self._observe()
        self._do(self._requests.set_stiff(segment, True))

    def soften(self, segment: int) -> None:
        """Vent a segment (from 1 at the base); wait until it is soft enough to be bent."""
        self._observe()
        self._do(self._requests.set_stiff(segment, False))

    def set_vacuum(self, segment: int, vacuum: float) -> None:
        """
        Set the vacuum of a segment (from 1 at the base), Pa below ambient; wait until it has it.

        Raises RefusedError, with the reason, where the rig has valves in place of regulators, or
        the description no law for it.
        """
        self._observe()
        self._do(self._requests.set_vacuum(segment, vacuum))

    # Tendons.

    def jog(self, **changes: float) -> None:
        """
        Pull tendons by so many m further, negative: pay out; wait until they rest there.

        changes: by name of the tendon, such as ``right=0.001``, short for ``right_tendon``.
        A segment has to be soft.  Raises RefusedError, with the reason, when tendon_actuation
        refuses it or ends it early.
        """
        for name, change in changes.items():
            if not isfinite(change):
                raise ValueError(f'{name} is {change}; give a finite number, m')
        self._observe()
        try:
            self._do(self._requests.jog(changes))
        except ClientError:
            raise
        except BaseException:
            self._do(self._requests.hold())
            raise

    def home(self) -> str:
        """
        Straighten the arm from whatever shape it was left in; return how straight it is.

        As a sequence, if the model finds a plan; else with all segments soft at once: the arm may
        swing then, so that is refused where an obstacle is known.  Raises as ``run``, ``soften``
        and ``jog``.
        """
        from soft_continuum.client.home import home
        return home(self)

    def stop(self) -> str:
        """Stop all motion, holding tension; nothing moves before ``resume``."""
        return self._do(self._requests.stop())

    def resume(self) -> str:
        """Allow motion after a stop, from where the tendons are."""
        return self._do(self._requests.resume())

    def reference(self, sure: bool = False) -> str:
        """
        Take the present pulls as those of the straight arm.

        Raises RefusedError with a question if the arm was last known not to be straight; calling
        it again within 30 s, or ``sure``, is the answer.
        """
        return self._do(self._requests.reference(sure))

    def reset(self, sure: bool = False) -> str:
        """Tell kinematics that the arm is straight; asks as ``reference`` does."""
        return self._do(self._requests.reset(sure))

    def tare(self) -> dict[str, str]:
        """
        Take what every camera, and disc_sensors, sees as the straight arm; all must succeed.

        Return the answer of each node, by its name, with the lines that keep it over a restart.
        Raises RefusedError with the reason of the one that refuses, NodesMissingError without
        any.
        """
        from soft_continuum.client.tare import tare
        return self._do(tare(self._requests))
