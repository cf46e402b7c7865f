# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The bar with STOP, over its own connection, and what is written in it and in the panel."""

from dataclasses import replace
import json
from math import inf, isfinite, nan, pi
import threading
from unittest.mock import Mock

import pytest
from websockets.sync.client import connect

from soft_continuum.client.estimate import Anomaly, Estimate, LearnedParameter
from soft_continuum.client.observed import KINEMATICS_STATE
from soft_continuum.client.state import Pose, Progress
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.ros.description import load_description
from soft_continuum.ros.names import NODES
from soft_continuum.sequencing import Phase
from soft_continuum.ui.browser import html
from soft_continuum.ui.browser.access import open_server
from soft_continuum.ui.browser.bar import Bar, bar_state, LOST, PAGE, PATH
from soft_continuum.ui.browser.html import chart, History, LENGTH
from soft_continuum.ui.browser.session import Description, notice_text, PageSession
from soft_continuum.ui.browser.session import MAX_TEXT as TEXT_LENGTH
from soft_continuum.user_files import description_file
from soft_continuum_interfaces.msg import Anomaly as AnomalyMessage
from soft_continuum_interfaces.msg import KinematicsState
from support.arm_states import MOVING, READY, STOPPED

ABSENT = replace(READY, stopped=None, nodes=tuple(
    replace(node, running=False, level=None, age=None, stale=True) for node in READY.nodes))


@pytest.fixture
def bar():
    return Bar()


@pytest.fixture
def page(bar):
    """Return the connection of the bar on a page."""
    server = open_server('127.0.0.1', 0, bar=bar)
    with connect(f'ws://127.0.0.1:{server.get_port()}{PATH}', open_timeout=30) as connection:
        yield connection
    server.stop()


def wait_for(page, wanted):
    while json.loads(page.recv(timeout=30)) != vars(wanted):
        pass


def test_every_page_sees_the_state_and_that_the_view_no_longer_knows_it(bar, page):
    assert '<title>soft_continuum</title>' in PAGE and 'Viser' not in PAGE
    wait_for(page, LOST)
    bar.show(bar_state(READY))
    wait_for(page, bar_state(READY))
    wait_for(page, LOST)  # nothing new for a while


def test_stop_and_resume_are_all_that_a_page_can_say(bar, page):
    said, done = [], threading.Event()
    bar.commands = {'stop': lambda: said.append('stop'), 'resume': done.set}
    for word in ('jog', 'STOP', b'stop', '', '\x1b[2J\n' * 1000, '{}', 'commands', 'stop',
                 'resume'):
        page.send(word)
    assert done.wait(30)
    assert said == ['stop']


def test_a_stopped_arm_is_called_so_in_the_words_of_the_page():
    shown = bar_state(STOPPED)
    assert (shown.kind, shown.headline) == ('stopped', 'STOPPED')
    assert 'stop was called' in shown.text and 'press Resume' in shown.text
    assert '~' not in shown.text and '/' not in shown.text
    assert bar_state(READY).kind == 'ready' and bar_state(MOVING).kind == 'moving'
    # Also while another node is missing, and not when nothing is known of it.
    half = replace(STOPPED, nodes=(*STOPPED.nodes[:-1], ABSENT.nodes[-1]))
    shown = bar_state(half)
    assert shown.kind == 'stopped' and f'Not running: {NODES[-1]}' in shown.text
    assert bar_state(STOPPED).may_resume and not bar_state(READY).may_resume
    shown = bar_state(replace(STOPPED, emergency_stop=True))
    assert not shown.may_resume and 'where it was triggered' in shown.text
    assert bar_state(ABSENT).kind == 'lost'
    assert './run up' in bar_state(ABSENT).text


@pytest.mark.parametrize(('text', 'shown'), [
    ('stopped (stop was called); call ~/resume before any motion',
     'stopped (stop was called); press Resume before any motion'),
    ('tendon_actuation: stopped; call tendon_actuation/resume first',
     'stopped; press Resume first'),
    ('tendon_actuation/stop: nothing moves before ~/resume', 'nothing moves before Resume'),
    ('jamming_valves/segment_2/set_stiff: no', 'no'),
    ('a/resumed, 3 mm/s', 'a/resumed, 3 mm/s'),
    ('\x1b[31mred\nline\u202e\x00', ' [31mred line  '),
    ('x' * 5_000_000, 'x' * (TEXT_LENGTH - 1) + '…'),
])
def test_texts_of_nodes_are_cut_cleaned_and_in_the_words_of_the_page(text, shown):
    assert notice_text(text) == shown


