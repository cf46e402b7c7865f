# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
What is said to a GRBL controller and what it says: noise is neither believed nor fatal.

Jogs are written such that one damaged character makes none of them long.  States of a connection
lead from one to another as they should, and never otherwise.
"""

from itertools import product
import random

from hypothesis import given, settings
from hypothesis import strategies as st
import pytest

from soft_continuum.hardware.grbl.link import (
    Acknowledgement,
    Alarm,
    Banner,
    Feedback,
    G_WORDS,
    jog_line,
    MAX_LINE_LENGTH,
    MessageReader,
    parse,
    Setting,
    StatusReport,
)
from soft_continuum.hardware.grbl.motion import JogStream, Motors, subtract
from soft_continuum.hardware.grbl.setup import MODES
from soft_continuum.hardware.grbl.tendons import BUSY, Event, GrblState, next_state
from soft_continuum.sim.emulators.grbl_firmware import GrblFirmware
from support.grbl_rig import ACCELERATION, SPEED, STEPS_PER_MM, TENDONS


@pytest.mark.parametrize(('line', 'message'), [
    ('ok', Acknowledgement(0)),
    ('error:15', Acknowledgement(15)),
    ('ALARM:3', Alarm(3)),
    ('$110=500.000', Setting(110, 500.0)),
    ('$100=250.000 (x, step/mm)', Setting(100, 250.0)),
    ("Grbl 1.1h ['$' for help]", Banner("Grbl 1.1h ['$' for help]")),
    ("Grbl 1.1i MR ['$' for help]", Banner("Grbl 1.1i MR ['$' for help]")),
    ('Grbl', Banner('Grbl')),
    ("GrblHAL 1.1f ['$' or '$HELP' for help]",
     Banner("GrblHAL 1.1f ['$' or '$HELP' for help]")),
    ('[TLO:0.000]', Feedback('TLO:0.000')),
    ('<Idle|MPos:1.000,-2.500,0.000|FS:0,0>', StatusReport('Idle', '', (1.0, -2.5, 0.0), None)),
    ('<Hold:0|MPos:0.000,0.000,0.000|Bf:15,128|FS:0,0|WCO:1.000,2.000,3.000>',
     StatusReport('Hold', '0', (0.0, 0.0, 0.0), (1.0, 2.0, 3.0))),
    ('<Jog|MPos:0.0,0.0,0.0,7.5|FS:0,0|Pn:XH|Ov:100,100,100>',
     StatusReport('Jog', '', (0.0, 0.0, 0.0, 7.5), None, 'XH')),
    ('<Run|WPos:1.000,2.000,3.000>', StatusReport('Run', '', None, None)),
])
def test_every_kind_of_line_is_understood(line, message):
    assert parse(line) == message


@pytest.mark.parametrize('line', [
    '', 'okk', 'o', 'error:', 'ALARM:', 'ALARM:x', '$1', '$x=1', '$100=nan', '$100=1e5',
    '<Idle>', '<Idle|MPos:0.000,0.000>', '<Idle|MPos:0.000,0.0', '<Idle|MPos:nan,0.0,0.0>',
    '<Idle|MPos:0.000,0.000,0.000|FS:0,0', 'Idle|MPos:0.000,0.000,0.000>', '[MSG:', 'Gr'])
def test_what_was_damaged_on_the_way_is_not_believed(line):
    assert parse(line) is None


@settings(deadline=None, derandomize=True, max_examples=50)
@given(st.lists(st.sampled_from(
    [b'ok\r\n', b'<Idle|MPos:1.000,2.000,3.000|FS:0,0>\r\n', b'error:8\r\n', b'ALARM:1\r\n']),
    max_size=8), st.data())
def test_messages_are_the_same_however_the_bytes_arrive(lines, data):
    text = b''.join(lines)
    reader, pieces = MessageReader(), []
    while text:
        size = data.draw(st.integers(1, len(text)))
        pieces += reader.feed(text[:size])
        text = text[size:]
    assert pieces == MessageReader().feed(b''.join(lines))
    assert len(pieces) == len(lines)


NOISE = st.lists(st.one_of(
    st.binary(max_size=60),
    st.text('<>|:,.-+0123456789IdleMPosWCOFSok$=[]ALRM\r\n', max_size=120).map(str.encode),
    st.sampled_from([b'ok\r\n', b'<Idle|MPos:1.0,2.0,3.0|WCO:1,2,3>\r\n', b'\n', b'\x00' * 2000])),
    max_size=6)


@given(NOISE)
def fuzz(chunks):
    """Feed anything; run with more examples for longer: settings(max_examples=100_000)(fuzz)()."""
    reader = MessageReader()
    for chunk in chunks:
        for message in reader.feed(chunk):
            if isinstance(message, StatusReport) and message.position is not None:
                assert all(abs(x) < 1e9 for x in message.position)
    assert reader.feed(b'\r\nok\r\n')[-1] == Acknowledgement(0)


def test_no_bytes_make_the_reader_fail_and_the_next_line_is_understood_again():
    settings(deadline=None, derandomize=True, max_examples=100)(fuzz)()


@settings(deadline=None, derandomize=True, max_examples=100)
@given(st.lists(st.integers(-10**6, 10**6), min_size=1, max_size=4), st.floats(0.0, 1e8))
def test_a_jog_fits_into_a_line_of_the_firmware(way, feed):
    line = jog_line(way, feed)
    assert len(line) <= MAX_LINE_LENGTH
    assert 'E' not in line.upper() and 'F0.0' not in line


# Jogs

LONGEST = 5e-3 * 1e3 * STEPS_PER_MM  # steps
CHARACTERS = b'0159.+-XYZFGNMS$=(); \n\r?!~/\xff\x85'  # a reset, \x18, is another fault


def jogs(count, seed=0):
    """Jogs of motions of all speeds between random places."""
    chance = random.Random(seed)
    stream = JogStream(Motors(TENDONS, (STEPS_PER_MM,) * 2, (1.0, 1.0), SPEED, ACCELERATION,
                              (-0.06, 0.06)), ACCELERATION)
    now, made = 0.0, []
    while len(made) < count:
        target = tuple(chance.randint(-12000, 12000) for _ in TENDONS)
        stream.set_target(target, now + chance.choice((0.0, 2.0, 20.0)), now)
        for _ in range(chance.randint(5, 100)):
            now += chance.choice((0.005, 0.05))
            if jog := stream.next_jog(now):
                made.append(jog)
                stream.observe(jog.end, jog.speed)
                stream.clear_queue()
    return made[:count]


def damaged(line):
    """The line with each of its bytes lost, doubled and changed."""
    for i, byte in enumerate(line):
        for instead in (b'', bytes([byte, byte]), *(bytes([c]) for c in CHARACTERS)):
            yield line[:i] + instead + line[i + 1:]


def executed(firmware, start, line, state):
    """How far (steps) any motor would go when a line is received at a place and in a state."""
    firmware._restart()
    firmware.state = 'Idle'
    firmware.take(MODES.encode() + b'\n')
    ends = [start]
    firmware.planner.end = (*start, 0)
    firmware.planner.add = lambda target, feed: ends.append(tuple(target)[:2])
    firmware.state = state
    firmware.take(line)
    firmware.take(b'=\n')  # what the next connection sends
    return max(abs(way) for end in ends for way in subtract(end, start))


def test_no_damaged_character_makes_a_jog_longer_than_5_mm():
    firmware = GrblFirmware({}, lambda _: None, lambda _: None)
    for n, jog in enumerate(jogs(400)[::20]):
        line = jog_line(subtract(jog.end, jog.start), 60.0 * jog.feed).encode() + b'\n'
        state = ('Idle', 'Jog')[n % 2]
        assert executed(firmware, jog.start, line, 'Idle') == max(
            abs(way) for way in subtract(jog.end, jog.start))
        for wrong in damaged(line):
            assert executed(firmware, jog.start, wrong, state) <= LONGEST, wrong


def test_no_jog_has_a_number_that_a_damaged_letter_makes_a_mode():
    for jog in jogs(500, seed=1):
        assert not G_WORDS.intersection(subtract(jog.end, jog.start)), jog


def test_a_way_that_no_jog_may_make_is_made_by_two():
    stream = JogStream(Motors(TENDONS, (STEPS_PER_MM,) * 2, (1.0, 1.0), SPEED, ACCELERATION,
                              (-0.06, 0.06)), ACCELERATION)
    for way in G_WORDS:
        stream.place((0, 0))
        stream.set_target((way, -way), 0.0, 0.0)
        made = [jog for n in range(40) if (jog := stream.next_jog(0.02 * n))]
        assert made[-1].end == (way, -way)


# States


@pytest.mark.parametrize('state', GrblState)
def test_a_stop_never_starts_motion(state):
    after = next_state(state, Event.STOP)
    assert after not in (
        GrblState.JOGGING, GrblState.SEEKING, GrblState.HOMING_REQUESTED, GrblState.HOMED)
    # No stop is over before it is confirmed.
    assert after in BUSY or state not in (GrblState.JOGGING, GrblState.SEEKING)


@pytest.mark.parametrize('state', GrblState)
def test_a_failure_can_happen_in_every_state_and_lasts(state):
    assert next_state(state, Event.FAILURE) is GrblState.FAILED
    for event in Event:
        assert next_state(GrblState.FAILED, event) is GrblState.FAILED


def test_only_a_target_at_rest_begins_to_jog_and_only_a_request_at_rest_begins_to_home():
    ways = {(state, event): next_state(state, event) for state, event in product(GrblState, Event)}
    for target, event in ((GrblState.JOGGING, Event.TARGET),
                          (GrblState.HOMING_REQUESTED, Event.HOME)):
        assert {way for way, to in ways.items() if to is target and way[0] is not target} == {
            (GrblState.RESTING, event)}


@pytest.mark.parametrize('state', [state for state in GrblState if state in BUSY])
def test_a_reference_that_is_lost_ends_whatever_moves(state):
    assert next_state(state, Event.REFERENCE_LOST) is GrblState.STOPPING
