# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""How long a search goes on: by the work that it does, so that the machine's speed is nothing."""

from time import monotonic


class Budget:
    """
    The states that a search may judge, and the seconds after which it ends whatever it has done.

    A state counts when it is solved for, or looked at by constant curvature.  states and seconds
    are those in all; ``judged`` counts.  late: whether the seconds ended the search.
    """

    def __init__(self, states: float, seconds: float) -> None:
        """Begin now."""
        self.states, self.judged, self.late = states, 0, False
        self._end = monotonic() + seconds

    def judge(self) -> bool:
        """Count a state; return whether it is one too many."""
        self.judged += 1
        return self.over

    def add(self, states: float, seconds: float) -> None:
        """Allow so much more."""
        self.states += states
        self._end += seconds

    @property
    def over(self) -> bool:
        """Whether the search is to end."""
        if monotonic() > self._end:
            self.late = True
        return self.late or self.judged > self.states

    @property
    def ended_by_time(self) -> str:
        """What to say where no plan was found and the seconds ended the search; else nothing."""
        return (f'; reach.time_limit ended the search after {self.judged} of {self.states:.0f} '
                'states: more time may give a plan') if self.late else ''

    @property
    def left(self) -> tuple[float, float]:
        """The states and the seconds that are left."""
        return (max(0.0, self.states - self.judged),
                max(0.0, self._end - monotonic()))
