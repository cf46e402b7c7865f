# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The GRBL 1.1 firmware: lines, real-time commands, states, settings, offsets, motion.

Only what moves three axes: jogs, G0 and G1, holds, resets, alarms, homing.  Motion is as GRBL
makes it: up to 15 blocks planned ahead to end at rest, cut into 10 ms segments.  Up to five
segments are always cut in advance: what happens later, a feed hold or one more block, cannot
change them.  Positions are whole motor steps, lengths mm, times emulated s.
"""

from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from math import hypot, inf, sqrt
import re

BLOCKS = 15
SEGMENTS = 5
SEGMENT_TIME = 0.01  # s
FINE = 0.001  # s; the speed is constant over this

RECEIVE_BUFFER = 127  # characters; more is dropped without a message
MAX_LINE_LENGTH = 79
OFF_TIME = 0.5  # s without current after a reset in motion
PRESS_TIME = 0.15  # s that a button is held down
WORD = re.compile(r'([A-Z])([-+]?(?:\d+\.?\d*|\.\d+))')
COMMENT = re.compile(r'\([^)]*\)?|;.*')
MAX_DIGITS = 8  # of a number; the value of further ones is lost
DEFAULTS = {
    0: 10, 1: 255, 2: 0, 3: 0, 4: 0, 5: 0, 6: 0, 10: 1, 11: 2, 12: 0.002, 13: 0, 20: 0, 21: 0,
    22: 0, 23: 0, 24: 5000, 25: 100000, 26: 250, 27: 200, 30: 1000, 31: 0, 32: 0,
    100: 1, 101: 1, 102: 1, 110: 450000, 111: 450000, 112: 450000, 120: 100000, 121: 100000,
    122: 100000, 130: 40000, 131: 40000, 132: 40000,
}
# Settings without decimals.
WHOLE_NUMBERS = frozenset((*range(11), *range(13, 24), 26, 30, 31, 32))
OK, BAD_LETTER, BAD_NUMBER, BAD_STATEMENT, NO_HOMING, NOT_IDLE, LOCKED = 0, 1, 2, 3, 5, 8, 9
NEEDS_HOMING, TOO_LONG, TRAVEL, BAD_JOG, UNSUPPORTED, NO_FEED = 10, 11, 15, 16, 20, 22
REPEATED = 25
HARD_LIMIT, SOFT_LIMIT, RESET_IN_MOTION, RESET_IN_HOMING, HOMING_FAILED = 1, 2, 3, 6, 9
CODES = frozenset((0, 1, 20, 21, 43.1, 49, 53, 54, 90, 91, 92, 94))
INCH = 25.4  # mm

Steps = tuple[int, ...]
Coordinates = tuple[float, ...]
"""X, Y and Z."""


@dataclass
class Block:
    """A straight motion; entry_speed is what the blocks after it allow."""

    start: Steps
    end: Steps
    direction: Coordinates
    length: float
    speed: float
    acceleration: float
    junction_speed: float
    entry_speed: float = 0.0


@dataclass(frozen=True)
class MotionSegment:
    """Where the motors go within a time."""

    duration: float
    start: Steps
    end: Steps


@dataclass(frozen=True)
class MachineSettings:
    """steps_per_mm, rates (mm/s) and accelerations (mm/s^2) per axis; junction_deviation (mm)."""

    steps_per_mm: Coordinates
    rates: Coordinates
    accelerations: Coordinates
    junction_deviation: float


class MotionPlanner:
    """Blocks, segments and motors; ``motors``: the steps that were made."""

    def __init__(self, settings: MachineSettings, motors: Steps = (0, 0, 0)) -> None:
        """Stand at ``motors``."""
        self.settings = settings
        self.motors = motors
        self.clear()

    def clear(self) -> None:
        """Forget all motion; the motors stay where they are."""
        self.blocks: deque[Block] = deque()
        self.end = self.motors
        self.holding = False
        self._segments: deque[MotionSegment] = deque()
        self._into_segment = 0.0  # s
        self._cut = self.motors  # where the segments lead
        self.speed = 0.0  # mm/s along the path, at their end
        self._into_block = 0.0  # mm, at their end

    @property
    def free(self) -> int:
        """Number of blocks for which there is room."""
        return BLOCKS - len(self.blocks)

    @property
    def empty(self) -> bool:
        """Whether nothing is left to do."""
        return not self.blocks and not self._segments

    @property
    def standing(self) -> bool:
        """Whether the motors stand, at the end of all motion or of a hold."""
        return not self._segments and (not self.blocks or (self.holding and self.speed == 0.0))

    def add(self, target: Sequence[float], feed: float) -> None:
        """Go to ``target`` (mm) with ``feed`` (mm/s) as far as the settings allow it."""
        scale = self.settings.steps_per_mm
        end = tuple(round(mm * s) for mm, s in zip(target, scale, strict=True))
        vector = [(b - a) / s for a, b, s in zip(self.end, end, scale, strict=True)]
        length = hypot(*vector)
        if length == 0.0:
            return
        direction = tuple(x / length for x in vector)
        junction = 0.0
        if self.blocks:
            junction = self._junction_speed(self.blocks[-1].direction, direction)
            junction = min(junction, self.blocks[-1].speed, feed)
        self.blocks.append(Block(
            self.end, end, direction, length,
            min(feed, _along(self.settings.rates, direction)),
            _along(self.settings.accelerations, direction), junction))
        self.end = end
        exit_speed = 0.0
        for block in reversed(self.blocks):
            block.entry_speed = min(block.junction_speed, block.speed,
                                    sqrt(exit_speed**2 + 2 * block.acceleration * block.length))
            exit_speed = block.entry_speed

    def advance(self, duration: float) -> None:
        """Let the motors run for a time."""
        while duration > 0.0:
            self._cut_segments()
            if not self._segments:
                return
            segment = self._segments[0]
            step = min(duration, segment.duration - self._into_segment)
            self._into_segment += step
            duration -= step
            part = self._into_segment / segment.duration
            if part >= 1.0 - 1e-9:
                self.motors = segment.end
                self._segments.popleft()
                self._into_segment = 0.0
            else:
                self.motors = tuple(round(a + part * (b - a)) for a, b in
                                     zip(segment.start, segment.end, strict=True))

    def remaining_time(self) -> float:
        """Return how long the motors would move if nothing else came."""
        copy = deepcopy(self)
        total = 0.0
        while not copy.empty and total < 1e3:
            copy.advance(FINE)
            total += FINE
        return total

    def _junction_speed(self, before: Coordinates, after: Coordinates) -> float:
        """Return the speed (mm/s) at which a corner stays within the junction deviation."""
        cosine = -sum(a * b for a, b in zip(before, after, strict=True))
        if cosine > 0.999999:
            return 0.0
        if cosine < -0.999999:
            return inf
        half_sine = sqrt(0.5 * (1.0 - cosine))
        change = [b - a for a, b in zip(before, after, strict=True)]
        size = hypot(*change)
        acceleration = _along(self.settings.accelerations, tuple(c / size for c in change))
        return sqrt(acceleration * self.settings.junction_deviation * half_sine
                    / (1.0 - half_sine))

    def _cut_segments(self) -> None:
        while len(self._segments) < SEGMENTS and self.blocks:
            # A segment ends with its block, so that motors never cut a corner.
            start, elapsed, block = self._cut, 0.0, self.blocks[0]
            while self.blocks and self.blocks[0] is block and elapsed < SEGMENT_TIME - 1e-9:
                if self.holding and self.speed == 0.0:
                    break
                elapsed += FINE
                self._run_on(FINE)
            if elapsed == 0.0:
                return
            self._segments.append(MotionSegment(elapsed, start, self._cut))

    def _run_on(self, time: float) -> None:
        block = self.blocks[0]
        left = block.length - self._into_block
        exit_speed = self.blocks[1].entry_speed if len(self.blocks) > 1 else 0.0
        wanted = 0.0 if self.holding else min(
            block.speed, sqrt(exit_speed**2 + 2 * block.acceleration * left))
        most = block.acceleration * time
        self.speed += max(-most, min(most, wanted - self.speed))
        if self.holding and self.speed <= 0.0:
            self.speed = 0.0
            return
        # The last step of a block is made however slow it has become.
        distance = max(self.speed, most / 2) * time
        while distance >= left:
            distance -= left
            self._cut = block.end
            self._into_block = 0.0
            self.blocks.popleft()
            if not self.blocks:
                self.speed = 0.0
                return
            block = self.blocks[0]
            left = block.length
        self._into_block += distance
        part = self._into_block / block.length
        self._cut = tuple(round(a + part * (b - a)) for a, b in
                           zip(block.start, block.end, strict=True))


def _along(limits: Coordinates, direction: Coordinates) -> float:
    """Return the largest speed along a direction at which no axis exceeds its limit."""
    return min(limit / abs(d) for limit, d in zip(limits, direction, strict=True) if d != 0.0)


class GrblFirmware:
    """
    The firmware and its motors, without a wire; times are emulated s.

    ``time`` is now and ``stood_since`` the end of the last motion.  ``race``: the next jog runs as
    a program.  ``stalled``: the motors make no step, whatever the state.  ``greeting``: sent after
    a reset; forks of the firmware have their own.
    """

    def __init__(self, settings: Mapping[int, float], say: Callable[[str], None],
                 acknowledge: Callable[[str], None], switches: Sequence[float] = ()) -> None:
        """
        Switch on; ``settings`` are ``$`` numbers that are not as usual.

        say, acknowledge: called with unsolicited lines, and with acknowledgements.
        switches: where the limit switches of X and Y close, from where the motors now are, in the
        unit of the settings.
        """
        self.settings: dict[int, float] = {**DEFAULTS, **settings}
        self.received: list[str] = []  # lines, as they came
        self.race = self.stalled = False
        self.greeting = "Grbl 1.1h ['$' for help]"
        self.time = self.stood_since = 0.0
        self.forgotten: Steps = (0, 0, 0)  # steps made before the position was set to zero
        self.buffer = bytearray()
        self._say_line = say
        self._acknowledge = acknowledge
        self._switches = [round(at * self.settings[100 + i]) for i, at in enumerate(switches)]
        self._critical = self._cancelling = False
        self.planner = MotionPlanner(self._machine())
        self._switch_on()

    @property
    def made(self) -> Steps:
        """Steps that the motors have made since the beginning."""
        return tuple(a + b for a, b in zip(self.planner.motors, self.forgotten, strict=True))

    @property
    def energised(self) -> bool:
        """Whether the motors hold their load."""
        return self._off_for <= 0.0

    @property
    def resting(self) -> bool:
        """Whether nothing changes with time: no motion, no pending work, no temporary state."""
        return (self.planner.standing and not self._cancelling and b'\n' not in self.buffer
                and self.state not in ('Jog', 'Run', 'Home')
                and self._off_for <= 0.0 and self._pressed_for <= 0.0)

    def advance(self, step: float) -> None:
        """Let a little time pass."""
        if not self.stalled:
            self.planner.advance(step)
        self.time += step
        if not self.planner.standing:
            self.stood_since = self.time
        self._off_for -= step
        self._pressed_for -= step
        self._settle()
        self._work()

    def reset(self, banner: bool) -> None:
        """Reset, as at the board: the position becomes zero wherever the motors are."""
        self._place([0, 0])
        self._switch_on()
        if banner:
            self._greet()

    def alarm(self, number: int) -> None:
        """Stop at once and lock; 1 and 2 answer nothing before a soft reset."""
        self.planner.clear()
        self.state = 'Alarm'
        self._say(f'ALARM:{number}')
        if number in (HARD_LIMIT, SOFT_LIMIT):
            self._critical = True
            self._say('[MSG:Reset to continue]')

    def hold(self) -> None:
        """Press the feed hold button for a moment."""
        self._pressed_for = PRESS_TIME
        self._realtime(ord('!'))

    def door(self) -> None:
        """Open the safety door."""
        self.planner.holding = True
        self.state = 'Door'

    def take(self, data: bytes) -> None:
        """Receive bytes."""
        for byte in data:
            if byte in b'?!~\x18' or byte > 0x7F:
                self._realtime(byte)
            elif len(self.buffer) < RECEIVE_BUFFER:
                self.buffer.append(byte)
            self._work()

    def _settle(self) -> None:
        """Change the state when a motion, a hold or homing has come to its end."""
        if self.state == 'Home' and self.planner.empty:
            self._place([self._homed(i) for i in (0, 1)])
            self.state = 'Idle'
            self._acknowledge('ok')
        if not self.planner.standing:
            return
        if self._cancelling:
            self.planner.clear()
            self._cancelling = False
            self.state = 'Idle'
        elif self.state in ('Jog', 'Run') and self.planner.empty:
            self.state = 'Idle'

    def _work(self) -> None:
        """Do the lines that have come, as far as nothing makes them wait."""
        while b'\n' in self.buffer and not (
                self._critical or self._cancelling or self.planner.free <= 0
                or self.state in ('Hold', 'Door', 'Home')):
            line, _, rest = bytes(self.buffer).partition(b'\n')
            self.buffer = bytearray(rest)
            text = line.decode('ascii', 'replace').strip()
            self.received.append(text)
            error = self._do(re.sub(r'[\x00-\x20/]', '', COMMENT.sub('', text)).upper())
            if error is not None:
                self._acknowledge('ok' if error == OK else f'error:{error}')

    def _switch_on(self) -> None:
        self.state = 'Alarm' if self.settings[22] else 'Idle'
        self._off_for = self._pressed_for = 0.0
        self._restart()

    def _restart(self) -> None:
        """Clear the state that every reset clears; not the position."""
        self.buffer.clear()
        self._critical = self._cancelling = False
        self.planner.clear()
        self._work_offset = [0.0, 0.0, 0.0]  # G92
        self._tool_offset = 0.0  # G43.1
        self._absolute, self._inches, self._feed, self._rapid = True, False, 0.0, True
        self._until_offset = 0  # status reports before the next one with offsets

    def _place(self, position: Sequence[int]) -> None:
        """Take the motors to be at a position (steps of X and Y; Z is at 0)."""
        x, y, z = self.made
        self.planner = MotionPlanner(self._machine(), (position[0], position[1], 0))
        self.forgotten = x - position[0], y - position[1], z

    def _homed(self, axis: int) -> int:
        """Return where an axis counts as being when it has left its switch again, steps."""
        mm = self.settings[27] - self.settings[130 + axis]
        if not int(self.settings[23]) >> axis & 1:
            mm = -self.settings[27]
        return round(mm * self.settings[100 + axis])

    def _home(self) -> int | None:
        """Go to where the motors are off their switches again; return what is wrong."""
        target = [a / self.settings[100 + i] for i, a in enumerate(self.planner.end)]
        found = bool(self._switches)
        for i, switch in enumerate(self._switches):
            way = (switch - self.made[i]) / self.settings[100 + i]
            back = -1.0 if int(self.settings[23]) >> i & 1 else 1.0
            found = found and way * back >= 0.0  # else it goes away from the switch
            target[i] += way - back * self.settings[27]
        if not found:
            self.alarm(HOMING_FAILED)
            return OK
        self.state = 'Home'
        self.planner.add(target, self.settings[25] / 60.0)
        return None

    def _say(self, *lines: str) -> None:
        for line in lines:
            self._say_line(line)

    def _greet(self) -> None:
        self._say('', self.greeting)
        if self.state == 'Alarm':
            self._say("[MSG:'$H'|'$X' to unlock]")

    def _realtime(self, byte: int) -> None:
        if byte == 0x18:
            self._soft_reset()
        elif self._critical or self.state == 'Home':
            return
        elif byte == ord('?'):
            self._say(self._report())
        elif byte == ord('!') and self.state in ('Idle', 'Run'):
            self.state, self.planner.holding = 'Hold', True
        elif (byte == ord('!') or byte == 0x85) and self.state == 'Jog':
            self._cancelling = self.planner.holding = True
        elif byte == ord('~') and self.state == 'Hold' and self.planner.standing:
            self.planner.holding = False
            self.state = 'Idle' if self.planner.empty else 'Run'

    def _soft_reset(self) -> None:
        if self.state == 'Home' or not self.planner.standing:
            self._say(f'ALARM:{RESET_IN_HOMING if self.state == "Home" else RESET_IN_MOTION}')
            self.state, self._off_for = 'Alarm', OFF_TIME
        elif self.state != 'Alarm':
            self.state = 'Idle'
        self._restart()
        self._greet()

    def _report(self) -> str:
        state, planner = self.state, self.planner
        if state in ('Hold', 'Door'):
            state += ':0' if planner.standing else ':1' if state == 'Hold' else ':2'
        offsets = [*self._work_offset[:2], self._work_offset[2] + self._tool_offset]
        position = [m / self.settings[100 + i] for i, m in enumerate(planner.motors)]
        kind = 'MPos'
        if not int(self.settings[10]) & 1:
            kind, position = 'WPos', [p - o for p, o in zip(position, offsets, strict=True)]
        speed = 0.0 if planner.standing else 60.0 * planner.speed
        text = f'<{state}|{kind}:{decimals(position)}'
        if int(self.settings[10]) & 2:
            text += f'|Bf:{planner.free},{RECEIVE_BUFFER + 1 - len(self.buffer)}'
        text += f'|FS:{speed:.0f},0'
        if self._pressed_for > 0.0:
            text += '|Pn:H'
        if self._until_offset == 0:
            text += f'|WCO:{decimals(offsets)}'
        elif self._until_offset in (9, 29):
            text += '|Ov:100,100,100'
        again = 10 if self.state in ('Idle', 'Alarm') else 30
        self._until_offset = (self._until_offset or again) - 1
        return text + '>'

    def _machine(self) -> MachineSettings:
        s = self.settings
        return MachineSettings(
            tuple(s[100 + i] for i in range(3)), tuple(s[110 + i] / 60.0 for i in range(3)),
            tuple(s[120 + i] for i in range(3)), s[11])

    def _do(self, line: str) -> int | None:
        """Execute one line; return its error, or None when the answer follows later."""
        if len(line) > MAX_LINE_LENGTH:
            return TOO_LONG
        if line in ('', '$'):
            return OK
        if line.startswith('$J'):
            if self.state not in ('Idle', 'Jog'):
                return NOT_IDLE
            return self._move(line[3:], jog=True) if line[2:3] == '=' else BAD_STATEMENT
        if not line.startswith('$'):
            return LOCKED if self.state in ('Alarm', 'Jog') else self._move(line, jog=False)
        if line == '$X':
            if self.state == 'Alarm':
                self.state = 'Idle'
                self._say('[MSG:Caution: Unlocked]')
            return OK
        if line == '$$':
            if self.state == 'Run':
                return NOT_IDLE
            self._say(*(f'${n}={v:.0f}' if n in WHOLE_NUMBERS else f'${n}={v:.3f}'
                        for n, v in sorted(self.settings.items())))
            return OK
        return self._do_at_rest(line) if self.state in ('Idle', 'Alarm') else NOT_IDLE

    def _do_at_rest(self, line: str) -> int | None:
        if line == '$I':
            self._say('[VER:1.1h.20190830:]', '[OPT:V,15,128]')
        elif line == '$#':
            zero = decimals((0.0, 0.0, 0.0))
            self._say(*(f'[G{n}:{zero}]' for n in (54, 55, 56, 57, 58, 59, 28, 30)),
                      f'[G92:{decimals(self._work_offset)}]', f'[TLO:{self._tool_offset:.3f}]',
                      f'[PRB:{zero}:0]')
        elif line == '$H':
            if not self.settings[22]:
                return NO_HOMING
            return self._home()
        elif found := re.fullmatch(r'\$(\d{1,3})=(\d+\.?\d*)', line):
            number, value = int(found[1]), float(found[2])
            if number not in self.settings:
                return BAD_STATEMENT
            if number == 20 and value and not self.settings[22]:
                return NEEDS_HOMING
            self.settings[number] = value
            self.planner.settings = self._machine()
        else:
            return BAD_STATEMENT
        return OK

    def _move(self, line: str, jog: bool) -> int:
        words = WORD.findall(line)
        if ''.join(letter + number for letter, number in words) != line:
            return BAD_LETTER if not re.match('[A-Z]', line) else BAD_NUMBER
        codes = {float(number) for letter, number in words if letter == 'G'}
        letters = [letter for letter, _ in words if letter != 'G']
        if len(set(letters)) < len(letters):
            return REPEATED
        values = {letter: value_of(number) for letter, number in words if letter != 'G'}
        if not codes <= CODES or not values.keys() <= set('XYZFN'):
            return BAD_JOG if jog else UNSUPPORTED
        if jog and (codes & {0, 1, 92, 43.1, 49} or not values.keys() & set('XYZ')):
            return BAD_JOG
        if jog and 'F' not in values:
            return NO_FEED
        inches = 20 in codes if codes & {20, 21} else self._inches
        absolute = 90 in codes if codes & {90, 91} else self._absolute
        unit = INCH if inches else 1.0
        axes = {i: values[c] * unit for i, c in enumerate('XYZ') if c in values}
        end = [e / self.settings[100 + i] for i, e in enumerate(self.planner.end)]
        tool = [0.0, 0.0, self._tool_offset]
        if 92 in codes:
            for i, value in axes.items():
                self._work_offset[i] = end[i] - tool[i] - value
        if 43.1 in codes or 49 in codes:
            self._tool_offset = axes.get(2, 0.0) if 43.1 in codes else 0.0
        if codes & {92, 43.1, 49}:
            self._until_offset = 0
        if not jog:
            self._inches, self._absolute = inches, absolute
            self._rapid = 0 in codes or (self._rapid and 1 not in codes)
            self._feed = values.get('F', self._feed / unit) * unit
        if not axes or codes & {92, 43.1, 49}:
            return OK
        feed = values['F'] * unit if jog else 1e6 if self._rapid else self._feed
        if feed <= 0.0:
            return NO_FEED
        for i, value in axes.items():
            if 53 in codes:
                end[i] = value
            else:
                end[i] = value + (self._work_offset[i] + tool[i] if absolute else end[i])
        return self._go(end, feed / 60.0, jog)

    def _go(self, target: Iterable[float], feed: float, jog: bool) -> int:
        target = list(target)
        if self.settings[20] and any(
                not -self.settings[130 + i] <= value <= 0.0 for i, value in enumerate(target)):
            if not jog:
                self.alarm(SOFT_LIMIT)
            return TRAVEL if jog else OK
        self.planner.add(target, feed)
        if self.state == 'Idle' and not self.planner.empty:
            self.state = 'Run' if self.race or not jog else 'Jog'
            self.race = False
        return OK


def value_of(number: str) -> float:
    """Return the value of a number, as far as the firmware reads it."""
    whole, _, fraction = number.lstrip('+-').partition('.')
    read = (whole + fraction)[:MAX_DIGITS]
    value = int(read) * 10.0 ** (len(whole) - len(read))
    return -value if number[0] == '-' else value


def decimals(values: Iterable[float]) -> str:
    """Return coordinates (mm) as they are reported."""
    return ','.join(f'{value:.3f}' for value in values)
