# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Firmware and settings behind a serial port, and the reference of its position.

GRBL forgets the work offset (G92) and the tool length offset (G43.1) in every reset, and nothing
else shows whether its position is still that of the motors: greetings differ, and get lost.
``mark_reference`` therefore sets both: found again later, they prove that there was no reset
since, and where zero is.  A status report has their sum now and then (WCO), the first one after a
reset always: ``bears_mark``.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf

from soft_continuum.hardware.grbl.link import (
    Acknowledgement,
    Alarm,
    Banner,
    Coordinates,
    Feedback,
    GrblLink,
    Message,
    Setting,
    SOFT_RESET,
    STATUS_QUERY,
    StatusReport,
    words,
)
from soft_continuum.hardware.grbl.motion import Motors
from soft_continuum.hardware.protocols import HardwareError

FIND_TIMEOUT = 6.0
"""s for a controller to be found; an Arduino that opening the port has reset takes about two."""
ANSWER_TIMEOUT = 1.0  # s for the answer to one line
QUERY_INTERVAL = 0.1  # s
OFFSET_QUERIES = 60  # at most, for a report that has the work offset: every 10th or 30th has
OFFSETS = '$#'
"""Asks for all offsets; for a controller at rest."""
MODES = 'G21G91'
"""Relative motion in the unit of the settings: what jogs mean; forgotten in every reset."""
MARK = 61.803
"""Steps of tool length offset that mean: referenced, and not reset since."""
MARKED = f'G43.1Z{MARK:.3f}'
MARK_AXIS = 2  # Z, to which the tool length offset belongs
RATE_MARGIN = 1.5
"""Largest factor of $110, $111 over the needed rate; they limit even damaged jogs."""

ERRORS = {
    1: 'expected a letter', 2: 'bad number', 3: 'unknown command', 5: 'homing is not enabled',
    8: 'not while it moves', 9: 'locked', 11: 'line too long',
    15: 'beyond its travel, $130 and following', 16: 'invalid jog', 20: 'unsupported command',
    22: 'no feed rate',
}
ALARMS = {
    1: 'a limit switch was hit', 2: 'beyond its travel', 3: 'it was reset while moving',
    6: 'homing was reset', 7: 'the safety door was opened during homing',
    8: 'homing did not leave the switch',
    9: 'homing did not find the switch',
}
UNLOCK = ('make sure that nothing is strained, then power-cycle the board, or type Ctrl-X and $X '
          'in a terminal; then call reference')


class ResetSeenError(Exception):
    """The controller was reset during the exchange."""


@dataclass(frozen=True)
class Controller:
    """
    A controller that was found at rest.

    position, zero: of the motors and of zero pull, steps in machine coordinates.  zero: None when
    there was a reset since the tendons were referenced, or they never were.  locked: until homed.
    """

    firmware: str
    settings: Mapping[int, float]
    position: Coordinates
    zero: Coordinates | None
    locked: bool = False


def find_controller(link: GrblLink) -> Controller:
    """
    Return the controller at the other end, without moving anything, within FIND_TIMEOUT s.

    Waits for a motion that is still under way to end.  A stop that was left half done (Hold) is
    finished: its motion is dropped, not resumed.  Raises HardwareError saying what to do.
    """
    deadline = link.waited + FIND_TIMEOUT
    # A line that an earlier program left unfinished becomes an error, not a command.
    link.write(b'=\n')
    while True:
        try:
            locked = _wait_for_rest(link, deadline)
            return replace(_interrogate(link, deadline), locked=locked)
        except ResetSeenError:
            link.answered()


def explain_alarm(number: int) -> str:
    """Return what an alarm means and what to do."""
    return (f'the GRBL controller is locked by ALARM:{number} '
            f'({ALARMS.get(number, "see the manual of the firmware")}); {UNLOCK}')


def explain_error(line: str, error: int) -> str:
    """Return why a line was refused."""
    meaning = ERRORS.get(error, 'see the manual of the firmware')
    return f'the GRBL controller refused {line!r} with error:{error} ({meaning})'


