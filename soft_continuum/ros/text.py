# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Text of others, as far as it may be repeated."""

from soft_continuum.text import printable

MAX_TEXT = 100


def plain(text: str, limit: int = MAX_TEXT) -> str:
    """Return ``text`` as text.printable does, for what other nodes send."""
    return printable(text, limit)


def name_problem(name: str) -> str:
    """Return why a name that somebody chose is not taken, empty for a good one."""
    if len(name) <= MAX_TEXT and name.isprintable():
        return ''
    return f'"{plain(name, 20)}"; allowed: {MAX_TEXT} characters that print'
