# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The readings of the panel as HTML fragments, and charts of their last minute."""

from collections import deque
from collections.abc import Iterable, Sequence
from html import escape
from itertools import groupby
from math import degrees, isfinite, isnan, nan, radians

from soft_continuum.client.estimate import (
    age_text,
    anomaly_text,
    Estimate,
    LearnedParameter,
    millimetres,
    parameter_text,
)
from soft_continuum.client.state import ArmState, NodeReport, Pose, progress_text
from soft_continuum.colours import (
    Colour,
    GHOST,
    LOCKED,
    MEASURED,
    MODEL,
    PREDICTED,
    SOFT,
    STIFF,
    tension_colour,
    TENSIONS,
    UNKNOWN,
    WRONG,
)
from soft_continuum.ros.names import SHAPE_SEQUENCER
from soft_continuum.ui.browser.session import Description, Notice, notice_text
from soft_continuum.ui.browser.tip_planning import Planned
from soft_continuum_interfaces.msg import RecorderState, TeleopState

WARNING: Colour = (255, 222, 89)
PLAIN: Colour = (255, 255, 255)
LEVELS = {'ok': PLAIN, 'warn': WARNING, 'error': WRONG}
DARK_TEXT = (PLAIN, WARNING, TENSIONS[0], SOFT, GHOST)
MAX_ROWS, MAX_ALARM_ROWS = 30, 10  # of received texts
TELLING_ANGLE = radians(0.5)  # from which on a bending has a direction worth a word
FEW_TENDONS = 3  # up to so many have a curve below their numbers, more beside them
VACUUM_END = 100.0  # kPa, where its axis ends
LENGTH = 301  # samples, one every 0.2 s: a minute
HEIGHT = 24  # px
ERROR_ENDS = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0)  # mm or degrees
AXIS_ENDS = (10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0)  # possible ends of an axis


# Charts.


class History:
    """
    Samples of a minute, the oldest first; nan where one is missing.

    vacuum: kPa.  tensions: N.  prediction: mm between the measured tip and the open-loop
    prediction.  error: of the shape being set, mm, or degrees while error_is_angle.
    """

    def __init__(self, segments: int, tendons: int, ambient_pressure: float) -> None:
        """Start empty; ambient_pressure: Pa."""
        self._ambient = ambient_pressure
        self.vacuum, self.tensions = (
            tuple(deque([nan] * LENGTH, maxlen=LENGTH) for _ in range(count))
            for count in (segments, tendons))
        self.prediction, self.error = (deque([nan] * LENGTH, maxlen=LENGTH) for _ in range(2))
        self.error_is_angle = True

    def sample(self, state: ArmState) -> None:
        """Take a sample, one every 0.2 s."""
        vacuum = [None if p is None else (self._ambient - p) * 1e-3 for p in state.pressures]
        _append(self.vacuum, vacuum)
        _append(self.tensions, state.tensions or ())
        estimate, progress = state.estimate, state.progress
        off = estimate.predicted_tip_error if estimate and estimate.measured else None
        error = progress.error if progress and progress.aim else None
        if error is not None and progress is not None:
            is_angle = progress.aim != 'tip'
            if is_angle is not self.error_is_angle:  # one axis has one unit
                self.error.extend([nan] * LENGTH)
                self.error_is_angle = is_angle
            error = degrees(error) if is_angle else 1e3 * error
        _append((self.prediction, self.error), (None if off is None else 1e3 * off, error))


def _append(series: Sequence[deque[float]], values: Sequence[float | None]) -> None:
    known = len(values) == len(series)
    for i, one in enumerate(series):
        value = values[i] if known else None
        one.append(nan if value is None or not isfinite(value) else value)


def axis_end(series: Iterable[Iterable[float]], ends: Sequence[float] = AXIS_ENDS) -> float:
    """Return the smallest of ``ends`` for an axis from 0 that fits all samples."""
    largest = max((v for one in series for v in one if isfinite(v)), default=0.0)
    return next((end for end in ends if end >= largest), ends[-1])


def chart(samples: Sequence[float], top: float, colour: Colour) -> str:
    """Return samples as an SVG, from 0 to ``top``; gaps (nan) are grey."""
    lines, gaps, start = [], [], 0
    for known, group in groupby(samples, isfinite):
        values = list(group)
        if known:
            lines.append('M' + 'L'.join(_corners(start, values, top)))
        else:
            gaps.append(f'M{start - 1} 0h{len(values) + 1}v{HEIGHT}h-{len(values) + 1}z')
        start += len(values)
    return (
        f'<svg viewBox="0 0 {LENGTH - 1} {HEIGHT}" preserveAspectRatio="none" width="100%" '
        f'height="{HEIGHT}" style="display:block;border-bottom:1px solid #99a">'
        f'<path class="gap" d="{"".join(gaps)}" fill="rgb{UNKNOWN}" fill-opacity="0.45"/>'
        f'<path class="line" d="{"".join(lines)}" fill="none" stroke="rgb{colour}" '
        'stroke-width="1.6" vector-effect="non-scaling-stroke"/></svg>')