def mark_reference(offset: Sequence[int]) -> list[str]:
    """Return the lines that make the present position read ``offset`` (steps) from zero pull."""
    # The work offset of Z is counted from a tool length offset, so that must be none before.
    offset = [*offset, *(0,) * (MARK_AXIS + 1 - len(offset))]
    return ['G49', f'{MODES}G92{words(offset)}', MARKED]


def bears_mark(status: StatusReport, zero: Sequence[int]) -> bool:
    """Whether a status report contradicts no ``mark_reference`` with its zero (steps) there."""
    if status.work_offset is None or status.position is None:
        return True
    expected = [*zero, *status.position[len(zero):]]
    expected[MARK_AXIS] += MARK
    return all(abs(a - b) < 0.5 for a, b in list(zip(
        status.work_offset, expected, strict=False))[:max(len(zero), MARK_AXIS + 1)])


def is_mark(message: Message) -> bool:
    """Whether this part of the answer to OFFSETS proves that no reset came after the mark."""
    return (isinstance(message, Feedback) and message.text.startswith('TLO:')
            and message.text.rsplit(':', 1)[-1].split(',')[-1] == f'{MARK:.3f}')


def invalid_settings(settings: Mapping[int, float], motors: Motors) -> list[str]:
    """Return, for each wrong setting, its value and how to correct it."""
    axes = range(len(motors.tendons))
    feeds = [60.0 * motors.speed_limit * scale for scale in motors.steps_per_metre]
    by_switches = {22: (0.0, 0.0, 'tendons are referenced by hand: no grbl.homed_pulls')}
    if motors.homes:
        # A bit for each motor whose negative direction pays out.
        directions = float(sum(1 << i for i, sign in enumerate(motors.signs) if sign > 0.0))
        travel = motors.pull_limits[1] - motors.pull_limits[0]
        enabled = settings.get(22, 0.0)  # grblHAL has more bits than the one that switches it on
        enabled = enabled if int(enabled) & 1 else 1.0
        by_switches = {
            22: (enabled, enabled, 'grbl.homed_pulls are given'),
            23: (directions, directions, 'homing pays the tendons out, with these grbl.signs'),
            **{130 + i: (0.0, travel * scale,
                         'not to search for a switch further than pull_limits reach, in steps')
               for i, scale in enumerate(motors.steps_per_metre)},
            **dict.fromkeys((24, 25), (0.0, min(feeds), 'speed_limit in steps/min'))}
    wanted = {
        1: (255.0, 255.0, 'motors hold the tendons at rest'),
        11: (1.0, inf, 'corners are rounded by a step'),
        13: (0.0, 0.0, 'reports are not in inches'),
        20: (0.0, 0.0, 'travel is limited by pull_limits'),
        **by_switches,
        **{100 + i: (1.0, 1.0, 'the controller counts motor steps; grbl.steps_per_mm defines a '
                               'step for the driver') for i in axes},
        **{110 + i: (feed, RATE_MARGIN * feed,
                     f'speed_limit in steps/min, and at most {RATE_MARGIN:g} times that: a '
                     'damaged command is no faster') for i, feed in enumerate(feeds)},
        **{120 + i: (motors.acceleration_limit * scale, inf, 'acceleration_limit in steps/s^2')
           for i, scale in enumerate(motors.steps_per_metre)},
    }
    complaints = []
    for number, (low, high, why) in wanted.items():
        value = settings.get(number)
        fix = (low if high == inf else high if number in (24, 25) or number >= 130
               else round((low + high) / 2, 3))
        # Settings are printed with three decimals.
        if value is None or not low - 1e-3 <= value <= high + 1e-3:
            found = 'missing' if value is None else f'{value:.10g}'
            complaints.append(f'${number} is {found}, needed: ${number}={fix:.10g} ({why})')
    if not int(settings.get(10, 0)) & 1:
        complaints.append(f'$10 is {settings.get(10, 0):g}, needed: $10=1 (machine positions)')
    return complaints


