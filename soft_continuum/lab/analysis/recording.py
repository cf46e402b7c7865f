# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
A recorded run as tables: one per kind of message, which CSV files keep.

Times are from the start of the recording.  Lengths are in mm, tensions in N, absolute pressures in
kPa, orientations are quaternions: tables are for people and spreadsheets.
"""

from array import array
from collections import defaultdict
from collections.abc import Sequence
import csv
from dataclasses import dataclass, field
import io
from math import inf, isnan, nan
from pathlib import Path
import re
from typing import Any

import numpy as np

from soft_continuum.lab.analysis.delimited import Array, MeasurementError
from soft_continuum.lab.analysis.results import write_rows
from soft_continuum.lab.recordings.bag import BagError, BagReader
from soft_continuum.text import MAX_NAME, printable, read_bytes

PULL, TENSION = ' pull [mm]', ' tension [N]'  # after the name of a tendon
POSE = ('x [mm]', 'y [mm]', 'z [mm]', 'qx', 'qy', 'qz', 'qw')
PLANAR_POSE = ('x [mm]', 'z [mm]', 'tangent [deg]')  # as version 0.1 wrote it
COLUMNS = {
    'points': ('time [s]', 'point', *POSE),
    'pressures': ('time [s]', 'segment', 'pressure [kPa]'),
    'stiff': ('time [s]', 'segment', 'stiff'),
    'events': ('time [s]', 'source', 'event'),
}
"""Columns by file, without suffix, of the files that are the same for every arm."""

TABLES = ('tendons', 'tensions', *COLUMNS)
"""The tables of a recording."""
FILES = tuple(f'{name}.csv' for name in TABLES)

DESCRIPTION = 'description.yaml'
"""Parameter file of the recorded arm."""
ABOUT = 'recording'  # source of the event that says when, what and by which version

BAG = 'recording.mcap'
"""The file that ``record`` writes into its directory."""

MAX_SIZE = 32_000_000  # bytes of a file, about an hour
MAX_ROWS = 600_000  # of a file, in an hour there are 180,000 of the tendons
MAX_COLUMNS = 100
MAX_VALUE = 1e9
COUNTED = (('segment',), ('point',))  # second columns of whole numbers
HOLDING_DELAY = 0.2  # s, by which poses and pulls may come after the event that they belong to
TOPICS = {
    'tendon_states': 'sensor_msgs/msg/JointState',
    'tendon_tensions': 'sensor_msgs/msg/JointState',
    'disc_poses': 'geometry_msgs/msg/PoseArray',
    'jamming_valves/state': 'soft_continuum_interfaces/msg/JammingValvesState',
    'shape_sequencer/state': 'soft_continuum_interfaces/msg/ShapeSequencerState',
    **{f'{node}/status': 'diagnostic_msgs/msg/DiagnosticStatus' for node in (
        'tendon_actuation', 'jamming_valves', 'kinematics', 'shape_sequencer', 'camera',
        'disc_sensors')},
}
"""Types of the topics that are read; topics of other types are ignored."""
PRESSURE = 'sensor_msgs/msg/FluidPressure'  # of segment_N/pressure
TOPIC = re.compile(rf'(.*/)({"|".join(TOPICS)}|segment_[1-9]\d?/pressure)')
NOT_STIFF, STIFF = 1, 2  # of soft_continuum_interfaces/msg/JammingValvesState
SUCCESSFUL = 0  # of soft_continuum_interfaces/action/RunShapeSequence
MAX_TENDONS = MAX_POINTS = 100
MAX_NUMBERS = 100_000_000  # of all tables: some hours


@dataclass(frozen=True)
class HeldShape:
    """
    A shape that was held.

    shape: its name.  time: s, when holding began.  points: (k, 7), position x, y, z in mm and
    quaternion x, y, z, w of the calculation points.  pulls: (tendons,) mm.
    """

    shape: str
    time: float
    points: Array
    pulls: Array

    @property
    def tangents(self) -> Array:
        """Return the angles (k,) of the tangents from z towards x, degrees."""
        x, y, z, w = self.points[:, 3:].T
        angles: Array = np.degrees(np.arctan2(2.0 * (x * z + w * y), 1.0 - 2.0 * (x * x + y * y)))
        return angles


@dataclass(frozen=True)
class Recording:
    """
    A recording.

    tendon_names: in the order of the columns.  tendons, tensions: (rows, 1 + tendons), time in s
    and mm or N.  points: (rows, 9), time, number of the point, and pose as in HeldShape.
    pressures, stiff: (rows, 3), time, number of the segment, and kPa, or 1 for stiff.  events:
    (time, source, text).  description: the arm as a parameter file, empty if unknown.  damage: why
    data may be missing; empty if complete.
    """

    tendon_names: tuple[str, ...]
    tendons: Array
    tensions: Array
    points: Array
    pressures: Array
    stiff: Array
    events: list[tuple[float, str, str]] = field(default_factory=list)
    description: str = ''
    damage: str = ''

    def held_shapes(self) -> list[HeldShape]:
        """Return every held shape at the start of its holding."""
        found = []
        for time, source, text in self.events:
            shape, _, phase = text.partition(': ')
            if source != 'progress' or not phase.startswith('holding'):
                continue
            points, pulls = (int(np.searchsorted(rows[:, 0], time + HOLDING_DELAY, 'right'))
                             for rows in (self.points, self.tendons))
            if points and pulls:
                first = np.searchsorted(self.points[:, 0], self.points[points - 1, 0])
                found.append(HeldShape(shape, time, self.points[first:points, 2:],
                                       self.tendons[pulls - 1, 1:]))
        return found

    @property
    def about(self) -> str:
        """Date, namespace and version of the recording; '' if unknown."""
        return next((text for _, source, text in self.events if source == ABOUT), '')


def recorded_tables(recording: Recording
                    ) -> dict[str, tuple[tuple[str, ...], list[Sequence[object]]]]:
    """Return the columns and the rows of every table by name, as in CSV files."""
    named = {'tendons': ('time [s]', *(name + PULL for name in recording.tendon_names)),
             'tensions': ('time [s]', *(name + TENSION for name in recording.tendon_names)),
             **COLUMNS}
    return {name: (header, [_counted(row) for row in getattr(recording, name).tolist()]
                   if header[1:2] in COUNTED else list(getattr(recording, name)))
            for name, header in named.items()}


def _counted(row: list[float]) -> list[object]:
    """Return a row whose second number, that of a point or segment, is a whole one."""
    return [row[0], int(row[1]), *row[2:]]


def write_tables(recording: Recording, paths: Sequence[Path]) -> None:
    """Write the tables into CSV files of the names in FILES; raises OSError."""
    for path, (header, rows) in zip(paths, recorded_tables(recording).values(), strict=True):
        write_rows(path, [header, *(
            [f'{time:.4f}', *(f'{v:.6g}' if isinstance(v, float) else v for v in values)]
            for time, *values in rows)])


def read_tables(directory: Path) -> Recording:
    """
    Read tables of write_tables, and of ``record`` in version 0.1.

    Raises MeasurementError naming file and line.
    """
    names, tendons = _tendons(directory / 'tendons.csv', PULL)
    same, tensions = _tendons(directory / 'tensions.csv', TENSION)
    if same != names:
        raise MeasurementError(f'{directory / "tensions.csv"}: line 1 has the tendons '
                               f'{", ".join(same)} instead of {", ".join(names)}')
    path, described = directory / 'events.csv', directory / DESCRIPTION
    events = [(_number(path, line, row[0]), printable(row[1], MAX_NAME), printable(row[2]))
              for line, row in _rows(path, COLUMNS['events'])[1]]
    try:
        description = read_bytes(described, MAX_SIZE).decode('utf-8', 'replace')
    except FileNotFoundError:
        description = ''
    except OSError as error:
        raise MeasurementError(f'{described}: {error.strerror}') from None
    return Recording(
        names, tendons, tensions, _points(directory / 'points.csv'),
        _numbers(directory / 'pressures.csv', COLUMNS['pressures'])[1],
        _numbers(directory / 'stiff.csv', COLUMNS['stiff'])[1], events, description)


def _tendons(path: Path, ending: str) -> tuple[tuple[str, ...], Array]:
    """Return the names of the tendons and the rows of their values."""
    header, rows = _numbers(path)
    if len(header) > MAX_COLUMNS:
        raise MeasurementError(f'{path}: line 1 has {len(header)} columns; at most {MAX_COLUMNS} '
                               'are read')
    names = tuple(printable(column.removesuffix(ending), MAX_NAME) for column in header[1:])
    if header != ('time [s]', *(name + ending for name in names)) or not names:
        raise MeasurementError(f'{path}: line 1 must be: time [s], then TENDON{ending} for each '
                               'tendon')
    return names, rows


def _points(path: Path) -> Array:
    header, rows = _numbers(path, COLUMNS['points'], ('time [s]', 'point', *PLANAR_POSE))
    if header == COLUMNS['points']:
        return rows
    poses = np.zeros((len(rows), 9))
    poses[:, [0, 1, 2, 4]] = rows[:, :4]
    half = np.radians(rows[:, 4]) / 2.0
    poses[:, 6], poses[:, 8] = np.sin(half), np.cos(half)
    return poses


def _rows(path: Path, *allowed: tuple[str, ...]
          ) -> tuple[tuple[str, ...], list[tuple[int, list[str]]]]:
    """Return the header, one of ``allowed`` if given, and the rows below it with their lines."""
    rows: list[tuple[int, list[str]]] = []
    try:
        text = read_bytes(path, MAX_SIZE).decode('utf-8')
        lines = enumerate(csv.reader(io.StringIO(text, newline='')), start=1)
        header = tuple(next(lines, (1, list[str]()))[1])
        if not header or (allowed and header not in allowed):
            expected = ','.join(allowed[0]) if allowed else 'the names of the columns'
            raise MeasurementError(f'{path}: line 1 must be: {expected}')
        for line, row in lines:
            if line > MAX_ROWS:
                raise MeasurementError(f'{path}: more than {MAX_ROWS} lines; divide the recording')
            if len(row) == len(header):
                rows.append((line, row))
            elif next(lines, None):  # else a killed recorder had not ended it
                raise MeasurementError(f'{path}: line {line} has {len(row)} fields instead of '
                                       f'{len(header)}; repair or remove it')
    except OSError as error:
        raise MeasurementError(f'{path}: {error.strerror}; give the directory that the command '
                               'record has written') from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise MeasurementError(f'{path}: not a recording: {error}') from None
    return header, rows


def _numbers(path: Path, *allowed: tuple[str, ...]) -> tuple[tuple[str, ...], Array]:
    header, rows = _rows(path, *allowed)
    counted = header[1:2] in COUNTED
    numbers = [[_number(path, line, text, counts=counted and column == 1, gap=column > 0)
                for column, text in enumerate(row)] for line, row in rows]
    values = np.array(numbers, dtype=float).reshape(len(rows), len(header))
    back = np.flatnonzero(np.diff(values[:, 0]) < 0.0)
    if back.size:
        raise MeasurementError(f'{path}: line {rows[back[0] + 1][0]}: the time steps back; put '
                               'the lines in order')
    return header, values


def _number(path: Path, line: int, text: str, counts: bool = False, gap: bool = False) -> float:
    """Return a number; counts: of a segment or point, gap: may be nan, where nothing is known."""
    try:
        value = float(text)
    except ValueError:
        value = inf
    if counts and value not in range(1, MAX_COLUMNS + 1) or not (
            abs(value) <= MAX_VALUE or (gap and isnan(value))):
        raise MeasurementError(
            f'{path}: line {line}: {text[:MAX_NAME]!r} is not '
            + (f'a whole number from 1 to {MAX_COLUMNS}' if counts else 'a number')
            + '; repair or remove the line')
    return value


def read_recording(path: Path, namespace: str = '') -> Recording:
    """
    Read a recording: an MCAP file, a directory with one, or a directory of tables.

    namespace: of the arm, if several were recorded; / for none.  Raises MeasurementError.
    """
    bag = bag_in(path)
    return read_tables(bag) if bag.is_dir() else _read(bag, namespace)


def bag_in(path: Path) -> Path:
    """Return the MCAP file in a directory; other paths are returned unchanged."""
    if path.suffix == '.db3' or (path.is_dir() and any(path.glob('*.db3*'))):
        folder = path if path.is_dir() else path.parent
        raise MeasurementError(
            f'{path}: is a bag in the format of SQLite (db3); MCAP is read. Write a file '
            'mcap.yaml with the line `output_bags: [{uri: converted, storage_id: mcap, '
            f'all_topics: true}}]`, and type `ros2 bag convert -i {folder} -o mcap.yaml`')
    if not path.is_dir():
        return path
    bags = [path / BAG] if (path / BAG).exists() else sorted(path.glob('*.mcap'))
    if len(bags) > 1:
        raise MeasurementError(f'{path}: there are {len(bags)} recordings in it; give one of '
                               f'the files, such as {bags[-1]}')
    return bags[0] if bags else path


def _read(path: Path, namespace: str) -> Recording:
    arms: dict[str, _Tables] = defaultdict(_Tables)
    begin, unread = 0, ''
    with BagReader(path) as bag:
        for message in bag.messages():
            begin = begin or message.time
            found = TOPIC.fullmatch(message.topic.name)
            if not found or message.topic.kind != TOPICS.get(found[2], PRESSURE):
                continue
            try:
                said = bag.decoded(message)
            except BagError as error:
                unread = str(error)
                continue
            arms[found[1].rstrip('/') or '/'].add(found[2], 1e-9 * (message.time - begin), said)
            if sum(arm.numbers for arm in arms.values()) > MAX_NUMBERS:
                unread = f'it is longer than {MAX_NUMBERS / 1e6:g} million numbers'
                break
    bag.damage = '; '.join(filter(None, (bag.damage, unread)))
    chosen = bag.arm_in([space for space, arm in arms.items() if arm.tendons], namespace)
    return arms[chosen].recording(
        bag.said_of(chosen, DESCRIPTION), bag.damage, _about(bag.about, chosen))


def _about(given: dict[str, str], space: str) -> str:
    if not given:
        return ''
    return (f'soft_continuum {given.get("version", "")}, arm in namespace {space}, '
            f'{given.get("begun", "")}')


class _Tables:
    """The tables of one arm during reading."""

    def __init__(self) -> None:
        self.tendons: tuple[str, ...] = ()
        self.numbers = 0
        self._tables: dict[str, array[float]] = defaultdict(lambda: array('d'))
        self._events: list[tuple[float, str, str]] = []
        self._last: dict[str, str] = {}  # of each source of events
        self._stiff: dict[int, bool] = {}
        self._before: Any = None  # the last state of shape_sequencer

    def add(self, topic: str, time: float, message: Any) -> None:
        """Add the content of a message; time: s."""
        if topic == 'tendon_states':
            self.tendons = self.tendons or tuple(
                printable(name, MAX_NAME) for name in message.name[:MAX_TENDONS])
            pulls = self._ordered(message.position, message)
            self._add('tendons', time, *(1e3 * pull for pull in pulls))
        elif topic == 'tendon_tensions' and self.tendons:
            self._add('tensions', time, *self._ordered(message.effort, message))
        elif topic == 'disc_poses':
            for number, pose in enumerate(message.poses[:MAX_POINTS], start=1):
                p, q = pose.position, pose.orientation
                self._add('points', time, number, 1e3 * p.x, 1e3 * p.y, 1e3 * p.z,
                          q.x, q.y, q.z, q.w)
        elif topic.endswith('/pressure'):
            number = int(topic.split('/')[0].removeprefix('segment_'))
            self._add('pressures', time, number, 1e-3 * message.fluid_pressure)
        elif topic == 'jamming_valves/state':
            for number, value in enumerate(message.stiffness[:MAX_POINTS], start=1):
                if value in (NOT_STIFF, STIFF) and self._stiff.get(number) != (value == STIFF):
                    self._stiff[number] = value == STIFF
                    self._add('stiff', time, number, float(value == STIFF))
        elif topic == 'shape_sequencer/state':
            self._add_phase(time, message)
        elif topic.endswith('/status'):
            self._event(time, topic.removesuffix('/status'), message.message)

    def _add_phase(self, time: float, state: Any) -> None:
        """Add a phase; without a hold time a shape is held between two messages."""
        before, self._before = self._before, state
        if before is not None and before.running and before.phase != 'holding' and (
                state.shape_index > before.shape_index if state.running
                else state.error_code == SUCCESSFUL and any(state.goal_id.uuid)):
            self._event(time, 'progress', f'{before.shape}: holding')
        if state.running:
            where = f' segment {state.segment}' if state.segment else ''
            self._event(time, 'progress', f'{state.shape}: {state.phase}{where}')

    def _ordered(self, values: Any, message: Any) -> list[float]:
        """Return a value for each tendon, nan where there is none."""
        found = dict(zip(message.name, values, strict=False))
        return [float(found.get(name, nan)) for name in self.tendons]

    def _add(self, table: str, *row: float) -> None:
        self.numbers += len(row)
        self._tables[table].extend(row)

    def _event(self, time: float, source: str, text: str) -> None:
        if self._last.get(source) != text:
            self._last[source] = text
            self.numbers += 10  # about as much
            self._events.append((time, source, printable(text)))

    def recording(self, description: str, damage: str, about: str) -> Recording:
        """Return the recording in order of time, which bags need not have."""
        def table(name: str, columns: int) -> Array:
            rows = np.array(self._tables[name]).reshape(-1, columns)
            return rows[np.argsort(rows[:, 0], kind='stable')]

        width = 1 + len(self.tendons)
        events = [(0.0, ABOUT, about)] if about else []
        return Recording(self.tendons, table('tendons', width), table('tensions', width),
                         table('points', 9), table('pressures', 3), table('stiff', 3),
                         events + sorted(self._events, key=lambda event: event[0]),
                         description, damage)
