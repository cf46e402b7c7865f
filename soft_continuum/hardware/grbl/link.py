# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The serial line to a GRBL 1.1 controller: bytes in, messages out, one line at a time.

Every line that is sent is answered by exactly one Acknowledgement; all other messages may come at
any time.  Lengths are motor steps and speeds steps/min, as on the wire: the controller
is set to one step per "mm" of its own.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
import os
import re

from soft_continuum.hardware.clock import Clock, STEADY
from soft_continuum.hardware.serial_tendons import SerialLink

STATUS_QUERY = b'?'
FEED_HOLD = b'!'
SOFT_RESET = b'\x18'
JOG_CANCEL = b'\x85'
MAX_LINE_LENGTH = 79  # characters; a longer one is answered by error:11
MAX_ANSWER_LENGTH = 1000  # bytes; more without an end of line are noise
LAST_BYTES_TIME = 0.01  # s for what was written last to leave before the port is closed
AXES = 'XYZA'
"""Axes that can be tendons, in the order of the tendons."""

NUMBER = r'[-+]?\d{1,9}(?:\.\d{0,9})?'
BANNER = re.compile(r'(?i)grbl.*')
"""Boards greet in their own words; `setup.bears_mark` knows a reset that these do not show."""
ACKNOWLEDGEMENT = re.compile(r'ok|error:(\d{1,3})')
ALARM = re.compile(r'ALARM:(\d{1,3})')
SETTING = re.compile(rf'\$(\d{{1,3}})=({NUMBER})(?: .*)?')
STATUS = re.compile(r'<([A-Z][a-z]+)(?::(\d{1,2}))?((?:\|[^|<>]*)*)>')
COORDINATES = re.compile(rf'{NUMBER}(?:,{NUMBER}){{2,5}}')

Coordinates = tuple[float, ...]
"""One value per axis of the controller, motor steps."""
G_WORDS = frozenset((20, 53, 90))
"""Distances (steps) that no jog has: with X or Y damaged to G they would change the jog mode."""
FEED_UNIT = 100
"""steps/min; no part of such a number, with a damaged digit before it, is a G word."""


@dataclass(frozen=True)
class Banner:
    """A greeting after a reset; those of some boards are not recognized."""

    greeting: str


@dataclass(frozen=True)
class Acknowledgement:
    """The answer to one line; error 0 is ``ok``."""

    error: int


@dataclass(frozen=True)
class Alarm:
    """The controller has locked itself."""

    number: int


@dataclass(frozen=True)
class Setting:
    """One line of the answer to ``$$``."""

    number: int
    value: float


@dataclass(frozen=True)
class StatusReport:
    """
    The answer to ``?``; position and work_offset are motor steps in machine coordinates.

    position: None when the controller reports work positions instead.  work_offset: comes only
    now and then.  pins: letters of the inputs at the board that are active.
    """

    state: str
    substate: str
    position: Coordinates | None
    work_offset: Coordinates | None
    pins: str = ''


@dataclass(frozen=True)
class Feedback:
    """Any line in brackets, without them."""

    text: str


Message = Banner | Acknowledgement | Alarm | Setting | StatusReport | Feedback


def parse(line: str) -> Message | None:
    """Return the message in one line (without its end); None when it is not understood."""
    if found := ACKNOWLEDGEMENT.fullmatch(line):
        return Acknowledgement(int(found[1] or 0))
    if found := STATUS.fullmatch(line):
        fields = dict(f.split(':', 1) for f in found[3].split('|') if ':' in f)
        position = _coordinates(fields.get('MPos', ''))
        if position is None and _coordinates(fields.get('WPos', '')) is None:
            return None  # damaged on the way
        return StatusReport(found[1], found[2] or '', position,
                            _coordinates(fields.get('WCO', '')), fields.get('Pn', ''))
    if found := SETTING.fullmatch(line):
        return Setting(int(found[1]), float(found[2]))
    if found := ALARM.fullmatch(line):
        return Alarm(int(found[1]))
    if BANNER.fullmatch(line):
        return Banner(line)
    if line.startswith('[') and line.endswith(']'):
        return Feedback(line[1:-1])
    return None


