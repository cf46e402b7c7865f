# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What the panel says, as small pieces of HTML."""

from collections.abc import Iterable
from html import escape
from math import degrees, isnan

from soft_continuum.browser.state import ArmState, Description, Notice, Report
from soft_continuum.colours import (
    Colour,
    LOCKED,
    SLACK,
    SOFT,
    STIFF,
    tension_colour,
    UNKNOWN,
)
from soft_continuum.nodes.runtime import NODES

GOOD: Colour = (39, 174, 96)
WARNING: Colour = (230, 145, 20)
BAD: Colour = (214, 40, 40)
LEVELS = (('OK', GOOD), ('WARN', WARNING), ('ERROR', BAD))
START = ('<code>./run up</code>&nbsp; or &nbsp;'
         '<code>ros2 launch soft_continuum bringup.launch.py</code>')


def nodes_html(state: ArmState) -> str:
    """Return a row per node: level, words, and for how long it is silent."""
    return _table(_node_row(name, state.reports.get(name), state.hears(name)) for name in NODES)


def _node_row(name: str, report: Report | None, heard: bool) -> tuple[str, str]:
    if report is None:
        return _chip('absent', UNKNOWN), f'<b>{name}</b><br>never heard'
    if not heard:
        # Rounded, or the text would change all the time.
        age = report.age
        since = f'{age:.0f} s' if age < 60 else f'{age / 60:.0f} min'
        return _chip('silent', BAD), f'<b>{name}</b><br>last heard {since} ago'
    label, colour = LEVELS[min(report.level, 2)]
    return _chip(label, colour), (f'<b>{name}</b> <small>heard within 1 s</small><br>'
                                  f'{escape(report.message)}')


def missing_html(state: ArmState) -> str:
    """Say which nodes do not run and how to start them; empty when all run."""
    missing = [name for name in NODES if not state.hears(name)]
    if not missing:
        return ''
    if len(missing) == len(NODES):
        what = 'No node is running.'
    else:
        what = f'Not running: {", ".join(missing)}.'
    return (f'<div style="padding:0.6em 0.8em;border-radius:6px;background:{_css(BAD)};'
            f'color:#fff"><b>{what}</b><br>Start them with {START}.<br>'
            'This page goes on by itself when they come.</div>')


def segments_html(state: ArmState, bending_angles: Iterable[float]) -> str:
    """Return a row per segment: stiff or soft, vacuum, bending angle (rad, nan: not known)."""
    rows = []
    for s, (stiff, vacuum, angle) in enumerate(
            zip(state.flags, state.vacuum, bending_angles, strict=True), start=1):
        chip = (_chip('not known', UNKNOWN) if stiff is None else
                _chip('stiff', STIFF) if stiff else _chip('soft', SOFT))
        is_known = stiff is not None and not isnan(vacuum)
        rows.append((f'<b>{s}</b>', chip, f'{vacuum / 1e3:.0f} kPa vacuum' if is_known else '',
                     '' if isnan(angle) else f'{degrees(angle):+.1f}°'))
    return _table(rows)


def tendons_html(state: ArmState, description: Description) -> str:
    """Return a row per tendon: pull and tension."""
    rows = []
    for name, pull, tension in zip(('right', 'left'), state.pulls, state.tensions, strict=True):
        if not state.hears('kinematics'):
            chip = _chip('not known', UNKNOWN)
        elif isnan(tension):
            chip = _chip('held by stiff segments', LOCKED)
        elif tension == 0.0:
            chip = _chip('slack', SLACK)
        else:
            chip = _chip(f'{tension:.1f} N', tension_colour(tension, description.tension_limit))
        is_known = state.hears('tendon_actuation') and not isnan(pull)
        millimetres = f'{pull * 1e3:+.2f} mm' if is_known else ''
        rows.append((f'<b>{name}</b>', millimetres, chip))
    return _table(rows)


def jog_hint_html(state: ArmState) -> str:
    """Say how tendons are moved, or what it takes."""
    if state.running is not None:
        return _small('A sequence is running.')
    if state.soft:
        return _small('Let one tendon out before the other is pulled: both at once are refused.')
    return _small('Soften a segment to move the tendons: a stiff arm must not be pulled.')


def sequence_html(state: ArmState) -> str:
    """Say what the sequence does, or how the last one ended."""
    running = state.running
    if running is not None:
        where = f'segment {running.segment}' if running.segment else 'whole arm'
        return _small(f'<b>{escape(running.shape)}</b>: {where}, {escape(running.phase)}')
    last = state.value('shape_sequencer', 'last')
    if not last:
        return _small('no sequence yet')
    reason = state.value('shape_sequencer', 'reason')
    return _small(f'last: <b>{escape(last)}</b>{": " if reason else ""}{escape(reason)}')


def notices_html(notices: Iterable[Notice]) -> str:
    """Return what there was to be read, the newest first."""
    rows = [(f'<small>{notice.clock}</small>',
             f'<b style="color:{_css(BAD if notice.refused else GOOD)}">{escape(notice.title)}'
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
