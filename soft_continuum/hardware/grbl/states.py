# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The states of a connection to a GRBL controller, and their transitions.

    RESTING -TARGET-> JOGGING -RESTED-> RESTING          JOGGING -STOP-> STOPPING -RESTED-> RESTING
    RESTING -HOME-> HOMING_REQUESTED -HOME_SENT-> SEEKING -HOME_DONE-> HOMED -RESTED-> RESTING
    SEEKING -STOP-> ABORTING_HOMING -HOME_DONE-> RESTING

From HOMED the tendons are pulled to zero by a jog: RESTED is followed by TARGET.
"""

from enum import auto, Enum


class State(Enum):
    """State of a controller, as known to its driver."""

    RESTING = auto()
    JOGGING = auto()
    """Jogs are queued or still to be sent."""
    STOPPING = auto()
    """A feed hold was sent, or the reference was lost, and rest is not certain yet."""
    HOMING_REQUESTED = auto()
    """The homing cycle is the next line to be sent."""
    SEEKING = auto()
    """The homing cycle runs: the switches are searched for, and nothing else is answered."""
    ABORTING_HOMING = auto()
    """A soft reset was sent to end the homing cycle; an alarm must follow."""
    HOMED = auto()
    """The switches were found, and rest is not certain yet."""
    FAILED = auto()
    """All motion was ended, and nothing leads out of this but a new connection."""


class Event(Enum):
    """
    Events that change the state.

    TARGET: there is motion to be sent.  RESTED: all motion has ended.  HOME_DONE: the homing cycle
    was acknowledged.  LOCKED: the controller is locked until it is homed.
    """

    TARGET, RESTED, STOP, HOME, HOME_SENT, HOME_DONE, LOCKED, REFERENCE_LOST, FAILURE = range(9)


BUSY = frozenset(State) - {State.RESTING, State.FAILED}
"""States in which the tendons move or may move."""

_TRANSITIONS = {
    Event.TARGET: {State.RESTING: State.JOGGING},
    Event.RESTED: dict.fromkeys((State.JOGGING, State.STOPPING, State.HOMED), State.RESTING),
    Event.STOP: {State.JOGGING: State.STOPPING, State.SEEKING: State.ABORTING_HOMING,
                 State.HOMING_REQUESTED: State.RESTING, State.HOMED: State.RESTING},
    Event.HOME: {State.RESTING: State.HOMING_REQUESTED},
    Event.HOME_SENT: {State.HOMING_REQUESTED: State.SEEKING},
    Event.HOME_DONE: {State.SEEKING: State.HOMED, State.ABORTING_HOMING: State.RESTING},
    Event.LOCKED: {State.STOPPING: State.RESTING},
    Event.REFERENCE_LOST: dict.fromkeys(set(State) - {State.FAILED}, State.STOPPING),
    Event.FAILURE: dict.fromkeys(State, State.FAILED),
}


def next_state(state: State, event: Event) -> State:
    """Return the state after an event; events without a transition change nothing."""
    return _TRANSITIONS[event].get(state, state)
