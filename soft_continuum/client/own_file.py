# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The user's file of saved shapes and sequences, which every client reads.

It is ``soft_continuum/shapes.yaml`` in ``XDG_CONFIG_HOME``, else in ``~/.config``::

    version: 1
    shapes:
      lean: {bending_angles: [0.3, 0.2, 0.1]}    # rad; spatial arms: also bending_directions
    sequences:
      nod: {rounds: 3, steps: [[lean, 1.0], [c_form, 2.5]]}    # shape, hold time in s

Every change reads and rewrites the whole file.  A file that could not be read completely is copied
first, so that nothing is lost.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
import fcntl
from itertools import count
from math import isfinite
import os
from pathlib import Path
import re
import shutil
from time import monotonic, sleep
from typing import Any, Literal

import yaml

from soft_continuum.client.errors import ClientError
from soft_continuum.client.sequence import angles_and_directions, Bending, MAX_HOLD
from soft_continuum.mechanics.arm import Arm
from soft_continuum.parameters.files import read_yaml
from soft_continuum.parameters.overrides import MAX_SIZE
from soft_continuum.parameters.parameter import name_hint, ParameterError
from soft_continuum.parameters.shapes import angles_problem
from soft_continuum.ros.ros_time import duration_to_ros
from soft_continuum.text import MAX_ITEMS, MAX_NAME, printable, write_whole
from soft_continuum.user_files import saved_shapes
from soft_continuum_interfaces.msg import Shape

MAX_ROUNDS = 1_000_000
NAME = re.compile(rf'[A-Za-z]\w{{0,{MAX_NAME - 1}}}', re.ASCII)
Step = tuple[str, float]
"""A shape by its name, and its hold time, s."""
Kind = Literal['shapes', 'sequences']
LOCK_TIMEOUT, LOCK_PERIOD = 10.0, 0.05  # s, to wait for another program to write
VERSION = 1
HEADER = '# Saved shapes and sequences. A program writes all of this file at every change.\n'
KINDS: tuple[Kind, ...] = ('shapes', 'sequences')


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
                    **file_entry(saved) | ({'vacuums': shape.vacuums} if shape.vacuums else {})))
            else:
                found.append(shape)
        return found


def read_saved() -> Saved:
    """Return the saved shapes and sequences, and the unreadable parts of the file."""
    path = saved_shapes()
    try:
        document = read_yaml(path)
    except FileNotFoundError:
        return Saved()
    except OSError as error:
        return Saved(problem=f'{path}: cannot be read: {error.strerror}')
    except ParameterError as error:
        return Saved(problem=str(error))
    problems: list[str] = []
    try:
        version = keys_of(document, ('version', *KINDS), 'the file')['version']
        if version != VERSION:
            raise ValueError(f'it is of version {printable(version)}; this program knows version '
                             f'{VERSION}')
        shapes = dict(_entries(document, 'shapes', shape_of, problems))
        sequences = dict(_entries(document, 'sequences', sequence_of, problems))
    except ValueError as error:
        return Saved(problem=f'{path}: {error}')
    if both := shapes.keys() & sequences:
        problems.append(f'{min(both)} is a shape and a sequence')
        sequences = {name: one for name, one in sequences.items() if name not in both}
    return Saved(shapes, sequences, f'{path}: {"; ".join(problems[:3])}' if problems else '')


# Changes. Each returns a message for the user.


def save_shape(name: str, shape: Sequence[Bending], library: Collection[str] = ()) -> str:
    """
    Save the bending of each segment, as for Arm.run; replaces a shape of the same name.

    library: names in the library of the arm.  Raises OwnShapesError, like all of these functions.
    """
    try:
        kept = shape_of(angles_and_directions(shape))
    except ValueError as error:
        raise OwnShapesError(f'{name}: {error}') from None
    return _save('shapes', name, kept, library)


def save_sequence(name: str, steps: Sequence[Step], rounds: int, library: Collection[str] = ()
                  ) -> str:
    """Save a sequence; replaces one of the same name.  Its shapes must be known."""
    try:
        kept = sequence_of({'steps': [list(step) for step in steps], 'rounds': rounds})
    except ValueError as error:
        raise OwnShapesError(f'{name}: {error}') from None
    return _save('sequences', name, kept, library)


def rename(kind: Kind, old: str, new: str, library: Collection[str] = ()) -> str:
    """Rename a shape or a sequence, also in the sequences that use it."""
    def changed(saved: Saved) -> tuple[Saved, str]:
        group = _group(saved, kind, old)
        _check_name(new, {*saved.names, *library})
        group = {new if name == old else name: one for name, one in group.items()}
        saved = saved.having(kind, group)
        if kind == 'shapes':
            saved = replace(saved, sequences={
                name: replace(one, steps=tuple((new if shape == old else shape, hold)
                                               for shape, hold in one.steps))
                for name, one in saved.sequences.items()})
        return saved, f'{old} is now {new}'
    return _change(changed)