def _corners(start: int, values: Sequence[float], top: float) -> list[str]:
    """Return the points of a line, without those between two points of equal height."""
    heights = [round(HEIGHT - 1 - (HEIGHT - 2) * min(1.0, max(0.0, v / top)), 1) for v in values]
    last = len(heights) - 1
    points = [f'{start + i} {y:g}' for i, y in enumerate(heights)
              if i in (0, last) or not heights[i - 1] == y == heights[i + 1]]
    return points if last else [points[0], f'{start + 0.5} {heights[0]:g}']


# Readings.


def nodes_html(state: ArmState) -> str:
    """Return a row for each node: level and message of its status, or its age if stale."""
    return _table(_node_row(report) for report in (*state.nodes, *state.sensors))


def _node_row(report: NodeReport) -> tuple[str, str]:
    name = f'<b>{report.name}</b><br>'
    if report.age is None:
        return _chip('absent', UNKNOWN), f'{name}nothing received yet'
    if report.stale:
        # Rounded, or the text would change all the time.
        age = f'{report.age:.0f} s' if report.age < 60 else f'{report.age / 60:.0f} min'
        return _chip('stale', WRONG), f'{name}last message {age} ago'
    level = report.level or 'ok'
    return _chip(level.upper(), LEVELS[level]), name + _text(report.message)


def recording_html(state: RecorderState | None) -> str:
    """Return the state of the recording and its file, or how to start the recorder."""
    if state is None:
        return _table([(_chip('absent', UNKNOWN), 'to record, start: '
                        '<code>ros2 run soft_continuum recorder</code>')])
    if state.problem:
        return _table([(_chip('ERROR', WRONG), _text(state.problem))])
    if not state.recording:
        return _small(_text(f'last: {state.file}' if state.file else 'nothing yet'))
    lost = f', {state.lost} lost' if state.lost else ''
    text = f'{state.messages} messages{lost}, in {state.file}'
    return _table([(_chip('REC', WRONG), _text(text))])


def steering_html(state: TeleopState | None) -> str:
    """Return what a joystick or keyboard steers, or how to connect one."""
    if state is None:
        return _table([(_chip('absent', UNKNOWN), 'to steer with a keyboard, type in a terminal: '
                        '<code>soft_continuum teleop</code>')])
    chip = (_chip('no joystick', UNKNOWN) if not state.connected else
            _chip('HELD', SOFT) if state.enabled else _chip('released', PLAIN))
    what = 'tip, with segment' if state.mode == TeleopState.TIP else 'segment'
    chosen = f'{what} <b>{state.segment}</b>' if state.segment else 'no segment chosen'
    return _table([(chip, chosen), (_text(state.message),)])


def segments_html(state: ArmState, description: Description, history: History) -> str:
    """Return a row for each segment: stiff or soft, vacuum, bending angle, vacuum chart."""
    rows: list[tuple[str, ...]] = []
    count = len(description.arm.segments)
    for s in range(count):
        bends = _bending(state, s) if len(state.bending_angles or ()) == count else ''
        if not description.jamming:
            rows.append((f'<b>{s + 1}</b>', bends))
            continue
        stiff = state.stiff[s] if s < len(state.stiff) else None
        pressure = state.pressures[s] if s < len(state.pressures) else None
        chip = (_chip('not known', UNKNOWN) if stiff is None else
                _chip('stiff', STIFF) if stiff else _chip('soft', SOFT))
        vacuum = '' if pressure is None else _number(
            (description.ambient_pressure - pressure) / 1e3, '.0f', ' kPa vacuum')
        rows += [(f'<b>{s + 1}</b>', chip, vacuum, bends),
                 (chart(history.vacuum[s], VACUUM_END, STIFF),)]
    captions = [] if description.jamming else ['without jamming: always soft']
    if any(description.directed):
        captions.append('bending angle @ direction: about z, from x to y of the disc below')
    if description.jamming:
        captions.append(f'vacuum of the last minute, 0 to {VACUUM_END:g} kPa')
    return _table(rows) + caption('; '.join(captions))


def _bending(state: ArmState, segment: int) -> str:
    """Return bending angle, standard deviation and direction of a segment (from 0)."""
    angles, directions = state.bending_angles or (), state.bending_directions
    estimate = state.estimate
    stddevs = estimate.angle_stddevs if estimate and estimate.measured else ()
    each = len(stddevs) // len(angles)  # in space about x and y
    angle = angles[segment]
    text = _number(degrees(angle), '.1f' if directions else '+.1f', '°')
    if each * len(angles) == len(stddevs) > 0:
        stddev = max(stddevs[each * segment:each * (segment + 1)])
        text += f' ±{_number(degrees(stddev), ".1f", "°")}'
    if directions and angle >= TELLING_ANGLE:
        text += f' @ {_number(degrees(directions[segment]), "z.0f", "°")}'
    return text


