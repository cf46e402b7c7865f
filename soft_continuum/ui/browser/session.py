# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""State of the view besides the observed arm: description, notices, requests, saved shapes."""

from base64 import b64encode
from collections import Counter, deque
from collections.abc import Callable, Coroutine, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import inf, isfinite
import re
from time import monotonic, strftime
from typing import Any, TYPE_CHECKING, TypeVar

from rclpy.node import Node
from sensor_msgs.msg import CompressedImage
from visualization_msgs.msg import MarkerArray

from soft_continuum.client import (
    ClientError,
    MotionEndedError,
    NoAnswerError,
    NodesMissingError,
    RefusedError,
    SequenceError,
)
from soft_continuum.client.estimate import anomaly_text
from soft_continuum.client.observed import anomaly_of, KINEMATICS_STATE, TENDON_STATE
from soft_continuum.client.own_file import OwnShapesError, read_saved, Saved
from soft_continuum.client.requests import Requests
from soft_continuum.client.state import ArmState, reached_text, SequenceResult
from soft_continuum.client.tasks import until
from soft_continuum.hardware.jamming_controller import JammingSettings
from soft_continuum.mechanics.arm import Arm
from soft_continuum.planning.obstacles import Obstacle
from soft_continuum.planning.settings import MotionLimits
from soft_continuum.ros.entries import LATCHED, SENSOR, subscribe_unguarded
from soft_continuum.ros.names import KINEMATICS, NODES, OVERLAY
from soft_continuum.ros.obstacles import Key, known_from_ros, MAX_KNOWN_BYTES
from soft_continuum.ros.ros_time import Age
from soft_continuum.sequencing import AIMS
from soft_continuum.ui.browser.limits import LOG
from soft_continuum.ui.browser.meshes import Points
from soft_continuum.ui.browser.tip_planning import TipPlanning
from soft_continuum.ui.cli.up import nodes_for
from soft_continuum.user_files import saved_shapes
from soft_continuum_interfaces.msg import MotionRequest

if TYPE_CHECKING:
    from soft_continuum.client.sequence import ShapeLike

T = TypeVar('T')

SEQUENCE_HOLD = 1.0  # s
MAX_NOTICES = 50
MAX_ANOMALIES = 20  # of one message that become notices
MAX_TARGET_POINTS = 1000
MAX_WAITING = 5  # pending requests of one title, except STOP
STOP = 'Stop'
NEW_PROBLEM, NEW_NOTICE = 20.0, 6.0  # s that a notice is shown in the bar
PREVIEW = 10.0  # s that a selected shape is shown
EXPECTED_ENDS = (MotionRequest.REPLACED, MotionRequest.HELD, MotionRequest.STOPPED)
SAVED = 'Saved shapes'  # title of notices
MAX_PICTURE = 1_000_000  # bytes
JPEG = b'\xff\xd8\xff'
PICTURE_AGE = 2.0  # s after which it is not shown any more
MAX_TEXT = 400  # characters
BUTTONS = {'stop': 'STOP', 'resume': 'Resume', 'reference': 'Reference', 'reset': 'Reset shape',
           'set_all_stiff': 'Stiffen all'}
NODE = f'(?:{"|".join(NODES)})'
SOURCE = re.compile(f'^(?:{NODE}(?:/[a-z_0-9]+)*: )+')
SERVICE = re.compile(f'(call )?(?:~|{NODE})/({"|".join(BUTTONS)})' r'\b')


def notice_text(text: str, most: int = MAX_TEXT) -> str:
    """Return a text with the names of buttons instead of services, cut, in one line."""
    text = text[:2 * MAX_TEXT]
    text = ''.join(c if c.isprintable() else ' ' for c in text)
    text = SERVICE.sub(lambda m: ('press ' if m[1] else '') + BUTTONS[m[2]],
                       SOURCE.sub('', text))
    return text if len(text) <= most else f'{text[:most - 1]}…'


class CameraPicture:
    """Subscribes only while the image is shown, so that it is drawn only on demand."""

    def __init__(self, node: Node) -> None:
        """Start without a subscription."""
        self._node = node
        self._subscription: Any = None
        self._data, self._age = b'', Age()

    def look(self, on: bool) -> None:
        """Start or stop the subscription; on the thread that spins the node."""
        if on and self._subscription is None:
            self._subscription = subscribe_unguarded(
                self._node, CompressedImage, OVERLAY, self._on_picture, SENSOR, MAX_PICTURE)
        elif not on and self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None

    def _on_picture(self, message: CompressedImage) -> None:
        data = bytes(message.data)
        if data.startswith(JPEG):
            self._data = data
            self._age.refresh()

    @property
    def address(self) -> str:
        """The last image as a data URL; empty if none was received for two seconds."""
        if self._age.seconds > PICTURE_AGE:
            return ''
        return f'data:image/jpeg;base64,{b64encode(self._data).decode("ascii")}'