def test_messages_merge_expire_and_are_kept_short(monkeypatch):
    session = PageSession(Mock())
    for title in ('Jog: refused', 'Jog: refused', 'Jog: refused', 'Stop', 'Jog: refused'):
        session.notify(title, 'why', is_problem=True)
    assert [(n.title, n.count) for n in session.notices] == [
        ('Jog: refused', 3), ('Stop', 1), ('Jog: refused', 1)]
    shown = bar_state(READY, session.notices)
    assert shown.notice == 'Jog: refused: why (+4 under Messages)' and shown.problem
    old = [replace(notice, time=notice.time - 60.0) for notice in session.notices]
    assert bar_state(READY, old).notice == ''
    assert '×3' in html.notices_html(session.notices)
    session.notify('Sequence: refused', "unknown shape '" + '<b>\x1b\n' * 10**6)
    assert len(session.notices[-1].text) <= TEXT_LENGTH
    assert '<b>' not in html.notices_html(session.notices).replace('<b>Sequence', '').replace(
        '<b>Jog', '').replace('<b>Stop', '')
    assert session.notices[-1].is_new
    monkeypatch.setattr('soft_continuum.ui.browser.session.monotonic', lambda: 1e9)
    assert not session.notices[-1].is_new


@pytest.fixture(scope='module')
def description():
    return Description(arm_from_parameters(load_description(description_file())))


@pytest.mark.parametrize('change', [
    {'pressures': (nan, inf, -1e308)}, {'pressures': ()}, {'stiff': ()},
    {'tensions': (inf, -inf)}, {'tensions': (nan,)}, {'tensions': (1.0, 2.0, 3.0)},
    {'pulls': (nan, 1e300)}, {'pulls': (1.0,)}, {'bending_angles': (nan, inf, 1e308)},
    {'bending_angles': (1.0,)},
    {'progress': Progress(10**9, '<script>' * 10**5, -1, Phase.MOVING, nan)},
    {'stopped': '<script>\x1b' * 10**5},
    {'estimate': Estimate(
        True, 1e300, (nan,), (nan, inf, 1e308), 1e300,
        (LearnedParameter('<script>' * 10**5, nan, inf, True, '<script>' * 10**5),
         LearnedParameter('offset_<script>', 1e308, -1e308, True)) * 500,
        (Anomaly('<script>', 2**31, 2**31, '<script>' * 10**5, nan, '<script>\x1b' * 10**5),)
        * 500)},
    {'progress': Progress(0, 'c', 1, Phase.MEASURING, 0.5, 2**31, 1e308, 'tip')},
])
def test_no_message_of_a_node_breaks_the_readings(description, change):
    state = replace(READY, **change)
    history = History(3, 2, 101325.0)
    history.sample(state)
    texts = [html.segments_html(state, description, history),
             html.tendons_html(state, description, history), html.nodes_html(state),
             html.sequence_html(state), html.jog_hint_html(state, description),
             html.source_html(state, history), html.error_html(history),
             html.parameters_html(state.estimate)]
    assert not any('<script' in text or 'nan' in text for text in texts)
    assert max(map(len, texts)) < 40_000
    assert len(bar_state(state, ()).text) < 2 * TEXT_LENGTH


def test_bendings_in_space_have_a_direction_and_nine_tendons_a_short_table():
    values = load_description(description_file().with_name('tendon_arm.yaml'))
    described = Description(arm_from_parameters(values), values['arm.jamming'])
    names = described.arm.tendon_names
    top = Pose((0.0123, -0.0456, 0.2), (0.0, 0.0, 0.0, 1.0))
    state = replace(
        READY, tendons=names, pulls=(0.001,) * 9, tensions=(0.0, 1.25, nan) * 3, stiff=(),
        pressures=(), bending_angles=(0.5, 1.0, 0.001), bending_directions=(pi / 2, -pi / 6, 1.0),
        tip=top, estimate=Estimate(True, angle_stddevs=(0.01, 0.02) * 3))
    history = History(3, 9, 101325.0)
    segments = html.segments_html(state, described, history)
    for text in ('28.6° ±1.1° @ 90°', '57.3° ±1.1° @ -30°', '0.1° ±1.1°<', 'always soft'):
        assert text in segments
    assert 'vacuum' not in segments and 'stiff' not in segments
    tendons = html.tendons_html(state, described, history)
    assert all(f'<b>{name}</b>' in tendons for name in names)
    assert tendons.count('<tr>') == 9 and tendons.count('slack') == 3
    assert 'y&nbsp;-45.6' in html.positions_html(state, 'xyz')
    assert 'Soften' not in html.jog_hint_html(state, described)


