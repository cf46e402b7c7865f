# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
A recorded run as tables, one per kind of message; ``export`` writes them as files.

Times are from the start of the recording.  Lengths are in mm, tensions in N, absolute pressures in
kPa, orientations are quaternions: tables are for people and spreadsheets.
"""

import argparse
from array import array
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import nan
from pathlib import Path
import re
import sys
from typing import Any

import numpy as np

from soft_continuum.extras import require
from soft_continuum.lab.analysis.delimited import Array, MeasurementError
from soft_continuum.lab.analysis.verbs import reserve_outputs, run_verb, write_rows
from soft_continuum.lab.recordings.bag import BAG, BagError, BagReader, DESCRIPTION
from soft_continuum.mechanics.rotations import matrices
from soft_continuum.parameters.arguments import given_path, Parser
from soft_continuum.text import MAX_NAME, printable

PULL, TENSION = ' pull [mm]', ' tension [N]'  # after the name of a tendon
POSE = ('x [mm]', 'y [mm]', 'z [mm]', 'qx', 'qy', 'qz', 'qw')
COLUMNS = {
    'points': ('time [s]', 'point', *POSE),
    'pressures': ('time [s]', 'segment', 'pressure [kPa]'),
    'stiff': ('time [s]', 'segment', 'stiff'),
    'events': ('time [s]', 'source', 'event'),
}
"""Columns by file, without suffix, of the files that are the same for every arm."""

TABLES = ('tendons', 'tensions', *COLUMNS)
"""The tables of a recording."""
ABOUT = 'recording'  # source of the event that says when, what and by which version
BESIDE = Path('RECORDING')  # as --output: where the recording is
FORMATS = ('csv', 'mat', 'parquet')
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
        along = matrices(self.points[:, 3:])[:, :, 2]
        return np.asarray(np.degrees(np.arctan2(along[:, 0], along[:, 2])))


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


def read_recording(path: Path, namespace: str = '') -> Recording:
    """
    Read a recording: an MCAP file, or a directory with one.

    namespace: of the arm, if several were recorded; / for none.  Raises MeasurementError.
    """
    arms: dict[str, _Tables] = defaultdict(_Tables)
    begin, unread = 0, ''
    with BagReader(bag_in(path)) as bag:
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


def bag_in(path: Path) -> Path:
    """Return the MCAP file in a directory; other paths unchanged.  Raises MeasurementError."""
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
    if not bags:
        raise MeasurementError(f'{path}: there is no recording in it; give the directory that the '
                               'command record has written')
    return bags[0]


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


# Verbs that read a recording.


def recording_parser(name: str, description: str) -> Parser:
    """Return the parser of a verb that reads a recording and writes beside it by default."""
    parser = Parser(name, description, '--namespace', '--output', '--force')
    parser.add_argument('recording', type=given_path, metavar='RECORDING',
                        help='directory that record wrote, or an MCAP file')
    parser.set_defaults(output=BESIDE)
    return parser


def given_recording(options: argparse.Namespace, done: str) -> tuple[Recording, Path]:
    """
    Read the recording of recording_parser; return it, and the directory of the results.

    done: what is done with an incomplete recording, for the message.  Raises MeasurementError.
    """
    path: Path = options.recording
    recording = read_recording(path, options.namespace)
    if recording.damage:
        print(f'{path}: {recording.damage}; what comes before {done}', file=sys.stderr)
    beside = path if path.is_dir() else path.parent
    return recording, beside if options.output is BESIDE else options.output


def export(argv: Sequence[str] | None = None) -> int:
    """Run the verb; return the exit status."""
    parser = recording_parser('export', 'Write pulls, tensions, points, pressures, stiffness and '
                              'events of a recording as tables.')
    parser.add_argument('--format', choices=FORMATS, default='csv',
                        help='csv for spreadsheets, mat for MATLAB, parquet for pandas '
                        '(default: %(default)s)')
    return run_verb(parser, _export, argv)


def _export(options: argparse.Namespace) -> None:
    if options.format == 'parquet':
        require('pyarrow')
    recording, folder = given_recording(options, 'is exported')
    names = {'csv': tuple(f'{name}.csv' for name in TABLES), 'mat': ('recording.mat',),
             'parquet': tuple(f'{name}.parquet' for name in TABLES)}[options.format]
    *paths, described = reserve_outputs(folder, [*names, DESCRIPTION], options.force)
    {'csv': write_tables, 'mat': _write_mat, 'parquet': _write_parquet}[options.format](
        recording, paths)
    if recording.description:
        described.write_text(recording.description, encoding='utf-8')
    print(f'Written: {", ".join(map(str, paths))}')


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
    """Write the tables into CSV files, one for each of TABLES; raises OSError."""
    for path, (header, rows) in zip(paths, recorded_tables(recording).values(), strict=True):
        write_rows(path, [header, *(
            [f'{time:.4f}', *(f'{v:.6g}' if isinstance(v, float) else v for v in values)]
            for time, *values in rows)])


def _write_mat(recording: Recording, paths: Sequence[Path]) -> None:
    """Write a struct of columns for each table: pressures.time_s, pressures.pressure_kPa."""
    from scipy.io import savemat
    savemat(paths[0], {
        name: {field: _column([row[k] for row in rows])
               for k, field in enumerate(_fields(header))}
        for name, (header, rows) in recorded_tables(recording).items()},
        oned_as='column', long_field_names=True)


def _fields(columns: Sequence[str]) -> list[str]:
    """Return names for columns as MATLAB allows them: 63 letters, digits and underscores."""
    found: list[str] = []
    for column in columns:
        name = re.sub(r'[^A-Za-z0-9]+', '_', column).strip('_')
        name = (name if name[:1].isalpha() else f'x{name}')[:60]
        found.append(f'{name}_{len(found)}' if name in found else name)
    return found


def _column(values: Sequence[object]) -> np.ndarray:
    return np.array(values, dtype=object if any(isinstance(v, str) for v in values) else float)


def _write_parquet(recording: Recording, paths: Sequence[Path]) -> None:
    import pyarrow as arrow
    from pyarrow import parquet
    for path, (header, rows) in zip(paths, recorded_tables(recording).values(), strict=True):
        columns = {column: [row[k] for row in rows] for k, column in enumerate(header)}
        parquet.write_table(arrow.table(columns), path)
