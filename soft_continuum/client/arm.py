# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The arm for clients, and its way home from any shape."""

from collections.abc import Callable, Coroutine, Iterable, Mapping, Sequence
from contextlib import suppress
from html import escape
from io import StringIO
from itertools import count
from math import degrees, inf, isfinite
import os
from typing import Any, TYPE_CHECKING, TypeVar

from soft_continuum.client.connection import Connection
from soft_continuum.client.errors import (
    ClientError,
    NoAnswerError,
    RefusedError,
    SequenceError,
)
from soft_continuum.client.tasks import until
from soft_continuum.ros.names import running_nodes, SHAPE_SEQUENCER, TWIN
from soft_continuum.sequencing import AIMS, Code

if TYPE_CHECKING:  # stop must not wait for any of these
    from matplotlib.axes import Axes

    from soft_continuum.client.measured import MeasuredArm, MeasuredDisc
    from soft_continuum.client.observed import ObservedArm
    from soft_continuum.client.obstacles import ArmObstacles
    from soft_continuum.client.sequence import Plan, RunningSequence, ShapeLike
    from soft_continuum.client.state import ArmState, Progress, SequenceResult
    from soft_continuum.client.tip import Tip
    from soft_continuum.mechanics import arm as mechanics

T = TypeVar('T')

ENDING_TIMEOUT = 15.0  # s for a sequence to end when the client closes
STRAIGHT = 2.0  # degrees that a segment may remain bent after ``home``
SETTLING = 3.0  # s for the model to follow
_numbers = count(1)