def _wait_for_rest(link: GrblLink, deadline: float) -> bool:
    """
    Wait until the controller reports that it rests.

    Returns whether it is locked.  Raises HardwareError when it does not come to rest.
    """
    state = ''
    while link.waited < deadline:
        link.write(STATUS_QUERY)
        for message in list(_received(link, link.waited + QUERY_INTERVAL)):
            if isinstance(message, Alarm):
                raise HardwareError(explain_alarm(message.number))
            if isinstance(message, StatusReport):
                state = f'{message.state}:{message.substate}'.rstrip(':')
                if state == 'Hold:0':
                    link.write(SOFT_RESET)
        if state in ('Idle', 'Alarm'):
            return state == 'Alarm'
        if state.startswith(('Door', 'Sleep', 'Check')):
            raise HardwareError(f'the GRBL controller is in the state {state}; {UNLOCK}')
    if state:
        raise HardwareError(f'the GRBL controller does not come to rest: state {state}')
    raise HardwareError(
        f'no GRBL controller answered within {FIND_TIMEOUT:g} s; check grbl.port, '
        'grbl.baud_rate and the power of the board.  A board that a limit switch has locked does '
        f'not answer either: {UNLOCK}')


def _interrogate(link: GrblLink, deadline: float) -> Controller:
    """Return firmware, settings, position and zero; raises ResetSeenError, HardwareError."""
    build = [m.text for m in _ask(link, '$I', deadline) if isinstance(m, Feedback)]
    version = [text for text in build if text.startswith('VER:')]
    if not version or not version[0].startswith('VER:1.1'):
        raise HardwareError(f'the firmware is not GRBL 1.1 or grblHAL: {version or "no version"}')
    settings = {m.number: m.value for m in _ask(link, '$$', deadline)
                if isinstance(m, Setting)}
    status = _status_with_offset(link, deadline)
    if status.position is None or status.work_offset is None:  # see the check of $10
        return Controller(version[0], settings, (0.0, 0.0, 0.0), None)
    # grblHAL may keep its offsets in a reset: there they prove nothing.
    hal = any('grblhal' in text.lower() for text in build)
    marked = any(map(is_mark, _ask(link, OFFSETS, deadline)))
    zero = tuple(steps - MARK if i == MARK_AXIS else steps
                 for i, steps in enumerate(status.work_offset))
    return Controller(version[0], settings, status.position, zero if marked and not hal else None)


def _status_with_offset(link: GrblLink, deadline: float) -> StatusReport:
    """Return a status report with the work offset, which not every one has."""
    for _ in range(OFFSET_QUERIES):
        link.write(STATUS_QUERY)
        until, answered = min(link.waited + QUERY_INTERVAL, deadline), False
        while not answered and link.waited < until:  # queries that come too fast get one answer
            for message in link.receive(until - link.waited):
                if isinstance(message, Banner):
                    raise ResetSeenError
                if isinstance(message, StatusReport):
                    answered = True
                    if message.work_offset is not None or message.position is None:
                        return message
    raise HardwareError(
        'the GRBL controller does not report its work offset (WCO), without which a reset of the '
        'board goes undetected; check the cable, and $10 (grblHAL: $10=511)')


def _ask(link: GrblLink, line: str, deadline: float) -> list[Message]:
    """Send a line; return what is received until it is acknowledged."""
    link.send(line)
    deadline = min(deadline, link.waited + ANSWER_TIMEOUT)
    messages: list[Message] = []
    for message in _received(link, deadline):
        if isinstance(message, Banner):
            raise ResetSeenError
        if isinstance(message, Acknowledgement):
            link.answered()
            if message.error:
                raise HardwareError(explain_error(line, message.error))
            return messages
        messages.append(message)
    raise HardwareError(f'the GRBL controller did not answer {line!r}; check the cable')


def _received(link: GrblLink, until: float) -> Iterator[Message]:
    """Yield what is received until a time granted to the board, s."""
    while link.waited < until:
        yield from link.receive(min(QUERY_INTERVAL, until - link.waited))