class SavedShapes:
    """
    Follows changes of the file by other programs, and changes it.

    A slow disk must not delay STOP.  The file is read on the thread of the node only to run a
    saved name.
    """

    def __init__(self, session: 'PageSession') -> None:
        """Start empty."""
        self._session = session
        self._all = Saved()
        self._signature: tuple[int, int] | None = None
        self._disk = ThreadPoolExecutor(1, 'saved_shapes')

    @property
    def offered(self) -> Saved:
        """Shapes and sequences that fit the arm; none before it is known."""
        description = self._session.description
        if description is None:
            return Saved()
        return self._all.offered(description.arm, description.shapes)

    def follow(self) -> None:
        """Read the file if it has changed."""
        self._disk.submit(self._read)

    def change(self, change: Callable[[], str]) -> None:
        """Carry out one of the changes of own_file; a notice reports success or the reason."""
        self._disk.submit(self._change, change)

    def _read(self) -> None:
        try:
            found = saved_shapes().stat()
            signature = found.st_mtime_ns, found.st_ino
        except OSError:  # no file, mostly; else a change says why
            signature = None
        if signature != self._signature:
            self._signature = signature
            self._tell(self._take, read_saved())

    def _change(self, change: Callable[[], str]) -> None:
        try:
            done = change()
            self._read()  # first: what a notice says is done is seen, too
            self._tell(self._session.notify, SAVED, done)
        except OwnShapesError as error:
            self._tell(self._problem, str(error))
        except Exception:
            LOG.exception('the saved file could not be changed')

    def _take(self, saved: Saved) -> None:
        self._all = saved
        if saved.problem:
            self._problem(f'{saved.problem}; the rest is available, and a copy of the file is '
                          'kept at the next save')

    def _problem(self, text: str) -> None:
        self._session.notify(SAVED, text, is_problem=True)

    def _tell(self, work: Callable[..., None], *arguments: object) -> None:
        """Call a function on the thread that spins the node."""
        self._session.requests.node.executor.create_task(work, *arguments)


@dataclass(frozen=True)
class Description:
    """
    Parameters of the running nodes.

    jamming: whether segments can be stiffened.  ambient_pressure: Pa.  tension_limit: N.  shapes:
    names of those in the library.
    """

    arm: Arm
    jamming: bool = True
    ambient_pressure: float = JammingSettings.ambient_pressure
    tension_limit: float = MotionLimits.tension_limit
    shapes: tuple[str, ...] = ()

    @cached_property
    def nodes(self) -> tuple[str, ...]:
        """The nodes that drive the arm."""
        return nodes_for(self.arm, self.jamming)

    @property
    def directed(self) -> list[bool]:
        """For each segment, whether its bending has a direction; otherwise its angle is signed."""
        return [bool(about.all()) for about in self.arm.bending_axes]

    @property
    def moves_along(self) -> tuple[bool, bool, bool]:
        """Whether the arm moves along x, y and z."""
        x, y, z = self.arm.pose_axes[:3].tolist()
        return x, y, z


@dataclass(frozen=True)
class Notice:
    """
    A message to the users of the page; ``is_problem`` when a request had no effect.

    count: number of consecutive repetitions.  time: of the last, on the monotonic clock, s.
    """

    title: str
    text: str
    is_problem: bool
    count: int = 1
    clock: str = field(default_factory=lambda: strftime('%H:%M:%S'))
    time: float = field(default_factory=monotonic)

    @property
    def is_new(self) -> bool:
        """Whether it is recent, so that users may not have read it."""
        return monotonic() - self.time < (NEW_PROBLEM if self.is_problem else NEW_NOTICE)

    @property
    def times(self) -> str:
        """The number of repetitions as text, empty for one."""
        return f' (×{self.count})' if self.count > 1 else ''


