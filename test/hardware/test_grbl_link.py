# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What a GRBL controller says is understood, and noise is neither believed nor fatal."""

from hypothesis import given, settings
from hypothesis import strategies as st
import pytest

from soft_continuum.hardware.grbl.link import (
    Acknowledgement,
    Alarm,
    Banner,
    Feedback,
    jog_line,
    MAX_LINE_LENGTH,
    MessageReader,
    parse,
    Setting,
    Status,
)


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
    ('<Idle|MPos:1.000,-2.500,0.000|FS:0,0>', Status('Idle', '', (1.0, -2.5, 0.0), None)),
    ('<Hold:0|MPos:0.000,0.000,0.000|Bf:15,128|FS:0,0|WCO:1.000,2.000,3.000>',
     Status('Hold', '0', (0.0, 0.0, 0.0), (1.0, 2.0, 3.0))),
    ('<Jog|MPos:0.0,0.0,0.0,7.5|FS:0,0|Pn:XH|Ov:100,100,100>',
     Status('Jog', '', (0.0, 0.0, 0.0, 7.5), None, 'XH')),
    ('<Run|WPos:1.000,2.000,3.000>', Status('Run', '', None, None)),
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
            if isinstance(message, Status) and message.position is not None:
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
