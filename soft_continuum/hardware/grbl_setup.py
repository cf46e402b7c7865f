# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Which firmware is behind a serial port, with which settings, and what its position means.

GRBL forgets work offset (G92) and tool length offset (G43.1) in every reset, and
nothing else tells that its position is still that of the motors.  So ``mark_reference`` leaves
both behind, and who finds them later knows that there was no reset since, and where zero is.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
import time
from typing import Self

from soft_continuum.hardware.grbl_link import (
    Acknowledgement,
    Alarm,
    Banner,
    Coordinates,
    Feedback,
    GrblLink,
    Message,
    Setting,
    SOFT_RESET,
    Status,
    STATUS_QUERY,
)
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.parameters.parameter import ParameterError

FIND_TIME = 6.0
"""s for a controller to answer; an Arduino that opening the port has reset takes about two."""
ANSWER_TIME = 1.0  # s for the answer to one line
QUERY_INTERVAL = 0.1  # s
MARK = 61.803
"""mm of tool length offset that say: referenced, and not reset since."""
TOLERANCE = 1e-3
"""Relative, of steps/mm; a controller prints three decimals."""

ERRORS = {
    1: 'expected a letter', 2: 'bad number', 3: 'unknown command', 5: 'homing is not enabled',
    8: 'not while it moves', 9: 'locked', 11: 'line too long',
    15: 'beyond its travel, $130 and $131', 16: 'invalid jog', 20: 'unsupported command',
    22: 'no feed rate',
}
ALARMS = {
    1: 'a limit switch was hit', 2: 'beyond its travel', 3: 'it was reset while moving',
    6: 'homing was reset', 7: 'homing met the door', 8: 'homing did not leave the switch',
    9: 'homing did not find the switch',
}
UNLOCK = ('make sure that nothing is strained, then power-cycle the board, or type Ctrl-X and $X '
          'in a terminal; then call reference')


class ResetSeenError(Exception):
    """The controller was reset in the middle of the conversation."""


@dataclass(frozen=True)
class Controller:
    """
    A controller that was found at rest.

    position, zero: of the motors and of zero pull, mm in machine coordinates.  zero is None when
    there was a reset since the tendons were referenced, or they never were.  locked: until homed.
    """

    firmware: str
    settings: Mapping[int, float]
    position: Coordinates
    zero: Coordinates | None
    locked: bool = False


@dataclass(frozen=True)
class Homing:
    """
    How the tendons are let out to limit switches: the right and the left one.

    pulls: where they then are, m, zero or negative.  signs: 1 where a positive motion pulls.
    travel: m between pull_limits, which no search for a switch may exceed by much.
    """

    pulls: tuple[float, float]
    signs: tuple[float, float]
    travel: float

    @classmethod
    def from_parameter(cls, pulls: Sequence[float], signs: tuple[float, float],
                       pull_limits: tuple[float, float]) -> Self | None:
        """Return what grbl.homed_pulls says, None for 0 alone; raises ParameterError."""
        lowest, highest = pull_limits
        if tuple(pulls) == (0.0,):
            return None
        if len(pulls) != 2 or not all(lowest <= pull <= 0.0 for pull in pulls):
            raise ParameterError(
                f'parameter grbl.homed_pulls is {list(pulls)}; needed: right and left, from the '
                f'lower of pull_limits, {lowest:g}, to 0 m')
        return cls((pulls[0], pulls[1]), signs, highest - lowest)

    @property
    def directions(self) -> int:
        """Setting $23: a bit for each motor that goes in the negative direction to be let out."""
        return sum(1 << i for i, sign in enumerate(self.signs) if sign > 0.0)


def find_controller(link: GrblLink) -> Controller:
    """
    Return what answers at the other end, without moving anything.

    Waits for a motion that is still under way to end.  A stop that was left half done (Hold) is
    finished: its motion is thrown away, not resumed.  Raises HardwareError saying what to do.
    """
    deadline = time.monotonic() + FIND_TIME
    # Whatever line an earlier program left unfinished becomes an error, not a command.
    link.write(b'=\n')
    while True:
        try:
            locked = _wait_for_rest(link, deadline)
            return replace(_interrogate(link, deadline), locked=locked)
        except ResetSeenError:
            link.answered()


def explain_alarm(number: int) -> str:
    """Say what an alarm means and what to do."""
    return (f'the GRBL controller is locked by ALARM:{number} '
            f'({ALARMS.get(number, "see the manual of the firmware")}); {UNLOCK}')


def explain_error(line: str, error: int) -> str:
    """Say what it means that a line was refused."""
    meaning = ERRORS.get(error, 'see the manual of the firmware')
    return f'the GRBL controller refused {line!r} with error:{error} ({meaning})'


def mark_reference(offset: tuple[float, float]) -> list[str]:
    """Return the lines that make the present position read ``offset`` (mm) from zero pull."""
    return [f'G21G92X{offset[0]:.4f}Y{offset[1]:.4f}', f'G43.1Z{MARK:.3f}']


