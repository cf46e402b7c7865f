# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The tables of a recorded run, from an MCAP file of ``record`` or ``ros2 bag``."""

from array import array
from collections import defaultdict
from math import nan
from pathlib import Path
import re
from typing import Any

import numpy as np

from soft_continuum.analysis.delimited import Array, MeasurementError
from soft_continuum.analysis.recording import (
    ABOUT,
    BAG,
    DESCRIPTION,
    read_tables,
    Recording,
)
from soft_continuum.recordings.bag import BagError, BagReader
from soft_continuum.text import MAX_NAME, printable

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
MAX_TENDONS = MAX_POINTS = 100
MAX_NUMBERS = 100_000_000  # of all tables: some hours


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
        elif topic == 'shape_sequencer/state' and message.running:
            where = f' segment {message.segment}' if message.segment else ''
            self._event(time, 'progress', f'{message.shape}: {message.phase}{where}')
        elif topic.endswith('/status'):
            self._event(time, topic.removesuffix('/status'), message.message)

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
