# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The states of a connection to a GRBL controller, and what leads from one to another.

    RESTING -TARGET-> JOGGING -RESTED-> RESTING          JOGGING -STOP-> STOPPING -RESTED-> RESTING
    RESTING -HOME-> HOMING_REQUESTED -HOME_SENT-> SEEKING -HOME_DONE-> HOMED -RESTED-> RESTING
    SEEKING -STOP-> ABORTING_HOMING -HOME_DONE-> RESTING

From HOMED the tendons are pulled to zero by a jog: RESTED is followed by TARGET.
"""

from collections.abc import Mapping
from enum import auto, Enum


class State(Enum):
    """What a controller is doing, as far as its driver knows."""

    DISCONNECTED = auto()
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


class Event(Enum):
    """What changes the state."""

    OPENED = auto()
    TARGET = auto()
    """There is motion to be sent."""
    RESTED = auto()
    """All motion has ended."""
    STOP = auto()
    HOME = auto()
    HOME_SENT = auto()
    HOME_DONE = auto()
    """The homing cycle was acknowledged."""
    LOCKED = auto()
    """The controller is locked until it is homed."""
    REFERENCE_LOST = auto()
    FAILURE = auto()
    CLOSED = auto()


BUSY = frozenset(State) - {State.DISCONNECTED, State.RESTING, State.FAILED}
"""States in which the tendons move or may move."""

_TRANSITIONS: Mapping[State, Mapping[Event, State]] = {
    State.DISCONNECTED: {Event.OPENED: State.RESTING},
    State.RESTING: {
        Event.TARGET: State.JOGGING, Event.HOME: State.HOMING_REQUESTED,
        Event.REFERENCE_LOST: State.STOPPING},
    State.JOGGING: {
        Event.RESTED: State.RESTING, Event.STOP: State.STOPPING,
        Event.REFERENCE_LOST: State.STOPPING},
    State.STOPPING: {Event.RESTED: State.RESTING, Event.LOCKED: State.RESTING},
    State.HOMING_REQUESTED: {
        Event.HOME_SENT: State.SEEKING, Event.STOP: State.RESTING,
        Event.REFERENCE_LOST: State.STOPPING},
    State.SEEKING: {
        Event.HOME_DONE: State.HOMED, Event.STOP: State.ABORTING_HOMING,
        Event.REFERENCE_LOST: State.STOPPING},
    State.ABORTING_HOMING: {
        Event.HOME_DONE: State.RESTING, Event.REFERENCE_LOST: State.STOPPING},
    State.HOMED: {
        Event.RESTED: State.RESTING, Event.STOP: State.RESTING,
        Event.REFERENCE_LOST: State.STOPPING},
    State.FAILED: {},
}


def next_state(state: State, event: Event) -> State:
    """Return the state after an event; one that has no meaning in a state does not change it."""
    if event is Event.CLOSED:
        return State.DISCONNECTED
    if event is Event.FAILURE and state is not State.DISCONNECTED:
        return State.FAILED
    return _TRANSITIONS[state].get(event, state)
