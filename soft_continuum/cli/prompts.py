# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Questions on a terminal."""

from collections.abc import Callable
from typing import TypeVar

T = TypeVar('T')


class DeclinedError(Exception):
    """The user did not confirm, or there is no terminal for questions."""


def ask(question: str, read: Callable[[str], T]) -> T:
    """
    Ask until the answer is valid; return it as parsed by ``read``.

    read: raises ValueError, naming the allowed answers, for an invalid one. Raises DeclinedError
    at the end of the input.
    """
    while True:
        try:
            return read(input(f'{question} ').strip().lower())
        except ValueError as error:
            print(error, flush=True)
        except EOFError:
            raise DeclinedError(
                'no answer came; use a terminal, or give the answers as options; --help shows '
                'them') from None


def confirm(text: str, yes: bool) -> None:
    """Print what is about to happen; unless ``yes``, ask for consent or raise DeclinedError."""
    print(f'\n{text}', flush=True)
    if not yes and ask('Ready? (yes, no)', one_of('yes', 'y', 'no', 'n')) in ('no', 'n'):
        raise DeclinedError('not confirmed, so nothing more was done')


def one_of(*answers: str) -> Callable[[str], str]:
    """Return a reader of one of the answers."""
    def read(text: str) -> str:
        if text not in answers:
            raise ValueError(f'{text!r} was typed; allowed: {", ".join(answers)}')
        return text

    return read


def number(text: str, low: float, high: float, unit: str) -> float:
    """Return a typed number; raises ValueError if it is outside the bounds."""
    try:
        value = float(text.replace(',', '.'))
    except ValueError:
        value = float('nan')
    if not low <= value <= high:
        raise ValueError(
            f'{text!r} was typed; allowed: a number from {low:g} to {high:g} {unit}')
    return value