def gaps(svg):
    return svg.partition('class="gap" d="')[2].partition('"')[0].count('M')


def lines(svg):
    return svg.partition('class="line" d="')[2].partition('"')[0]


def test_lost_data_is_a_gap_in_the_chart_and_no_fall_to_zero():
    history = History(3, 2, 101325.0)
    for state in (READY, ABSENT, READY):
        for _ in range(LENGTH // 3 + 1):
            history.sample(replace(state, pressures=(None,) * 3, tensions=None)
                           if state is ABSENT else state)
    first = History(3, 2, 101325.0)
    first.sample(READY)  # of which all that was before is missing
    assert gaps(chart(first.vacuum[0], 100.0, (0, 0, 0))) == 1
    for samples, top in ((history.vacuum[0], 100.0), (history.tensions[1], 10.0)):
        svg = chart(samples, top, (0, 0, 0))
        heights = {point.split()[1] for part in lines(svg).split('M')[1:]
                   for point in part.split('L')}
        assert gaps(svg) == 1 and lines(svg).count('M') == 2
        assert len(heights) == 1, 'the curve is level wherever there is one'


@pytest.mark.parametrize(('values', 'parts', 'missing'), [
    ([nan] * LENGTH, 0, 1), ([1.0] * LENGTH, 1, 0), ([nan, 1.0] * 150 + [nan], 150, 151),
    ([0.0] * 300 + [nan], 1, 1), ([inf, 1.0, -inf], 1, 2)])
def test_any_pattern_of_loss_is_drawn(values, parts, missing):
    svg = chart(values, 1.0, (0, 0, 0))
    assert (lines(svg).count('M'), gaps(svg)) == (parts, missing)


def test_one_colour_has_one_meaning():
    from soft_continuum import colours

    meanings = {}
    named = {'stiff': colours.STIFF, 'soft': colours.SOFT, 'unknown': colours.UNKNOWN,
             'disc': colours.DISC, 'target': colours.GHOST, 'held': colours.LOCKED,
             'predicted': colours.PREDICTED, 'axes': colours.AXES,
             'wrong': colours.WRONG, 'warning': html.WARNING,
             **{f'tension {i}': c for i, c in enumerate(colours.TENSIONS)}}
    for name, colour in named.items():
        for other, meaning in meanings.items():
            distance = sum(abs(a - b) for a, b in zip(colour, other, strict=True))
            assert distance > 80, f'{name} looks like {meaning}'
        meanings[colour] = name


def test_alarms_are_not_said_twice_in_the_bar_and_not_again_while_their_size_changes():
    message = KinematicsState(anomalies=[
        AnomalyMessage(cause=AnomalyMessage.LOAD, segment=2, message=text)
        for text in ('0.1 kg', '0.2 kg')])
    observed = Mock()
    session = PageSession(Mock(observed=observed))
    for anomaly in message.anomalies:
        observed.message.return_value = KinematicsState(anomalies=[anomaly])
        session._on_change(KINEMATICS_STATE)
    assert [n.text for n in session.notices] == ['load (segment 2): 0.1 kg']
    anomaly = Anomaly('load', 2, 0, '', 0.1, 'x' * 1000)
    shown = bar_state(replace(READY, estimate=Estimate(True, anomalies=(anomaly,) * 5)),
                      session.notices)
    assert shown.notice == ''
    first, *_, last = shown.alarm.splitlines()
    assert first.startswith('Load (segment 2): xxx') and len(first) <= 160
    assert last == '2 more under Measured shape'


def test_one_axis_of_the_error_has_one_unit():
    history = History(3, 2, 101325.0)
    for error, aim in ((0.01, 'angles'), (None, ''), (0.002, 'tip')):
        history.sample(replace(READY, progress=Progress(error=error, aim=aim)))
    assert [e for e in history.error if isfinite(e)] == [pytest.approx(2.0)]  # mm
    assert 'error of the tip: last minute, 0 to 2 mm' in html.error_html(history)
    assert html.error_html(History(3, 2, 101325.0)) == ''  # nothing was measured