def delete(kind: Kind, name: str) -> str:
    """Delete a shape that no sequence uses, or a sequence; the message has its values."""
    def changed(saved: Saved) -> tuple[Saved, str]:
        group = _group(saved, kind, name)
        users = sorted(user for user, one in saved.sequences.items()
                       if kind == 'shapes' and name in dict(one.steps))
        if users:
            raise OwnShapesError(f'{name} is in the sequence {", ".join(users)}; delete that '
                                 'first')
        was = group.pop(name)
        return saved.having(kind, group), f'{name} deleted; it was {_flow(file_entry(was))}'
    return _change(changed)


def _save(kind: Kind, name: str, kept: SavedShape | SavedSequence, library: Collection[str]
          ) -> str:
    def changed(saved: Saved) -> tuple[Saved, str]:
        if isinstance(kept, SavedSequence):
            known = {*saved.shapes, *library}
            for shape, _ in kept.steps:
                if shape not in known:
                    raise OwnShapesError(f'{name}: there is no shape {shape!r}'
                                         + name_hint(shape, known))
        group = dict(getattr(saved, kind))
        _check_name(name, {*library, *(saved.names - group.keys())})
        was = f'; it was {_flow(file_entry(group[name]))}' if name in group else ''
        return saved.having(kind, group | {name: kept}), f'{name} saved{was}'
    return _change(changed)


def _group(saved: Saved, kind: Kind, name: str) -> dict[str, Any]:
    """Return all of a kind; this name must be among them."""
    group = dict(getattr(saved, kind))
    if name not in group:
        raise OwnShapesError(f'nothing is saved as {name!r}{name_hint(name, group)}')
    return group


def _check_name(name: str, taken: Collection[str]) -> None:
    if not NAME.fullmatch(name):
        raise OwnShapesError(f'{name!r} is not a valid name; allowed: a letter, then letters, '
                             f'digits and _, {MAX_NAME} at most')
    if name in taken:
        raise OwnShapesError(f'{name} is the name of another shape or sequence; choose another')


def _change(changed: Callable[[Saved], tuple[Saved, str]]) -> str:
    """Change the file under a lock; return the message."""
    path = saved_shapes().resolve()  # keep a symbolic link
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with _locked(path.parent):
            saved = read_saved()
            after, done = changed(saved)
            text = HEADER + _flow({'version': VERSION, **{
                kind: {name: file_entry(one) for name, one in getattr(after, kind).items()}
                for kind in KINDS}}) + '\n'
            if len(text) > MAX_SIZE:
                raise OwnShapesError(f'{path} would be larger than {MAX_SIZE / 1e3:g} kB; delete '
                                     'something first')
            if saved.problem:
                aside = next(p for n in count(1) if not (
                    p := path.with_name(f'{path.name}.kept-{n}')).exists())
                shutil.copy2(path, aside)
                done += f'. The previous file is kept as {aside}: {saved.problem}'
            write_whole(path, text)
    except OSError as error:
        raise OwnShapesError(f'{error.filename or path}: cannot be written: {error.strerror}'
                             ) from None
    return done


@contextmanager
def _locked(directory: Path) -> Iterator[None]:
    descriptor = os.open(directory, os.O_RDONLY)
    try:
        deadline = monotonic() + LOCK_TIMEOUT
        while True:
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if monotonic() > deadline:
                    raise OwnShapesError(f'{directory}: another program has been writing there '
                                         f'for {LOCK_TIMEOUT:g} s; close it, then save again'
                                         ) from None
                sleep(LOCK_PERIOD)
        yield
    finally:
        os.close(descriptor)


# Texts.


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


# Entries of the file.


def file_entry(one: SavedShape | SavedSequence) -> dict[str, Any]:
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


def _flow(value: Any) -> str:
    return str(yaml.safe_dump(value, sort_keys=False, default_flow_style=None, width=1000)).strip()


def _entries(document: Mapping[str, Any], kind: Kind, read: Callable[[Any], Any],
             problems: list[str]) -> Iterator[tuple[str, Any]]:
    """Yield the entries of a kind by name; add invalid ones to the problems."""
    for name, entry in keys_of(document.get(kind) or {}, None, kind).items():
        try:
            if not (isinstance(name, str) and NAME.fullmatch(name)):
                raise ValueError('is no name')
            yield name, read(entry)
        except ValueError as error:
            problems.append(f'{printable(name, MAX_NAME)}: {error}')
