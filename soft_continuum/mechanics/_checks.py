# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Validation of arguments that have one value per segment or tendon."""

from collections.abc import Sequence
from math import inf, isfinite
from numbers import Integral, Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


def soft_flags(soft: Sequence[bool], segments: int) -> tuple[bool, ...]:
    """Return one flag per segment; raise ValueError for other input."""
    given = listed(soft)
    if len(given) == segments and {bool}.issuperset(map(type, given)):
        return tuple(given)  # which nearly all are; what follows takes 20 times as long
    if len(given) != segments or any(np.ndim(s) or s not in (0, 1) for s in given):
        raise ValueError(f'soft must have a true or false for each of the {segments} segments; '
                         f'given: {soft!r}')
    return tuple(bool(s) for s in given)


def vacuum_parts(vacuum: Sequence[float] | None, segments: int) -> tuple[float, ...]:
    """Return the vacuum per segment, 0 to 1, or () for full; raise ValueError for other input."""
    if vacuum is None:
        return ()
    given = listed(vacuum)
    if len(given) != segments or not all(finite(v) and 0.0 <= v <= 1.0 for v in given):
        raise ValueError(f'vacuum must be one number from 0 to 1 for each of the {segments} '
                         f'segments; given: {vacuum!r}')
    return tuple(float(v) for v in given)


def sliding_signs(sliding: Sequence[int], tendons: int = 2) -> tuple[int, ...]:
    """Return the sliding direction of each tendon; raise ValueError for invalid input."""
    if isinstance(sliding, tuple) and not sliding:
        return (0,) * tendons
    given = listed(sliding)
    if len(given) != tendons or any(
            np.ndim(s) or isinstance(s, bool) or s not in (-1, 0, 1) for s in given):
        raise ValueError(f'sliding must be 1, 0 or -1 for each of the {tendons} tendons; '
                         f'given: {sliding!r}')
    return tuple(given)


def of_tendons(values: ArrayLike, tendons: int, what: str, rows: bool = False
               ) -> NDArray[np.float64]:
    """
    Return one number per tendon, which may be nan or -inf; else raise ValueError.

    rows: return (m, tendons); values are then one list or a list of lists.
    """
    wanted = f'{what}, one for each of the {tendons} tendons'
    given = real_array(values, wanted)
    if rows and given.ndim == 1:
        given = given[None]
    if (given.ndim != 1 + rows or given.shape[-1] != tendons or len(given) < rows
            or not np.all((given < np.inf) | np.isnan(given))):
        raise ValueError(f'{wanted}; given: {values!r}')
    return given


def pulls_of(pulls: ArrayLike, tendons: int, rows: bool = False) -> NDArray[np.float64]:
    """Return one pull per tendon, m or SLACK, or ``rows`` of them; else raise ValueError."""
    what = 'pulls must be finite numbers (m), or SLACK'
    if not rows:  # by Python's numbers: for a few tendons, numpy takes several times as long
        given = real_array(pulls, f'{what}, one for each of the {tendons} tendons')
        if given.shape == (tendons,) and sum(given.tolist()) < inf:  # none is inf or nan
            return given
    given = of_tendons(pulls, tendons, what, rows)
    if np.isnan(given).any():
        raise ValueError(f'{what}; given: {pulls!r}')
    return given


def tensions_of(tensions: ArrayLike, tendons: int, optional: bool = False, rows: bool = False
                ) -> NDArray[np.float64]:
    """
    Return one tension per tendon, N, or ``rows`` of them; else raise ValueError.

    optional: whether some may be nan.
    """
    what = 'tensions must be finite numbers of 0 N or more' + (', or nan' if optional else '')
    given = of_tendons(tensions, tendons, what, rows)
    if np.any(given < 0.0) or not optional and np.isnan(given).any():
        raise ValueError(f'{what}; given: {tensions!r}')
    return given


def bending_of(bending: ArrayLike, segments: int) -> NDArray[np.float64]:
    """Return bending (segments, 2), rad or nan; raise ValueError for other input."""
    given = real_array(bending, 'bending must be numbers (rad), or nan')
    if given.shape != (segments, 2) or np.any(np.isinf(given)):
        raise ValueError('bending must be two numbers (rad) or nan, about x and y, for each of '
                         f'the {segments} segments; given: {bending!r}')
    return given


def check_pretension(pretension: float) -> None:
    """Raise ValueError if the least tension of tendons is not 0 N or more."""
    if not (finite(pretension) and pretension >= 0.0):
        raise ValueError(f'the pretension must be a number of 0 N or more; given: {pretension!r}')


def segment_order(order: Sequence[int] | None, segments: int) -> list[int]:
    """Return the ordered segments (0-based), by default all; raise ValueError if invalid."""
    turns = list(range(segments)) if order is None else listed(order)
    if (not turns and np.ndim(order) == 0  # type: ignore[arg-type]
            or not all(whole(turn) and 0 <= turn < segments for turn in turns)
            or len(set(turns)) < len(turns)):
        raise ValueError(f'order must name segments, 0 to {segments - 1}, each at most once; '
                         f'given: {order!r}')
    return turns


def whole(value: object) -> bool:
    """Return whether a value is a whole number, of Python or numpy."""
    return type(value) is int or (isinstance(value, Integral) and not isinstance(value, bool))


def real_array(values: ArrayLike, what: str) -> NDArray[np.float64]:
    """Return real numbers as an array of floats; raise ValueError for other input."""
    try:
        given = np.asarray(values)
    except ValueError:  # rows of different lengths
        given = np.asarray(None)
    if given.dtype.kind not in 'iuf':
        raise ValueError(f'{what}; given: {values!r}')
    return given.astype(float)


def finite(value: object) -> bool:
    """Return whether a value is a finite number."""
    try:
        return is_number(value) and isfinite(value)  # type: ignore[arg-type]
    except OverflowError:  # a whole number beyond all floats
        return False


def is_number(value: object) -> bool:
    """Return whether a value is a real number of Python or numpy and not a bool."""
    return type(value) is float or (isinstance(value, Real) and not isinstance(value, bool))


def listed(values: Any) -> list[Any]:
    """Return values as a list, empty if they are not iterable."""
    try:
        return list(values)
    except TypeError:
        return []
