# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Requests that contradict the known state must be confirmed."""

from soft_continuum.ros.ros_time import Age

ANSWER_TIMEOUT = 30.0  # s within which the same request, made again, is the answer


class Question:
    """
    Asks for confirmation of a request that contradicts the known state.

    Repeating the request within ANSWER_TIMEOUT confirms it: std_srvs/Trigger has no fields.
    """

    def __init__(self) -> None:
        """Start without a question."""
        self._asked = Age()

    def ask(self, doubt: str, effect: str) -> str:
        """
        Return the question; empty without a doubt, or after confirmation.

        doubt: why it may be wrong.  effect: consequence of the request, and what to do first.
        """
        answered = self._asked.seconds <= ANSWER_TIMEOUT
        self._asked.clear()
        if answered or not doubt:
            return ''
        self._asked.refresh()
        return (f'nothing was done: as last known, {doubt}; {effect}, then call this again within '
                f'{ANSWER_TIMEOUT:g} s')
