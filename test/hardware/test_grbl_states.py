# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What leads a GRBL connection from one state to another, and what never does."""

from itertools import product

import pytest

from soft_continuum.hardware.grbl.states import BUSY, Event, next_state, State

PATHS = {
    'a motion': [
        (Event.TARGET, State.JOGGING),
        (Event.RESTED, State.RESTING)],
    'a stop': [
        (Event.TARGET, State.JOGGING),
        (Event.STOP, State.STOPPING), (Event.STOP, State.STOPPING),
        (Event.TARGET, State.STOPPING), (Event.RESTED, State.RESTING)],
    'homing': [
        (Event.HOME, State.HOMING_REQUESTED),
        (Event.HOME_SENT, State.SEEKING), (Event.HOME_DONE, State.HOMED),
        (Event.RESTED, State.RESTING), (Event.TARGET, State.JOGGING)],
    'homing that is stopped before it was sent': [
        (Event.HOME, State.HOMING_REQUESTED),
        (Event.STOP, State.RESTING)],
    'homing that is stopped while it seeks': [
        (Event.HOME, State.HOMING_REQUESTED),
        (Event.HOME_SENT, State.SEEKING), (Event.STOP, State.ABORTING_HOMING),
        (Event.HOME_DONE, State.RESTING)],
    'homing that is stopped when the switches were found': [
        (Event.HOME, State.HOMING_REQUESTED),
        (Event.HOME_SENT, State.SEEKING), (Event.HOME_DONE, State.HOMED),
        (Event.STOP, State.RESTING)],
    'a reset of a board with switches': [
        (Event.TARGET, State.JOGGING),
        (Event.REFERENCE_LOST, State.STOPPING), (Event.LOCKED, State.RESTING)],
    'a failure': [
        (Event.TARGET, State.JOGGING),
        (Event.FAILURE, State.FAILED), (Event.RESTED, State.FAILED)],
}


@pytest.mark.parametrize('path', PATHS.values(), ids=PATHS)
def test_states_follow_one_another(path):
    state = State.RESTING
    for event, expected in path:
        state = next_state(state, event)
        assert state is expected


@pytest.mark.parametrize('state', State)
def test_a_stop_never_starts_motion(state):
    after = next_state(state, Event.STOP)
    assert after not in (State.JOGGING, State.SEEKING, State.HOMING_REQUESTED, State.HOMED)
    assert after in BUSY or state not in (State.JOGGING, State.SEEKING)  # not over before it is


@pytest.mark.parametrize('state', State)
def test_a_failure_can_happen_in_every_state_and_lasts(state):
    assert next_state(state, Event.FAILURE) is State.FAILED
    for event in Event:
        assert next_state(State.FAILED, event) is State.FAILED


def test_only_a_target_at_rest_begins_to_jog_and_only_a_request_at_rest_begins_to_home():
    ways = {(state, event): next_state(state, event) for state, event in product(State, Event)}
    for target, event in ((State.JOGGING, Event.TARGET), (State.HOMING_REQUESTED, Event.HOME)):
        assert {way for way, to in ways.items() if to is target and way[0] is not target} == {
            (State.RESTING, event)}


@pytest.mark.parametrize('state', [state for state in State if state in BUSY])
def test_a_reference_that_is_lost_ends_whatever_moves(state):
    assert next_state(state, Event.REFERENCE_LOST) is State.STOPPING
