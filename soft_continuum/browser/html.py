# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The readings of the panel, as small pieces of HTML."""

from collections.abc import Iterable
from html import escape
from math import degrees, isnan

from soft_continuum.browser.session import Description, Notice
from soft_continuum.client.state import ArmState, NodeReport
from soft_continuum.colours import (
    Colour,
    LOCKED,
    SLACK,
    SOFT,
    STIFF,
    tension_colour,
    UNKNOWN,
)
from soft_continuum.ros.names import SHAPE_SEQUENCER

GOOD: Colour = (39, 174, 96)
WARNING: Colour = (230, 145, 20)
BAD: Colour = (214, 40, 40)
LEVELS = {'ok': GOOD, 'warn': WARNING, 'error': BAD}
START = ('<code>./run up</code>&nbsp; or &nbsp;'
         '<code>ros2 launch soft_continuum bringup.launch.py</code>')


def nodes_html(state: ArmState) -> str:
    """Return a row per node: level and message of its status, or since when it is stale."""
    return _table(_node_row(report) for report in state.nodes)


def _node_row(report: NodeReport) -> tuple[str, str]:
    name = f'<b>{report.name}</b><br>'
    if report.age is None:
        return _chip('absent', UNKNOWN), f'{name}nothing received yet'
    if report.stale:
        # Rounded, or the text would change all the time.
        age = f'{report.age:.0f} s' if report.age < 60 else f'{report.age / 60:.0f} min'
        return _chip('stale', BAD), f'{name}last message {age} ago'
    level = report.level or 'ok'
    return _chip(level.upper(), LEVELS[level]), f'{name}{escape(report.message)}'


def missing_html(state: ArmState) -> str:
    """Say which nodes do not run and how to start them; empty when all run."""
    missing = [node.name for node in state.nodes if node.stale]
    if not missing:
        return ''
    if len(missing) == len(state.nodes):
        what = 'No node is running.'
    else:
        what = f'Not running: {", ".join(missing)}.'
    return (f'<div style="padding:0.6em 0.8em;border-radius:6px;background:{_css(BAD)};'
            f'color:#fff"><b>{what}</b><br>Start them with {START}.<br>'
            'This page continues by itself when they run.</div>')


def segments_html(state: ArmState, description: Description) -> str:
    """Return a row per segment: stiff or soft, vacuum, bending angle."""
    rows = []
    for s in range(len(description.arm.segments)):
        stiff = state.stiff[s] if s < len(state.stiff) else None
        pressure = state.pressures[s] if s < len(state.pressures) else None
        chip = (_chip('not known', UNKNOWN) if stiff is None else
                _chip('stiff', STIFF) if stiff else _chip('soft', SOFT))
        vacuum = '' if stiff is None or pressure is None else (
            f'{(description.ambient_pressure - pressure) / 1e3:.0f} kPa vacuum')
        angle = '' if state.bending_angles is None else f'{degrees(state.bending_angles[s]):+.1f}°'
        rows.append((f'<b>{s + 1}</b>', chip, vacuum, angle))
    return _table(rows)


def tendons_html(state: ArmState, description: Description) -> str:
    """Return a row per tendon: pull and tension."""
    rows = []
    names = description.arm.tendon_names
    for t, name in enumerate(names):
        tension = state.tensions[t] if state.tensions else None
        if tension is None:
            chip = _chip('not known', UNKNOWN)
        elif isnan(tension):
            chip = _chip('held by stiff segments', LOCKED)
        elif tension == 0.0:
            chip = _chip('slack', SLACK)
        else:
            chip = _chip(f'{tension:.1f} N', tension_colour(tension, description.tension_limit))
        pull = f'{state.pulls[t] * 1e3:+.2f} mm' if state.pulls else ''
        rows.append((f'<b>{name}</b>', pull, chip))
    return _table(rows)


def jog_hint_html(state: ArmState) -> str:
    """Say how tendons are moved, or what it takes."""
    if state.progress is not None:
        return _small('A sequence is running.')
    if False in state.stiff:
        return _small('Pay out one tendon before you pull in the other: tension in both at once '
                      'is refused.')
    return _small('Soften a segment to move the tendons: a stiff arm must not be pulled.')


def sequence_html(state: ArmState) -> str:
    """Say what the sequence does, or how the last one ended."""
    progress = state.progress
    if progress is not None:
        where = f'segment {progress.segment}' if progress.segment else 'whole arm'
        return _small(f'<b>{escape(progress.shape)}</b>: {where}, {escape(progress.phase)}')
    values = state.node(SHAPE_SEQUENCER).values
    last, reason = values.get('last', ''), values.get('reason', '')
    if not last:
        return _small('no sequence yet')
    return _small(f'last: <b>{escape(last)}</b>{": " if reason else ""}{escape(reason)}')


def notices_html(notices: Iterable[Notice]) -> str:
    """Return notices, the newest first."""
    rows = [(f'<small>{notice.clock}</small>',
             f'<b style="color:{_css(BAD if notice.is_problem else GOOD)}">{escape(notice.title)}'
             f'</b><br>{escape(notice.text)}') for notice in notices]
    return _table(rows[::-1]) if rows else _small('nothing yet')


def _table(rows: Iterable[Iterable[str]]) -> str:
    body = ''.join(
        '<tr>' + ''.join(f'<td style="padding:2px 6px 2px 0;vertical-align:top">{cell}</td>'
                         for cell in row) + '</tr>' for row in rows)
    return _small(f'<table style="line-height:1.3;width:100%">{body}</table>')


def _small(html: str) -> str:
    return f'<div style="font-size:0.85em;padding:4px 8px">{html}</div>'


def _chip(text: str, colour: Colour) -> str:
    return (f'<span style="background:{_css(colour)};color:#fff;border-radius:4px;'
            f'padding:1px 6px;font-weight:600;white-space:nowrap">{escape(text)}</span>')


def _css(colour: Colour) -> str:
    return 'rgb({}, {}, {})'.format(*colour)
