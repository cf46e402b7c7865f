# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Saved shapes and sequences of a user, and their texts."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
import re
from typing import Any, Literal

from soft_continuum.client.errors import ClientError
from soft_continuum.client.sequence import MAX_HOLD
from soft_continuum.mechanics.arm import Arm
from soft_continuum.parameters.shapes import angles_problem
from soft_continuum.ros.ros_time import duration_to_ros
from soft_continuum.text import MAX_ITEMS, MAX_NAME, printable
from soft_continuum_interfaces.msg import Shape

MAX_ROUNDS = 1_000_000
NAME = re.compile(rf'[A-Za-z]\w{{0,{MAX_NAME - 1}}}', re.ASCII)
Step = tuple[str, float]
"""A shape by its name, and its hold time, s."""
Kind = Literal['shapes', 'sequences']


class OwnShapesError(ClientError):
    """A shape or a sequence cannot be saved or changed; the message says why."""


@dataclass(frozen=True)
class SavedShape:
    """
    Bending angles (rad) of each segment, base first, and directions (rad); none for 0.

    vacuums: Pa below ambient while it is held; none for every segment stiff.
    """

    angles: tuple[float, ...]
    directions: tuple[float, ...] = ()
    vacuums: tuple[float, ...] = ()


@dataclass(frozen=True)
class SavedSequence:
    """A sequence of shapes; rounds: repetitions, 0: until it is stopped."""

    steps: tuple[Step, ...]
    rounds: int = 1


@dataclass(frozen=True)
class Saved:
    """
    Saved shapes and sequences, by name.

    problem: unreadable parts of the file; empty for none.
    """

    shapes: Mapping[str, SavedShape] = field(default_factory=dict)
    sequences: Mapping[str, SavedSequence] = field(default_factory=dict)
    problem: str = ''

    @property
    def names(self) -> set[str]:
        """All names; unique among shapes and sequences."""
        return {*self.shapes, *self.sequences}

    def having(self, kind: Kind, group: Mapping[str, Any]) -> 'Saved':
        """Return a copy with other shapes, or other sequences."""
        return (replace(self, shapes=group) if kind == 'shapes' else
                replace(self, sequences=group))

    def offered(self, arm: Arm, library: Collection[str]) -> 'Saved':
        """
        Return the shapes and sequences that fit this arm.

        library: names in its shape library; they take precedence over saved ones.
        """
        shapes = {name: shape for name, shape in self.shapes.items() if name not in library
                  and not angles_problem(shape.angles, arm, shape.directions)}
        known = {*shapes, *library}
        sequences = {name: sequence for name, sequence in self.sequences.items()
                     if name not in library and known.issuperset(s for s, _ in sequence.steps)}
        return replace(self, shapes=shapes, sequences=sequences)

    def replaced(self, shapes: Sequence[Shape], library: Collection[str]) -> list[Shape]:
        """Return the shapes of a goal, with saved names replaced by their shapes."""
        found: list[Shape] = []
        for shape in shapes:
            given = shape.name in library or shape.bending_angles or shape.tips
            if not given and shape.name in self.sequences:
                steps = self.sequences[shape.name].steps
                found += self.replaced([Shape(name=name, hold_time=duration_to_ros(hold))
                                        for name, hold in steps], library)
            elif not given and shape.name in self.shapes:
                saved = self.shapes[shape.name]
                found.append(Shape(
                    name=shape.name, hold_time=shape.hold_time,
                    **plain(saved) | ({'vacuums': shape.vacuums} if shape.vacuums else {})))
            else:
                found.append(shape)
        return found


def steps_text(steps: Sequence[Step]) -> str:
    """Return steps in the format of steps_from_text."""
    return ', '.join(f'{name} {hold:g}' for name, hold in steps)


def sequence_text(sequence: SavedSequence) -> str:
    """Return a sequence as text, with hold times in s."""
    often = {0: 'until it is stopped', 1: 'once'}.get(sequence.rounds, f'{sequence.rounds} times')
    return f'{steps_text(sequence.steps)}; {often}'