class Arm:
    """
    A running arm: ``with Arm() as arm: arm.run('c_form')``.

    Every call blocks until it is done, or raises a ClientError with the reason.  Leaving the
    ``with`` block cancels the sequences started in it.  Calls are thread-safe; callbacks of
    ``run`` are called in the thread of the caller.
    """

    def __init__(self, namespace: str = '', *, timeout: float = 10.0) -> None:
        """
        Join the ROS graph; nothing is requested from the arm yet.

        namespace: that of the four nodes.  timeout: s to wait for nodes to be found and to answer.
        Raises ClientError for a namespace that is not valid in ROS.
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
        """Return the constructor call."""
        return f'Arm({self._namespace!r})'

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: shape and state, or why they are unknown."""
        try:
            page = self.state._repr_html_()
        except ClientError as error:
            return f'<pre>{escape(f"{self!r}: {error}")}</pre>'
        with suppress(ClientError):  # the state says why the shape is unknown
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
        """Cancel a sequence and wait for its end."""
        if not sequence.done:
            sequence.cancel()
            with suppress(ClientError):
                sequence.result(ENDING_TIMEOUT)

    # State.

    @property
    def state(self) -> 'ArmState':
        """The present state; raises NodesMissingError when none of the nodes runs."""
        return self._observe().snapshot()

    def wait_for(self, condition: 'Callable[[ArmState], T]', timeout: float | None = None) -> T:
        """
        Wait until ``condition`` of the state is true, and return its value.

        Raises NoAnswerError after ``timeout`` s, by default that of this Arm.
        """
        observed = self._observe()
        seconds = self._connection.requests.timeout if timeout is None else timeout
        value = self._do(until(lambda: condition(observed.snapshot()), seconds))
        if not value:
            raise NoAnswerError(
                f'condition not met within {seconds:g} s; the arm is: {observed.snapshot()!r}')
        return value

    def _observe(self) -> 'ObservedArm':
        """Return the observed arm; the first call waits until its nodes have reported."""
        if self._observed is None:
            self._observed = self._do(self._requests.observe())
        return self._observed

    @property
    def shapes(self) -> Mapping[str, tuple[float, ...]]:
        """The shape library: bending angles (rad) of each segment by name."""
        return self._do(self._requests.shapes(self.description))

    @property
    def shape_directions(self) -> Mapping[str, tuple[float, ...]]:
        """Bending directions (rad) of each segment by name, for shapes in the library with any."""
        return self._do(self._requests.shape_directions())

    @property
    def description(self) -> 'mechanics.Arm':
        """The mechanical description used by the kinematics node, planar or spatial."""
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

        Soft segments are in colour; known obstacles are drawn as seen along y.  A spatial arm
        needs axes made with ``projection='3d'``.

        Raises ClientError while the shape is unknown, and for axes of the wrong kind.
        """
        from matplotlib import pyplot

        from soft_continuum.client.observed import KINEMATICS_STATE
        from soft_continuum.mechanics.chain import Chain
        from soft_continuum.mechanics.drawing import draw_arm, projection_of
        from soft_continuum.planning.obstacles.drawing import draw_obstacles
        from soft_continuum.ros.conversions import equilibrium_from_ros
        description, observed = self.description, self._observe()
        if observed.snapshot().joint_angles is None:
            raise ClientError('kinematics publishes no shape; it reports: '
                              + (self.state.node('kinematics').message or 'nothing'))
        message = observed.message(KINEMATICS_STATE)
        state = None if message is None else equilibrium_from_ros(message, Chain(description))
        if state is None:
            raise ClientError('kinematics publishes no shape of the arm that it describes; was it '
                              'restarted?')
        projection = projection_of(description)
        if axes is None:
            axes = pyplot.figure().add_subplot(projection=projection)
        if projection and axes.name != projection:
            raise ClientError(f'a spatial arm needs axes with projection={projection!r}, or leave '
                              'them out')
        draw_arm(axes, state)
        if running_nodes(self._connection.node, [SHAPE_SEQUENCER])[SHAPE_SEQUENCER]:
            draw_obstacles(axes, self.obstacles.known, description.length)
        if not projection:
            axes.set_ylabel('z in mm')
        return axes

    def measure(self, duration: float = 1.0) -> 'dict[int, MeasuredDisc]':
        """
        Return the measured poses of the discs, by number from the base disc, 0.

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
        """The obstacles around the arm: ``arm.obstacles.load('obstacles.yaml')``."""
        if self._obstacles is None:
            from soft_continuum.client.obstacles import ArmObstacles
            self._obstacles = ArmObstacles(self._requests)
        return self._obstacles

    @property
    def is_simulated(self) -> bool:
        """Whether a twin simulates the rig."""
        return running_nodes(self._connection.node, [TWIN])[TWIN]

    # Sequences of shapes.

    def run(self, *shapes: 'ShapeLike', hold: float = 0.0, aim: str = AIMS[0],
            progress: 'Callable[[Progress], object] | None' = None) -> 'SequenceResult':
        """
        Set shapes in sequence, hold each for ``hold`` s; return when all are done.

        shapes: names in the library; the bending of each segment, base first: its bending angle
        or, for spatial arms, (angle, direction), rad; a Tip; or several as a path.  aim:
        controlled quantity in closed loop: 'angles' of every segment, or the position of the
        'tip', possibly at other angles.  progress: called at every change.  ``reached`` of the
        result has the end of the last shape, measured or predicted.

        Raises RefusedError before anything moves, SequenceError when it ends early, LostError when
        the shape_sequencer stops reporting.  An exception during the wait, such as
        KeyboardInterrupt, cancels the sequence.
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
        Move the tip to a position; return on arrival.

        position: x, z in the plane of a planar arm, or x, y, z, m.  angle: of the tip about +y
        from +z, rad.  direction: vector of its direction, x, y, z.  tolerance, angle_tolerance: m,
        rad; 0: those of the shape_sequencer.  Other arguments and exceptions: see ``run``.
        """
        from soft_continuum.client.tip import Tip
        return self.run(Tip(position, angle, direction, None, tolerance, angle_tolerance),
                        hold=hold, progress=progress)

    def follow(self, points: 'Iterable[Tip | Sequence[float]]', *, tolerance: float = 0.0,
               hold: float = 0.0, progress: 'Callable[[Progress], object] | None' = None
               ) -> 'SequenceResult':
        """
        Move the tip through points in order, as close as possible; see ``reach``.

        points: positions, m, or Tips.  tolerance: m, of the positions.
        """
        from soft_continuum.client.tip import Tip
        return self.run([point if isinstance(point, Tip) else Tip(
            tuple(point), tolerance=tolerance) for point in points], hold=hold, progress=progress)

    def plan(self, *shapes: 'ShapeLike', time_limit: float = 0.0, states: int = 0) -> 'Plan':
        """
        Return the plan of ``run`` for shapes from the present state; nothing moves.

        ``run`` of the same shapes uses this plan if nothing has changed.  states: number of states
        to evaluate in the search for a better plan to each tip goal; 0: as many as ``run``.
        time_limit: maximum duration of that search, s; 0: the parameter reach.time_limit.  The
        Plan says whether all shapes can be set, or why not.
        """
        return self._do(self._requests.plan(shapes, time_limit, states))

    def start(self, *shapes: 'ShapeLike', hold: float = 0.0, aim: str = AIMS[0]
              ) -> 'RunningSequence':
        """
        Send a sequence like ``run``; return once it is accepted.

        After Ctrl-C during planning it is canceled once it is accepted.
        """
        sending = self._requests.start(self._requests.send(shapes, hold, aim))
        try:
            sequence = sending.result()
        except BaseException:
            if sending.exception() is None:  # otherwise it would move without a client
                self._end(sending.result())
            raise
        self._sequences = [s for s in self._sequences if not s.done] + [sequence]
        return sequence

    @property
    def closed_loop(self) -> bool | None:
        """
        Whether sequences are corrected with measurements; None if not supported.

        It can be set; raises RefusedError if shape_sequencer lacks the parameter.
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
        Set the vacuum of a segment (from 1 at the base), Pa below ambient; wait until reached.

        Raises RefusedError, with the reason, if the rig has valves instead of regulators, or the
        description has no law for this vacuum.
        """
        self._observe()
        self._do(self._requests.set_vacuum(segment, vacuum))

    # Tendons.

    def jog(self, **changes: float) -> None:
        """
        Pull in tendons by the given lengths (m), negative: pay out; wait until they rest.

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
        Straighten the arm from any shape; return how it was done, and the segments still bent.

        Uses the sequence that sets all angles to 0.  If it is refused, or no plan is found: the
        last segment is softened, pulled-in tendons are paid out to bend nothing, the other
        segments are softened, the tendons are moved to their pulls at the straight arm, and the
        segments are stiffened.  The arm may then swing, so this is refused if shape_sequencer has
        any obstacles.  After an error or Ctrl-C, the tendons rest and the segments are stiffened;
        a stop leaves them unchanged.  Raises as ``run``, ``soften`` and ``jog``.
        """
        state = self.state
        if state.stopped:
            raise RefusedError(f'motion is stopped: {state.stopped}; resume it first')
        if state.progress is not None:
            raise RefusedError('a sequence is running; cancel or stop it first')
        refused = _by_sequence(self, state)
        if refused:
            _check_free(self, state, refused)
            try:
                _without_a_plan(self, state)
            except BaseException:
                _leave_stiff(self)
                raise
        _settles(self, lambda now: not _bent(now))
        bent = _bent(self.state)
        done = f'straightened without a plan, because {refused}; ' if refused else ''
        if bent:
            return (f'{done}the tendons are at the pulls of the straight arm, but its weight or a '
                    f'tendon offset bends {", ".join(bent)}')
        return f'{done}the arm is straight'

    def stop(self) -> str:
        """Stop all motion, holding tension; nothing moves until ``resume``."""
        return self._do(self._requests.stop())

    def resume(self) -> str:
        """Allow motion after a stop, from where the tendons are."""
        return self._do(self._requests.resume())

    def reference(self, sure: bool = False) -> str:
        """
        Set the present pulls as the zero of the straight arm.

        Raises RefusedError with a question if the arm was last known not to be straight; confirm
        by calling it again within 30 s, or with ``sure``.
        """
        return self._do(self._requests.reference(sure))

    def reset(self, sure: bool = False) -> str:
        """Reset kinematics to the straight arm; asks for confirmation like ``reference``."""
        return self._do(self._requests.reset(sure))

    def tare(self) -> dict[str, str]:
        """
        Tare every camera and disc_sensors at the straight arm; all must succeed.

        Return the answer of each node, by its name, with the parameters that keep it after a
        restart.  Raises RefusedError with the reason of a node that refuses, NodesMissingError
        without any node.
        """
        return self._do(self._requests.tare())