class PageSession:
    """
    Follows the description of the arm, collects notices, carries out requests of the page.

    target: points (x, y, z) m along the target shape of a sequence.  obstacles: known ones.
    Requests may come from any thread; everything else belongs on the thread that spins the node.
    """

    def __init__(self, requests: Requests) -> None:
        """Start without a description."""
        self.requests = requests
        self.observed = requests.observed
        self.picture = CameraPicture(requests.node)
        self.description: Description | None = None
        self.notices: deque[Notice] = deque(maxlen=MAX_NOTICES)
        self.target: Points = ()
        self.obstacles: Mapping[Key, Obstacle] = {}
        self._preview: tuple[Points, float] = (), -inf  # and when it was selected
        self._waiting: Counter[str] = Counter()
        self._description_problem = ''
        self._describing: Future[None] | None = None
        self._motion: MotionRequest | None = None  # the last that was reported
        self.saved = SavedShapes(self)
        self.tip = TipPlanning(requests)
        self._sequences = 0  # counts what ends the rounds of a sequence, and begins another
        self.closed_loop: bool | None = None  # None: not known, or shape_sequencer has none
        self._anomalies: frozenset[tuple[str, int, int, str]] = frozenset()  # that were reported
        self.observed.on_change(self._on_change)
        subscribe_unguarded(requests.node, MarkerArray, 'target_markers', self._on_target, LATCHED)
        subscribe_unguarded(requests.node, MarkerArray, 'known_obstacles', self._on_obstacles,
                            LATCHED, MAX_KNOWN_BYTES)

    def notify(self, title: str, text: str, *, is_problem: bool = False, in_bar: bool = True
               ) -> None:
        """
        Add a notice; it replaces the last one if the texts are equal.

        in_bar: whether the bar shows it while it is new.
        """
        notice = Notice(notice_text(title), notice_text(text), is_problem)
        if not in_bar:
            notice = replace(notice, time=-inf)
        last = self.notices[-1] if self.notices else None
        if last and (last.title, last.text) == (notice.title, notice.text):
            notice = replace(notice, count=last.count + 1)
            self.notices.pop()
        self.notices.append(notice)

    def _on_target(self, message: MarkerArray) -> None:
        points = [(p.x, p.y, p.z) for marker in message.markers[:1]
                  for p in marker.points[:MAX_TARGET_POINTS]]
        self.target = tuple(p for p in points if all(map(isfinite, p)))

    def _on_obstacles(self, message: MarkerArray) -> None:
        self.obstacles = known_from_ros(message)

    def _on_change(self, topic: str) -> None:
        """Report problems, and motions that ended early unexpectedly."""
        if topic == KINEMATICS_STATE:
            self._report_anomalies()
        if topic != TENDON_STATE:
            return
        before, now = self._motion, self.observed.message(TENDON_STATE).accepted
        self._motion = now
        if (before not in (None, now) and now.status == MotionRequest.ENDED
                and now.reason not in EXPECTED_ENDS):
            self.notify('Motion ended', now.message, is_problem=True)

    def _report_anomalies(self) -> None:
        """Add a notice for every new anomaly; the bar shows them while they last."""
        message = self.observed.message(KINEMATICS_STATE)
        now = {(a.cause, a.segment, a.disc, a.tendon): a  # its size and text may always change
               for a in map(anomaly_of, message.anomalies[:MAX_ANOMALIES])}
        for key in now.keys() - self._anomalies:
            self.notify('Alarm', anomaly_text(now[key]), is_problem=True, in_bar=False)
        self._anomalies = frozenset(now)

    @property
    def state(self) -> ArmState:
        """The present state of the arm, without nodes that it does not need."""
        state = self.observed.snapshot()
        if self.description is None:
            return state
        needed = self.description.nodes
        return replace(state, nodes=tuple(n for n in state.nodes if n.name in needed))

    def preview(self, points: Points) -> None:
        """Show a shape temporarily, unless one is being set."""
        self._preview = points, monotonic()

    def ghost(self, state: ArmState) -> Points:
        """
        Return points along the shape shown beside the arm; none without one.

        The target shape, else the selected shape, else that of the planned tip.
        """
        if state.progress is not None and self.target:
            return self.target
        points, since = self._preview
        return points if monotonic() - since < PREVIEW else self.tip.points

    # What the nodes were started with.

    def update_description(self) -> None:
        """Request the description of the arm; it may change after a restart."""
        if self._describing is None or self._describing.done():
            self._describing = self.requests.start(self._describe())

    async def _describe(self) -> None:
        try:
            arm = await self.requests.description()
            values = await self.requests.parameters(
                KINEMATICS, ['arm.jamming', 'ambient_pressure', 'tension_limit'])
            described = Description(arm, **{
                name.removeprefix('arm.'): value for name, value in values.items()})
            if self.description is None or self.description.arm != arm:
                self.description = described
            shapes = await self.requests.shapes(arm)
            self.description = replace(described, shapes=tuple(shapes))
            self.closed_loop = await self.requests.closed_loop()
            self._description_problem = ''
        except (NodesMissingError, NoAnswerError):
            pass  # the page names the missing nodes
        except ClientError as error:
            if str(error) != self._description_problem:
                self._description_problem = str(error)
                self.notify('Arm state unknown', str(error), is_problem=True)

    # Requests.

    def stop(self) -> None:
        """Stop the tendons and all rounds of sequences."""
        self._sequences += 1
        self.trigger(STOP, self.requests.stop())

    def resume(self) -> None:
        """Allow motion again."""
        self.trigger('Resume', self.requests.resume())

    def run(self, shapes: 'Sequence[ShapeLike]', aim: str = AIMS[0],
            hold: 'float | Sequence[float]' = SEQUENCE_HOLD, rounds: int = 1) -> None:
        """
        Set one shape after the other; aim: one of AIMS.

        hold: s, of all or of each.  rounds: repetitions, 0: until it is canceled or stopped.
        """
        def done(result: SequenceResult) -> None:
            text = (f'shapes reached: {result.shapes_completed}' if result.reached is None else
                    reached_text(result.reached).replace('+-', '±'))
            self.notify('Sequence done', '; '.join(filter(None, (result.message, text))))

        self._sequences += 1
        number = self._sequences
        self.start('Sequence', self._run(number, shapes, aim, hold, rounds), done)

    async def _run(self, number: int, shapes: 'Sequence[ShapeLike]', aim: str,
                   hold: 'float | Sequence[float]', rounds: int) -> SequenceResult:
        """Run a sequence, each round as a separate goal, until its number is superseded."""
        done = 0
        while True:
            sequence = await self.requests.send(shapes, hold, aim)
            await until(lambda now=sequence: now.done, inf)  # type: ignore[misc]
            result, done = sequence.result(), done + 1
            if done == rounds or self._sequences != number:
                return result

    def refuse(self, title: str, reason: str) -> None:
        """Report why a request cannot be carried out."""
        async def refused() -> None:
            raise RefusedError(reason)

        self.start(title, refused())

    def set_closed_loop(self, closed: bool) -> None:
        """Turn the correction of sequences by measurements on or off."""
        def done(_: None) -> None:
            self.closed_loop = closed
            self.notify('Loop', 'sequences are corrected with measurements' if closed else
                        'sequences run open loop')

        self.start('Loop', self.requests.set_closed_loop(closed), done)

    def record(self) -> None:
        """Start a recording, or end the running one."""
        state = self.observed.recorder
        self.trigger('Recording', self.requests.record(state is None or not state.recording))

    def cancel(self) -> None:
        """Cancel every running sequence of any client, and the remaining rounds."""
        self._sequences += 1
        self.start('Cancel', self.requests.cancel_all())

    def trigger(self, title: str, work: Coroutine[Any, None, str]) -> None:
        """Start a request whose answer is a text for the users."""
        self.start(title, work, lambda message: self.notify(title, message))

    def start(self, title: str, work: Coroutine[Any, None, T],
              done: Callable[[T], None] = lambda result: None) -> None:
        """Start a request; a notice reports why it was not carried out."""
        def ended(future: Future[T]) -> None:
            try:
                done(future.result())
            except MotionEndedError:
                pass  # the state of tendon_actuation shows whether this was expected
            except SequenceError as error:
                self.notify(f'{title} ended', error.result.message, is_problem=True)
            except RefusedError as error:
                self.notify(f'{title}: refused', str(error), is_problem=True)
            except ClientError as error:
                self.notify(f'{title}: failed', str(error), is_problem=True)

        self.requests.start(self._limited(title, work)).add_done_callback(ended)

    async def _limited(self, title: str, work: Coroutine[Any, None, T]) -> T:
        """Carry it out, unless too many of its kind are pending."""
        if self._waiting[title] >= MAX_WAITING and title != STOP:
            work.close()
            raise RefusedError('earlier requests have no answer yet')
        self._waiting[title] += 1
        try:
            return await work
        finally:
            self._waiting[title] -= 1
