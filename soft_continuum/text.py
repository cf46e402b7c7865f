# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Text and files: bounded input from others, and atomic writing."""

from collections.abc import Iterator
from contextlib import contextmanager
from errno import EFBIG, EINVAL
import os
from pathlib import Path
import stat

MAX_TEXT = 1000
"""Displayed characters of a message."""
MAX_PLAIN = 100
"""Repeated characters of messages from other nodes."""
MAX_NAME = 60
"""Displayed characters of a name."""
MAX_ITEMS = 100
"""Stored items of a list from another node."""


def printable(text: object, most: int = MAX_TEXT) -> str:
    r"""
    Return a text as one line without control characters.

    Control and unprintable characters become escapes such as \x1b or \n; text longer than
    ``most`` characters is cut.
    """
    whole = str(text)
    shown = _escaped(whole[:most])
    return shown if len(whole) <= most else f'{shown}... ({len(whole)} characters)'


def _escaped(text: str) -> str:
    r"""Return a text with escapes such as \x1b or \n for unprintable characters."""
    if text.isprintable():
        return text
    return ''.join(c if c.isprintable() else c.encode('unicode_escape').decode() for c in text)


def plain(text: str) -> str:
    """Return text from other nodes as ``printable`` does, but shorter."""
    return printable(text, MAX_PLAIN)


def name_problem(name: str) -> str:
    """Return why a chosen name is invalid; empty for a valid one."""
    if len(name) <= MAX_PLAIN and name.isprintable():
        return ''
    return f'"{printable(name, 20)}"; allowed: {MAX_PLAIN} characters that print'


def read_bytes(path: str | Path, most: int) -> bytes:
    """
    Return the content of a file of at most ``most`` bytes.

    Raises OSError for a file that cannot be read, is larger, or has no end: a device, a pipe.
    """
    with open(path, 'rb', opener=lambda name, flags: os.open(name, flags | os.O_NONBLOCK)) as file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise OSError(EINVAL, 'it is a device or a pipe; give a file', str(path))
        data = file.read(most + 1)
    if len(data) > most:
        raise OSError(EFBIG, f'it is larger than {most / 1e6:g} MB, the most that is read',
                      str(path))
    return data


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Yield a temporary path that is renamed to ``path`` at the end (atomic write)."""
    partial = path.with_name(f'.{path.name}.{os.getpid()}')
    try:
        yield partial
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def write_whole(path: Path, text: str) -> None:
    """Write a text to a file atomically; raises OSError."""
    with written_whole(path) as partial:
        partial.write_text(text, encoding='utf-8')
