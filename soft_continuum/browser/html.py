# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The readings of the panel, as small pieces of HTML."""

from collections.abc import Iterable
from html import escape
from math import degrees, isfinite, isnan

from soft_continuum.browser.charts import axis_end, chart, History
from soft_continuum.browser.session import Description, Notice
from soft_continuum.browser.words import plain
from soft_continuum.client.state import ArmState, NodeReport, Pose
from soft_continuum.colours import (
    Colour,
    LOCKED,
    SOFT,
    STIFF,
    tension_colour,
    TENSIONS,
    UNKNOWN,
)

WARNING: Colour = (255, 222, 89)
BAD: Colour = (214, 40, 40)
PLAIN: Colour = (255, 255, 255)
LEVELS = {'ok': PLAIN, 'warn': WARNING, 'error': BAD}
DARK_TEXT = (PLAIN, WARNING, TENSIONS[0], SOFT)
VACUUM_END = 100.0  # kPa, where its axis ends


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
    return _chip(level.upper(), LEVELS[level]), name + _text(report.message)


def segments_html(state: ArmState, description: Description, history: History) -> str:
    """Return a row per segment: stiff or soft, vacuum, bending angle, vacuum of last minute."""
    rows: list[tuple[str, ...]] = []
    count = len(description.arm.segments)
    angles = state.bending_angles or ()
    for s in range(count):
        stiff = state.stiff[s] if s < len(state.stiff) else None
        pressure = state.pressures[s] if s < len(state.pressures) else None
        chip = (_chip('not known', UNKNOWN) if stiff is None else
                _chip('stiff', STIFF) if stiff else _chip('soft', SOFT))
        vacuum = '' if pressure is None else _number(
            (description.ambient_pressure - pressure) / 1e3, '.0f', ' kPa vacuum')
        angle = _number(degrees(angles[s]), '+.1f', '°') if len(angles) == count else ''
        rows += [(f'<b>{s + 1}</b>', chip, vacuum, angle),
                 (chart(history.vacuum[s], VACUUM_END, STIFF),)]
    return _table(rows) + _caption(f'vacuum of the last minute, 0 to {VACUUM_END:g} kPa')


def tendons_html(state: ArmState, description: Description, history: History) -> str:
    """Return a row per tendon: pull, tension, tension of the last minute."""
    rows: list[tuple[str, ...]] = []
    names = description.arm.tendon_names
    end = axis_end(history.tensions)
    tensions, pulls = state.tensions or (), state.pulls or ()
    for t, name in enumerate(names):
        tension = tensions[t] if len(tensions) == len(names) else None
        if tension is None:
            chip = _chip('not known', UNKNOWN)
        elif isnan(tension):
            chip = _chip('held', LOCKED)
        else:
            chip = _chip('slack' if tension == 0.0 else _number(tension, '.1f', ' N'),
                         tension_colour(tension, description.tension_limit))
        pull = _number(pulls[t] * 1e3, '+.2f', ' mm') if len(pulls) == len(names) else ''
        rows += [(f'<b>{_text(name)}</b>', chip, pull),
                 (chart(history.tensions[t], end, TENSIONS[1]),)]
    return _table(rows) + _caption(f'tension of the last minute, 0 to {end:g} N')


def positions_html(state: ArmState) -> str:
    """Return the tip by the model, and a row per disc that is measured: how far it is off."""
    rows = [('<b>tip</b>', *_position(state.tip), 'by the model')]
    for n, (seen, error) in enumerate(zip(state.measured_discs, state.disc_errors, strict=True)):
        off = '' if error is None else (_number(error[0] * 1e3, '.1f', '&nbsp;mm, ')
                                        + _number(degrees(error[1]), '+.1f', '°'))
        rows.append((f'disc&nbsp;{n}', *_position(seen), off or 'not seen'))
    return _table(rows) + _caption(
        'x and z in mm; discs as they are seen, and how far from the model'
        if state.measured_discs else 'x and z in mm; no sensor measures the discs')


def _position(pose: Pose | None) -> tuple[str, str]:
    return ('?', '?') if pose is None else (
        f'x&nbsp;{_number(pose.x * 1e3, "+.1f", "")}',
        f'z&nbsp;{_number(pose.z * 1e3, "+.1f", "")}')


def jog_hint_html(state: ArmState) -> str:
    """Say how tendons are moved, or what it takes."""
    if state.stopped:
        return _small('Stopped: press Resume first.')
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
        return _small(f'<b>{_text(progress.shape)}</b>: {where}, {_text(progress.phase)}')
    last = state.last_result
    if last is None:
        return _small('no sequence yet')
    return _small(f'last: <b>{_text(last.outcome)}</b>{": " if last.message else ""}'
                  f'{_text(last.message)}')


def notices_html(notices: Iterable[Notice]) -> str:
    """Return notices, the newest first."""
    red = f' style="color:{_css(BAD)}"'
    rows = [(f'<small>{notice.clock}</small>',
             f'<b{red if notice.is_problem else ""}>{escape(notice.title)}</b><br>'
             f'{escape(notice.text)}{notice.times}') for notice in notices]
    return _table(rows[::-1]) if rows else _small('nothing yet')


def _table(rows: Iterable[tuple[str, ...]]) -> str:
    """Return a table; a row of one cell takes the whole width."""
    body = ''.join(
        '<tr>' + ''.join(
            f'<td{" colspan=4" if len(row) == 1 else ""} '
            f'style="padding:2px 6px 2px 0;vertical-align:top">{cell}</td>' for cell in row)
        + '</tr>' for row in rows)
    return _small(f'<table style="line-height:1.3;width:100%">{body}</table>')


def _number(value: float, form: str, unit: str) -> str:
    return f'{value:{form}}{unit}' if isfinite(value) and abs(value) < 1e6 else '?'


def _text(text: str) -> str:
    return escape(plain(text))


def _caption(text: str) -> str:
    return f'<div style="font-size:0.75em;padding:0 8px 4px;color:#667">{text}</div>'


def _small(html: str) -> str:
    return (f'<div style="font-size:0.85em;padding:4px 8px;overflow-wrap:break-word">{html}</div>')


def _chip(text: str, colour: Colour) -> str:
    ink = '#223' if colour in DARK_TEXT else '#fff'
    edge = '#99a' if colour == PLAIN else _css(colour)
    return (f'<span style="background:{_css(colour)};color:{ink};border:1px solid {edge};'
            'border-radius:4px;padding:0 6px;font-weight:600;white-space:nowrap">'
            f'{escape(text)}</span>')


def _css(colour: Colour) -> str:
    return 'rgb({}, {}, {})'.format(*colour)