def _coordinates(text: str) -> Coordinates | None:
    if not COORDINATES.fullmatch(text):
        return None
    return tuple(float(number) for number in text.split(','))


def words(steps: Sequence[int]) -> str:
    """Return steps as G-code words, such as X+1Y-20."""
    return ''.join(f'{axis}{n:+d}' for axis, n in zip(AXES, steps, strict=False))


def jog_line(way: Sequence[int], feed: float) -> str:
    """
    Return the command to jog by a ``way`` (steps) with ``feed`` (steps/min).

    No checksum protects it, so it is written such that a lost, doubled or changed character
    makes it an error or a short motion: it has no decimal point; its mode (G91) was set before;
    signs keep two numbers from becoming one; the feed, without which nothing moves, ends it.
    """
    return f'$J={words(way)}F{max(1, ceil(feed / FEED_UNIT)) * FEED_UNIT}'


class MessageReader:
    """Cuts received bytes into lines and the lines into messages."""

    def __init__(self) -> None:
        """Start with nothing received."""
        self._rest = b''

    def feed(self, data: bytes) -> list[Message]:
        """Return the messages that ``data`` completes; noise is dropped."""
        *lines, rest = re.split(b'[\r\n]+', self._rest + data)
        self._rest = rest if len(rest) <= MAX_ANSWER_LENGTH else b''
        parsed = (parse(line.decode('ascii', 'replace')) for line in lines)
        return [message for message in parsed if message is not None]


class GrblLink(SerialLink):
    """An open port with a controller behind it; for one thread, but ``wake`` and ``abort``."""

    DEVICE = 'the GRBL controller'

    def __init__(self, port: str, baud_rate: int, clock: Clock = STEADY) -> None:
        """Open a port that no other program may open until it is closed."""
        super().__init__(port, baud_rate, clock)
        self._reader = MessageReader()
        self._late = 0.0  # s by which this computer went on later than it wanted to
        self.unanswered = ''
        """The line that waits for its acknowledgement."""

    @property
    def waited(self) -> float:
        """Time (s) granted to the board; it stands still while this computer is late."""
        return self.clock() - self._late

    def close(self) -> None:
        """Close the port; bytes not sent within LAST_BYTES_TIME are dropped."""
        self.clock.sleep(LAST_BYTES_TIME)
        super().close()

    def write(self, data: bytes) -> None:
        """Send bytes that act at once and are not acknowledged; never waits."""
        try:
            written = os.write(self.line.fileno(), data)
        except (OSError, ValueError) as error:
            raise self.lost(error) from None
        if written < len(data):
            raise self.lost('it takes no more data')

    def send(self, line: str) -> None:
        """Send one line; only after the one before has been acknowledged."""
        assert not self.unanswered and len(line) <= MAX_LINE_LENGTH, line
        self.unanswered = line
        self.write(line.encode('ascii') + b'\n')

    def wait(self, timeout: float) -> bool:
        """Return whether something was received, after ``timeout`` (s), or earlier when woken."""
        begin = self.clock()
        try:
            ready = self._wait_for([self.line.fileno()], timeout)
        except (OSError, ValueError) as error:
            raise self.lost(error) from None
        self._late += max(0.0, self.clock() - begin - max(0.0, timeout))
        return bool(ready)

    def receive(self, timeout: float = 0.0) -> list[Message]:
        """Return the messages received so far, or else within ``timeout`` (s)."""
        if not self.wait(timeout):
            return []
        try:
            data = os.read(self.line.fileno(), 4096)
        except OSError as error:
            raise self.lost(error) from None
        if not data:
            raise self.lost('hung up')
        return self._reader.feed(data)

    def answered(self) -> str:
        """Note that the line was acknowledged, or never will be; return it."""
        line, self.unanswered = self.unanswered, ''
        return line