def tendons_html(state: ArmState, description: Description, history: History) -> str:
    """Return a row for each tendon: pull, tension, tension chart."""
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
        pull = _number(pulls[t] * 1e3, '+.2f', '&nbsp;mm') if len(pulls) == len(names) else ''
        cells = f'<b>{_text(name)}</b>', chip, pull
        curve = chart(history.tensions[t], end, TENSIONS[1])
        rows += [(*cells, curve)] if len(names) > FEW_TENDONS else [cells, (curve,)]
    return _table(rows) + caption(f'tension of the last minute, 0 to {end:g} N')


def positions_html(state: ArmState, axes: str) -> str:
    """
    Return the modelled tip, and a row for each measured disc with its model error.

    axes: names of those along which the arm moves.
    """
    measured = state.estimate is not None and state.estimate.measured
    rows = [('<b>tip</b>', *_position(state.tip, axes),
             'measured' if measured else 'by the model')]
    for n, (seen, error) in enumerate(zip(state.measured_discs, state.disc_errors, strict=True)):
        off = '' if error is None else ', '.join(
            text for value, text in zip(error, (
                _number(error[0] * 1e3, '.1f', '&nbsp;mm'),
                _number(degrees(error[1]), '+.1f', '°')), strict=True) if isfinite(value))
        rows.append((f'disc&nbsp;{n}', *_position(seen, axes), off or 'not seen'))
    return _table(rows) + caption(f'{" and ".join([", ".join(axes[:-1]), axes[-1]])} in mm; ' + (
        'measured discs, and their distance from the model'
        if state.measured_discs else 'no sensor measures the discs'))


def source_html(state: ArmState, history: History) -> str:
    """Return source and accuracy of the shape, the prediction error, and alarms."""
    estimate = state.estimate
    if estimate is None:
        return _small('no report from kinematics')
    rows = [(_chip(' ALARM ', WRONG), _text(anomaly_text(anomaly)))
            for anomaly in estimate.anomalies[:MAX_ALARM_ROWS]]
    if not estimate.measured:
        rows.append((_chip('PREDICTED', UNKNOWN),
                     f'the model alone; {age_text(estimate.age)}'))
        return _table(rows)
    chip = _chip('ESTIMATED', MEASURED) if estimate.fresh else _chip('PREDICTED', UNKNOWN)
    rows.append((chip, f'{age_text(estimate.age)}{_within(estimate)}'))
    off = estimate.predicted_tip_error
    if off is not None:
        rows.append((_chip('PREDICTED', PREDICTED),
                     f'tip <b>{millimetres(off)} mm</b> from the estimate'))
    return _table(rows) + caption(
        f'drawn solid: the estimate; <b style="color:{_css(PREDICTED)}">brown outline</b>: what '
        'the model alone predicts') + _plot(
            'prediction from estimate, tip', 'mm', history.prediction, PREDICTED)


def error_html(history: History) -> str:
    """Return the chart of the measured error of the shape that was being set, if any."""
    if not any(map(isfinite, history.error)):
        return ''
    unit = 'degrees' if history.error_is_angle else 'mm'
    what = 'measured error of the worst angle' if history.error_is_angle else (
        'measured error of the tip')
    return _plot(what, unit, history.error, GHOST)


def _plot(what: str, unit: str, samples: Sequence[float], colour: Colour) -> str:
    end = axis_end((samples,), ERROR_ENDS)
    return _small(chart(samples, end, colour)) + caption(
        f'{what}: last minute, 0 to {end:g} {unit}')


def _within(estimate: Estimate) -> str:
    stddev = estimate.tip_stddev
    return '' if stddev is None else f'; tip ±{millimetres(stddev)} mm'


def parameters_html(estimate: Estimate | None) -> str:
    """Return a row for each estimated parameter: value and deviation, or not determined."""
    if estimate is None or not estimate.parameters:
        return _small('nothing is estimated without a sensor that measures the discs')
    rows = []
    for parameter in estimate.parameters[:MAX_ROWS]:
        rows += _parameter_rows(parameter)
    return _table(rows) + caption(
        'stiffness factor: soft segment, relative to the described one; K: stiff over soft; '
        'offset: pulled in beyond the motor position; ± one standard deviation. '
        '<code>soft_continuum save-estimate</code> saves the determined ones')


