# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The budget of a search."""

from time import monotonic


class Budget:
    """
    The number of states that a search may evaluate, and a time limit.

    Counted in work, a budget is independent of the machine's speed.  A state counts when it is
    solved or evaluated by constant curvature.  states and seconds are totals; ``judged`` counts
    states.  late: whether the time limit ended the search.
    """

    def __init__(self, states: float, seconds: float) -> None:
        """Begin now."""
        self.states, self.judged, self.late = states, 0, False
        self._end = monotonic() + seconds

    def judge(self) -> bool:
        """Count a state; return whether it exceeds the budget."""
        self.judged += 1
        return self.over

    def add(self, states: float, seconds: float) -> None:
        """Allow so much more."""
        self.states += states
        self._end += seconds

    @property
    def over(self) -> bool:
        """Whether the search must end."""
        if monotonic() > self._end:
            self.late = True
        return self.late or self.judged > self.states

    @property
    def ended_by_time(self) -> str:
        """Text if no plan was found within the time limit; otherwise empty."""
        return (f'; reach.time_limit ended the search after {self.judged} of {self.states:.0f} '
                'states: more time may give a plan') if self.late else ''

    @property
    def left(self) -> tuple[float, float]:
        """The states and the seconds that are left."""
        return (max(0.0, self.states - self.judged),
                max(0.0, self._end - monotonic()))