def steps_from_text(text: str, hold: float) -> list[Step]:
    """
    Read ``c_form, lean 2.5``: shapes with hold times, s; ``hold`` if omitted.

    Raises OwnShapesError.
    """
    steps: list[Step] = []
    for part in filter(None, map(str.strip, text.split(','))):
        name, *rest = part.split()
        try:
            seconds = float(rest[0]) if rest else hold
            if len(rest) > 1 or not 0.0 <= seconds <= MAX_HOLD:
                raise ValueError
        except ValueError:
            raise OwnShapesError(
                f'{part!r} given; needed: the name of a shape and its hold time, such as c_form '
                f'2.5; 0 to {MAX_HOLD:g} s') from None
        steps.append((name, seconds))
    if not steps:
        raise OwnShapesError('no shape is given; give names, such as c_form 1, s_form 2.5')
    return steps


# Entries of the file, as own_file.py reads and writes them.


def plain(one: SavedShape | SavedSequence) -> dict[str, Any]:
    """Return an entry in the format of the file."""
    if isinstance(one, SavedSequence):
        return {'rounds': one.rounds, 'steps': [list(step) for step in one.steps]}
    directions = {'bending_directions': list(one.directions)} if one.directions else {}
    vacuums = {'vacuums': list(one.vacuums)} if one.vacuums else {}
    return {'bending_angles': list(one.angles)} | directions | vacuums


def keys_of(entry: Any, allowed: Collection[str] | None, what: str) -> Mapping[str, Any]:
    """Return the values by key, None for missing ones; raises ValueError for unknown keys."""
    if not isinstance(entry, Mapping):
        raise ValueError(f'{what} has no keys')
    for key in entry:
        if allowed is not None and key not in allowed:
            raise ValueError(f'unknown key {printable(key, MAX_NAME)}; allowed: '
                             f'{", ".join(allowed)}')
    return dict.fromkeys(allowed or ()) | dict(entry)


def shape_of(entry: Any) -> SavedShape:
    """Read a shape; raises ValueError."""
    values = keys_of(entry, ('bending_angles', 'bending_directions', 'vacuums'), 'it')
    angles = _numbers(values['bending_angles'], 'bending_angles')
    directions = _numbers(values['bending_directions'] or [], 'bending_directions')
    vacuums = _numbers(values['vacuums'] or [], 'vacuums')
    if len(vacuums) not in (0, len(angles)):
        raise ValueError(f'{len(vacuums)} vacuums and {len(angles)} bending_angles; needed: one '
                         'for each segment, or none')
    if not angles or len(directions) not in (0, len(angles)):
        raise ValueError(f'{len(angles)} bending_angles and {len(directions)} bending_directions; '
                         'needed: an angle for each segment, and as many directions or none')
    return SavedShape(angles, directions, vacuums)


def sequence_of(entry: Any) -> SavedSequence:
    """Read a sequence; raises ValueError."""
    values = keys_of(entry, ('rounds', 'steps'), 'it')
    rounds, steps = values['rounds'], values['steps']
    if isinstance(rounds, bool) or not (isinstance(rounds, int) and 0 <= rounds <= MAX_ROUNDS):
        raise ValueError(f'rounds is {printable(rounds)}; allowed: 0 to {MAX_ROUNDS}, 0 for until '
                         'it is stopped')
    if not isinstance(steps, list) or not 1 <= len(steps) <= MAX_ITEMS:
        raise ValueError(f'needed: 1 to {MAX_ITEMS} steps')
    kept = []
    for step in steps:
        if not (isinstance(step, list) and len(step) == 2 and isinstance(step[0], str)):
            raise ValueError(f'{printable(step)} is not a step; needed: a shape and its hold '
                             'time, s')
        hold, = _numbers([step[1]], 'the hold time')
        if not 0.0 <= hold <= MAX_HOLD:
            raise ValueError(f'the hold time is {hold:g} s; allowed: 0 to {MAX_HOLD:g} s')
        kept.append((step[0], hold))
    return SavedSequence(tuple(kept), rounds)


def _numbers(values: Any, what: str) -> tuple[float, ...]:
    if not isinstance(values, list) or len(values) > MAX_ITEMS or not all(
            isinstance(v, int | float) and not isinstance(v, bool) and abs(v) < 1e9
            and isfinite(v) for v in values):
        raise ValueError(f'{what} is {printable(values, MAX_NAME)}; needed: a list of numbers')
    return tuple(map(float, values))