def _parameter_rows(parameter: LearnedParameter) -> list[tuple[str, ...]]:
    text = parameter_text(parameter)
    value = (f'<b>{_text(text.value)}</b>&nbsp;±&nbsp;{_text(text.stddev)}&nbsp;{text.unit}'
             if parameter.determined else
             '<span style="color:#667">not&nbsp;determined</span>')
    rows: list[tuple[str, ...]] = [(_text(text.label), value)]
    if parameter.problem:
        rows.append((f'{_chip("not plausible", WARNING)} {_text(parameter.problem)}',))
    return rows


def picture_html(address: str) -> str:
    """Return an image with its legend; empty without an address."""
    if not address:
        return ''
    return _small(f'<img src="{address}" style="width:100%;display:block" '
                  'alt="The arm as the camera sees it">') + caption(
        f'camera image with <b style="color:{_css(MEASURED)}">tags</b> and <b '
        f'style="color:{_css(MODEL)}">model</b>')


def _position(pose: Pose | None, axes: Sequence[str]) -> tuple[str, ...]:
    return tuple('?' if pose is None else
                 f'{axis}&nbsp;{_number(pose.position["xyz".index(axis)] * 1e3, "+.1f", "")}'
                 for axis in axes)


def jog_hint_html(state: ArmState, description: Description) -> str:
    """Explain how to move tendons, or what is needed first."""
    if state.stopped:
        return _small('Stopped: press Resume first.')
    if state.progress is not None:
        return _small('A sequence is running.')
    if False in state.stiff or not description.jamming:
        return _small(
            'In mm. Pay out the tendons on the other side before you pull one in: tension in all '
            'of them at once is refused.' if len(description.arm.tendon_names) > 2 else
            'In mm. Pay out one tendon before you pull in the other: tension in both at '
            'once is refused.')
    return _small('Soften a segment to move the tendons: a stiff arm must not be pulled.')


def own_shape_html(description: Description) -> str:
    """Explain the sliders of a shape."""
    return caption(
        'Degrees. ' + (
            'Direction: about z, from x (0) to y (90) of the disc below, as drawn at the '
            'base. ' if any(description.directed) else '')
        + 'The shape is shown in green for ten seconds after a change.')


def sequence_html(state: ArmState) -> str:
    """Show the progress of the sequence, or the result of the last one."""
    if state.progress is not None:
        return _small(f'<b>{_text(state.progress.shape)}</b>, '
                      f'{_text(progress_text(state.progress))}')
    if all(node.name != SHAPE_SEQUENCER for node in state.nodes):
        return _small('Without jamming two tendons cannot set shapes: jog them.')
    last = state.last_result
    if last is None:
        return _small('no sequence yet')
    return _small(f'last: <b>{_text(last.outcome)}</b>{": " if last.message else ""}'
                  f'{_text(last.message)}')


def plan_html(planned: Planned | None, late: bool) -> str:
    """Show whether and how the tip reaches its goal; late: the newest answer is overdue."""
    if planned is None:
        return _status(_table([(_chip('PLANNING', UNKNOWN), '')]))
    plan = planned.plan
    chip = (_chip('PLANNING', UNKNOWN) if late else _chip('NO ANSWER', WARNING) if plan is None
            else _chip('REACHABLE', GHOST) if plan.found
            else _chip('NO PLAN YET', UNKNOWN) if planned.quick else _chip('NO PLAN', WARNING))
    rows: list[tuple[str, ...]] = [(chip, _text(planned.problem))]
    if plan is not None and plan.found and not plan.steps:
        rows.append(('the tip is there',))
    if plan is not None and plan.steps:
        lines = [] if plan.found else ['<b>nearest reachable:</b>']
        off = plan.tip_errors[-1] if plan.tip_errors else 0.0
        lines += [f'tip <b>{_number(1e3 * off, ".1f", " mm")}</b> from its goal',
                  f'softenings: <b>{plan.softenings}</b>' if plan.steps[0].segment else
                  f'motions: <b>{plan.softenings}</b>',
                  f'tension up to <b>{_number(plan.tension, ".1f", " N")}</b>',
                  f'<b>{_number(plan.duration, ".0f", " s")}</b> of motion']
        nearest = min(plan.steps, key=lambda step: step.clearance)
        if isfinite(nearest.clearance):
            lines.append(f'<b>{_number(1e3 * nearest.clearance, ".0f", " mm")}</b> from '
                         f'{_text(nearest.obstacle)}')
        rows.append(('<br>'.join(lines),))
    return _status(_table(rows))


def notices_html(notices: Iterable[Notice]) -> str:
    """Return notices, the newest first."""
    red = f' style="color:{_css(WRONG)}"'
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


def _status(html: str) -> str:
    """Let a screen reader announce changes."""
    return f'<div role="status">{html}</div>'


def _text(text: str) -> str:
    return escape(notice_text(text))


def caption(html: str) -> str:
    """Return a line in small grey letters."""
    return f'<div style="font-size:0.75em;padding:0 8px 4px;color:#667">{html}</div>'


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
