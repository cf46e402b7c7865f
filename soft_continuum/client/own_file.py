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
from dataclasses import replace
import fcntl
from itertools import count
import os
from pathlib import Path
import shutil
from time import monotonic, sleep
from typing import Any

import yaml

from soft_continuum.client.own_shapes import (
    keys_of,
    Kind,
    NAME,
    OwnShapesError,
    plain,
    Saved,
    SavedSequence,
    SavedShape,
    sequence_of,
    shape_of,
    Step,
)
from soft_continuum.client.sequence import Bending, bendings
from soft_continuum.parameters.files import read_yaml
from soft_continuum.parameters.overrides import MAX_SIZE
from soft_continuum.parameters.parameter import name_hint, ParameterError
from soft_continuum.text import MAX_NAME, printable, write_whole
from soft_continuum.user_files import saved_shapes

LOCK_TIMEOUT, LOCK_PERIOD = 10.0, 0.05  # s, to wait for another program to write
VERSION = 1
HEADER = '# Saved shapes and sequences. A program writes all of this file at every change.\n'
KINDS: tuple[Kind, ...] = ('shapes', 'sequences')


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
        kept = shape_of(bendings(shape))
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
        return saved.having(kind, group), f'{name} deleted; it was {_flow(plain(was))}'
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
        was = f'; it was {_flow(plain(group[name]))}' if name in group else ''
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
                kind: {name: plain(one) for name, one in getattr(after, kind).items()}
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


# Entries of the file.


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