def unfit_settings(settings: Mapping[int, float], steps_per_mm: tuple[float, float],
                   speed: float, acceleration: float, homing: Homing | None = None) -> list[str]:
    """
    Say of each setting that contradicts the configuration what it is, must be, and how to set it.

    speed: mm/s.  acceleration: mm/s^2.  homing: None without switches.  Empty when all fit.
    """
    by_switches = {22: (0.0, 0.0, 'tendons are referenced by hand: no grbl.homed_pulls')}
    if homing is not None:
        let_out, travel = float(homing.directions), 1e3 * homing.travel
        homes = settings.get(22, 0.0)  # grblHAL has more bits than the one that switches it on
        homes = homes if int(homes) & 1 else 1.0
        by_switches = {
            22: (homes, homes, 'grbl.homed_pulls are given'),
            23: (let_out, let_out, 'homing lets the tendons out, with these grbl.signs'),
            **dict.fromkeys((130, 131), (0.0, travel, 'not to look for a switch further than '
                                         'pull_limits reach')),
            **dict.fromkeys((24, 25), (0.0, 60.0 * speed, 'speed_limit in mm/min'))}
    wanted = {
        1: (255.0, 255.0, 'motors hold the tendons at rest'),
        13: (0.0, 0.0, 'reports are in mm'),
        20: (0.0, 0.0, 'travel is limited by pull_limits'),
        **by_switches,
        **{100 + i: (steps * (1 - TOLERANCE), steps * (1 + TOLERANCE), 'grbl.steps_per_mm')
           for i, steps in enumerate(steps_per_mm)},
        **{110 + i: (60.0 * speed, float('inf'), 'speed_limit in mm/min') for i in (0, 1)},
        **{120 + i: (acceleration, float('inf'), 'acceleration_limit in mm/s^2') for i in (0, 1)},
    }
    complaints = []
    for number, (low, high, why) in wanted.items():
        value = settings.get(number)
        fix = (low if high == float('inf') else high if number in (24, 25, 130, 131)
               else round((low + high) / 2, 3))
        # What is printed with three decimals must not fail for the fourth.
        if value is None or not low - 1e-3 <= value <= high + 1e-3:
            found = 'missing' if value is None else f'{value:g}'
            complaints.append(f'${number} is {found}, needed: ${number}={fix:g} ({why})')
    if not int(settings.get(10, 0)) & 1:
        complaints.append(f'$10 is {settings.get(10, 0):g}, needed: $10=1 (machine positions)')
    return complaints


def _wait_for_rest(link: GrblLink, deadline: float) -> bool:
    """
    Ask until the controller says that it rests, and everything sent before is answered.

    Returns whether it is locked.
    """
    seen = ''
    while time.monotonic() < deadline:
        link.write(STATUS_QUERY)
        for message in _collect(link, QUERY_INTERVAL):
            if isinstance(message, Alarm):
                raise HardwareError(explain_alarm(message.number))
            if isinstance(message, Status):
                seen = f'{message.state}:{message.substate}'.rstrip(':')
                if seen == 'Hold:0':
                    link.write(SOFT_RESET)
        if seen in ('Idle', 'Alarm'):
            return seen == 'Alarm'
        if seen.startswith(('Door', 'Sleep', 'Check')):
            raise HardwareError(f'the GRBL controller is in the state {seen}; {UNLOCK}')
    if seen:
        raise HardwareError(f'the GRBL controller does not come to rest: state {seen}')
    raise HardwareError(
        f'nothing that speaks GRBL answered within {FIND_TIME:g} s; check grbl.port, '
        'grbl.baud_rate and the power of the board.  A board that a limit switch has locked is '
        f'silent too: {UNLOCK}')


def _interrogate(link: GrblLink, deadline: float) -> Controller:
    build = [m.text for m in _ask(link, '$I') if isinstance(m, Feedback)]
    version = [text for text in build if text.startswith('VER:')]
    if not version or not version[0].startswith('VER:1.1'):
        raise HardwareError(f'the firmware is not GRBL 1.1 or grblHAL: {version or "no version"}')
    settings = {m.number: m.value for m in _ask(link, '$$') if isinstance(m, Setting)}
    parameters = [m.text for m in _ask(link, '$#') if isinstance(m, Feedback)]
    offsets = [text.rsplit(':', 1)[-1].split(',')[-1] for text in parameters
               if text.startswith('TLO:')]
    # It is not known which resets let grblHAL keep its offsets: there they prove nothing.
    hal = any('grblhal' in text.lower() for text in build)
    marked = offsets == [f'{MARK:.3f}'] and not hal
    while time.monotonic() < deadline:
        link.write(STATUS_QUERY)
        for message in _collect(link, QUERY_INTERVAL / 5):
            if isinstance(message, Banner):
                raise ResetSeenError
            if not isinstance(message, Status):
                continue
            if message.position is None:  # the check of $10 will say why
                return Controller(version[0], settings, (0.0, 0.0, 0.0), None)
            if not marked or message.work_offset is not None:
                zero = message.work_offset if marked else None
                return Controller(version[0], settings, message.position, zero)
    raise HardwareError('the GRBL controller does not report its position; check the cable')


def _ask(link: GrblLink, line: str) -> list[Message]:
    """Send a line; return what comes until it is acknowledged."""
    link.send(line)
    deadline = time.monotonic() + ANSWER_TIME
    messages: list[Message] = []
    while time.monotonic() < deadline:
        for message in link.receive(deadline - time.monotonic()):
            if isinstance(message, Banner):
                raise ResetSeenError
            if isinstance(message, Acknowledgement):
                link.answered()
                if message.error:
                    raise HardwareError(explain_error(line, message.error))
                return messages
            messages.append(message)
    raise HardwareError(f'the GRBL controller did not answer {line!r}; check the cable')


def _collect(link: GrblLink, seconds: float) -> list[Message]:
    """Return all that comes within a time."""
    until = time.monotonic() + seconds
    messages: list[Message] = []
    while time.monotonic() < until:
        messages += link.receive(until - time.monotonic())
    return messages