# The way home.


def _by_sequence(arm: Arm, state: 'ArmState') -> str:
    """Return why no sequence straightened the arm; empty if one did."""
    if not _has_sequencer(state):
        return 'no shape_sequencer runs'
    try:
        arm.run([0.0] * len(arm.description.segments))
    except RefusedError as error:
        return str(error)
    except SequenceError as error:
        if error.result.outcome != Code.MODEL_FAILURE.name:
            raise
        return str(error)
    return ''


def _check_free(arm: Arm, state: 'ArmState', refused: str) -> None:
    """Raise RefusedError if there are obstacles: only plans avoid them."""
    if not _has_sequencer(state):
        return
    if names := ', '.join(one.name for one in arm.obstacles.known):
        raise RefusedError(f'{refused}; without a plan the arm could touch obstacles ({names}): '
                           'move them away, then remove them by `soft_continuum obstacles '
                           '--clear`')


def _has_sequencer(state: 'ArmState') -> bool:
    return any(node.name == SHAPE_SEQUENCER and node.running for node in state.nodes)


def _leave_stiff(arm: Arm) -> None:
    """Stiffen the softened segments, unless motion is stopped."""
    with suppress(ClientError):
        if arm.state.stiff and not arm.state.stopped:
            arm.stiffen()


def _without_a_plan(arm: Arm, state: 'ArmState') -> None:
    last, *others = range(len(state.stiff), 0, -1) or (0,)
    if last:
        arm.soften(last)
    if _is_followed(arm):
        _go(arm, most=0.0)
    for segment in others:
        arm.soften(segment)
    if not _is_followed(arm):
        arm.reset()  # the shape of soft segments depends on the pulls alone
    _go(arm, most=0.0)
    _go(arm, most=0.0, least=0.0)
    if last:
        arm.stiffen()


def _go(arm: Arm, most: float, least: float = -inf) -> None:
    """Move all pulls into a range, m."""
    state = arm.state
    pulls = dict(zip(state.tendons, state.pulls or (), strict=True))
    moves = {name: min(max(pull, least), most) - pull for name, pull in pulls.items()}
    if any(moves.values()):
        arm.jog(**moves)


def _is_followed(arm: Arm) -> bool:
    """Whether kinematics follows the shape of the arm."""
    return _settles(arm, lambda now: now.node('kinematics').level == 'ok')


def _settles(arm: Arm, condition: 'Callable[[ArmState], bool]') -> bool:
    try:
        return arm.wait_for(condition, SETTLING)
    except NoAnswerError:
        return False


def _bent(state: 'ArmState') -> list[str]:
    """Return the bent segments and their angles; kinematics may still be unaware of them."""
    return [f'segment {n} by {degrees(angle):.0f} degrees'
            for n, angle in enumerate(state.bending_angles or (), 1)
            if abs(degrees(angle)) > STRAIGHT]
