# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What only a person can know to be right is asked for twice."""

from soft_continuum.ros.ros_time import Age

ANSWER_TIMEOUT = 30.0  # s within which the same request, made again, is the answer


class Question:
    """
    Asks back before a request is carried out that what is known speaks against.

    A request that is made again within ANSWER_TIMEOUT means yes: std_srvs/Trigger has no field.
    """

    def __init__(self) -> None:
        """Nothing was asked yet."""
        self._asked = Age()

    def ask(self, doubt: str, effect: str) -> str:
        """
        Return the question, empty when there is no doubt or it was answered.

        doubt: what speaks against it.  effect: what it would do, and what to do first.
        """
        answered = self._asked.seconds <= ANSWER_TIMEOUT
        self._asked.clear()
        if answered or not doubt:
            return ''
        self._asked.refresh()
        return (f'nothing was done: as last known, {doubt}; {effect}, then call this again within '
                f'{ANSWER_TIMEOUT:g} s')
