# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""How numbers that were recorded are compared with those of today."""

from collections.abc import Iterator
from typing import Any

TOLERANCE = 1e-9
TIP_TOLERANCE = 1e-6  # of bending for a tip: its search ends within 1e-8 m, beyond reach before
"""In SI units, and relative to the largest number of the same list of numbers."""


def differences(recorded: Any, found: Any, place: str = '', tolerance: float = TOLERANCE,
                in_block: bool = False) -> Iterator[tuple[float, str]]:
    """
    Yield where two values differ: by how many tolerances, and in words.

    Numbers with a fraction agree within ``tolerance`` (1 + the largest recorded number of their
    list, or list of lists, such as the poses of all discs); all else agrees when it is equal.
    in_block: whether these are in such a list, whose tolerance is given.
    """
    if isinstance(recorded, dict) and isinstance(found, dict):
        for name in [*recorded, *(name for name in found if name not in recorded)]:
            at = f'{place}.{name}' if place else str(name)
            if name not in found or name not in recorded:
                yield float('inf'), f'{at}: {"not recorded" if name in found else "missing"}'
            else:
                yield from differences(recorded[name], found[name], at, tolerance)
    elif not in_block and _is_block(recorded) and _is_block(found):
        largest = max((abs(one) for one in _leaves(recorded) if isinstance(one, float)),
                      default=0.0)
        yield from differences(recorded, found, place, tolerance * (1.0 + largest), True)
    elif isinstance(recorded, list) and isinstance(found, list):
        if len(recorded) != len(found):
            yield float('inf'), (f'{place}: {len(found)} instead of {len(recorded)}: '
                                 f'{str(found)[:1000]} instead of {str(recorded)[:1000]}')
        for i, (one, other) in enumerate(zip(recorded, found, strict=False)):
            yield from differences(one, other, f'{place}[{i}]', tolerance, in_block)
    elif in_block and isinstance(recorded, float) and isinstance(found, float):
        if (off := abs(found - recorded)) != 0.0:
            yield off / tolerance, f'{place}: {found!r} instead of {recorded!r}'
    elif recorded != found or type(recorded) is not type(found):
        yield float('inf'), f'{place}: {found!r} instead of {recorded!r}'


def _is_block(value: Any) -> bool:
    """Whether this is a number, or lists of lists of nothing but numbers (and 'nan')."""
    return isinstance(value, float) or (isinstance(value, list) and not any(
        isinstance(one, dict) for one in _leaves(value)))


def _leaves(value: Any) -> Iterator[Any]:
    if isinstance(value, list):
        for one in value:
            yield from _leaves(one)
    else:
        yield value


def worst(recorded: Any, found: Any, tolerance: float = TOLERANCE) -> list[str]:
    """Return the places that differ by more than the tolerance, the worst first, at most ten."""
    beyond = sorted((one for one in differences(recorded, found, '', tolerance)
                     if one[0] > 1.0), key=lambda one: -one[0])
    return [f'{text} ({off:.3g} tolerances)' for off, text in beyond[:10]]
