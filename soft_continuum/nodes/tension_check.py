# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Whether the tensions that are measured are those that the model has."""

from collections.abc import Mapping, Sequence
from math import nan

PATIENCE = 2.0  # s for which a difference lasts before it is reported
SLACK = 0.1  # of what the model has: with less, a tendon carries nothing


class TensionCheck:
    """Finds the tendons whose measured tension has long been another than that of the model."""

    def __init__(self, tendons: Sequence[str]) -> None:
        """tendons: their names."""
        self._tendons = tendons
        self._since: dict[str, float] = {}  # s, of those that differ
        self._said: dict[str, str] = {}

    def problem(self, now: float, measured: Mapping[str, float], model: Sequence[float],
                tolerances: Sequence[float]) -> str:
        """
        Return what is wrong, empty for nothing; it stays the same while its cause does.

        now: s.  measured: N, by tendon, those that are.  model: N, one per tendon, nan where
        nothing determines it.  tolerances: N, one per tendon.
        """
        for name, expected, tolerance in zip(self._tendons, model, tolerances, strict=True):
            seen = measured.get(name, nan)
            if not abs(seen - expected) > tolerance:  # also what is not known
                self._since.pop(name, None)
                self._said.pop(name, None)
            elif now - self._since.setdefault(name, now) > PATIENCE:
                cause = _cause(seen, expected, tolerance)
                if cause not in self._said.get(name, ''):
                    self._said[name] = (f'the tension of {name} is {seen:.1f} N, by the model '
                                        f'{expected:.1f} N; {cause}')
        return '; '.join(self._said.values())


def _cause(seen: float, expected: float, tolerance: float) -> str:
    if seen < -tolerance:
        return 'a tendon cannot push: is the sign or the zero of its load cell wrong?'
    if seen < SLACK * expected:
        return 'it is slack: off its guide, torn, or did its motor lose steps?'
    return 'friction, contact, another payload or stiffness, or a wrong zero of the load cell?'
