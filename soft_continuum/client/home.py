# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Straightens the arm from any shape."""

from contextlib import suppress
from math import degrees, inf
from typing import TYPE_CHECKING

from soft_continuum.client.errors import (
    ClientError,
    NoAnswerError,
    RefusedError,
    SequenceError,
)
from soft_continuum.ros.names import SHAPE_SEQUENCER
from soft_continuum.sequencing.progress import Code

if TYPE_CHECKING:
    from collections.abc import Callable

    from soft_continuum.client.arm import Arm
    from soft_continuum.client.state import ArmState

STRAIGHT = 2.0  # degrees that a segment may remain bent
SETTLING = 3.0  # s for the model to follow


def home(arm: 'Arm') -> str:
    """
    Straighten the arm; return how it was done, and the segments still bent.

    Uses the sequence that sets all angles to 0.  If it is refused, or no plan is found: the last
    segment is softened, pulled-in tendons are paid out to bend nothing, the other segments are
    softened, the tendons are moved to their pulls at the straight arm, and the segments are
    stiffened. This ignores obstacles, so it is refused if shape_sequencer has any.  After an error
    or Ctrl-C, the tendons rest and the segments are stiffened; a stop leaves them unchanged.
    Raises as Arm.run, Arm.soften and Arm.jog.
    """
    state = arm.state
    if state.stopped:
        raise RefusedError(f'motion is stopped: {state.stopped}; resume it first')
    if state.progress is not None:
        raise RefusedError('a sequence is running; cancel or stop it first')
    refused = _by_sequence(arm, state)
    if refused:
        _check_free(arm, state, refused)
        try:
            _without_a_plan(arm, state)
        except BaseException:
            _leave_stiff(arm)
            raise
    _settles(arm, lambda now: not _bent(now))
    bent = _bent(arm.state)
    done = f'straightened without a plan, because {refused}; ' if refused else ''
    if bent:
        return (f'{done}the tendons are at the pulls of the straight arm, but its weight or a '
                f'tendon offset bends {", ".join(bent)}')
    return f'{done}the arm is straight'


def _by_sequence(arm: 'Arm', state: 'ArmState') -> str:
    """Return why no sequence straightened the arm; empty if one did."""
    if not _has_sequencer(state):
        return 'no shape_sequencer runs'
    try:
        arm.run([0.0] * len(arm.description.segments))
    except RefusedError as error:
        return str(error)
    except SequenceError as error:
        if error.result.outcome != Code.MODEL_FAILURE.name:
            raise
        return str(error)
    return ''


def _check_free(arm: 'Arm', state: 'ArmState', refused: str) -> None:
    """Raise RefusedError if there are obstacles: only plans avoid them."""
    if not _has_sequencer(state):
        return
    if names := ', '.join(one.name for one in arm.obstacles.known):
        raise RefusedError(f'{refused}; without a plan the arm could touch obstacles ({names}): '
                           'move them away, then remove them by `soft_continuum obstacles '
                           '--clear`')


def _has_sequencer(state: 'ArmState') -> bool:
    return any(node.name == SHAPE_SEQUENCER and node.running for node in state.nodes)


def _leave_stiff(arm: 'Arm') -> None:
    """Stiffen the softened segments, unless motion is stopped."""
    with suppress(ClientError):
        if arm.state.stiff and not arm.state.stopped:
            arm.stiffen()


def _without_a_plan(arm: 'Arm', state: 'ArmState') -> None:
    last, *others = range(len(state.stiff), 0, -1) or (0,)
    if last:
        arm.soften(last)
    if _is_followed(arm):
        _go(arm, most=0.0)
    for segment in others:
        arm.soften(segment)
    if not _is_followed(arm):
        arm.reset()  # the shape of soft segments depends on the pulls alone
    _go(arm, most=0.0)
    _go(arm, most=0.0, least=0.0)
    if last:
        arm.stiffen()


def _go(arm: 'Arm', most: float, least: float = -inf) -> None:
    """Move all pulls into a range, m."""
    state = arm.state
    pulls = dict(zip(state.tendons, state.pulls or (), strict=True))
    moves = {name: min(max(pull, least), most) - pull for name, pull in pulls.items()}
    if any(moves.values()):
        arm.jog(**moves)


def _is_followed(arm: 'Arm') -> bool:
    """Whether kinematics follows the shape of the arm."""
    return _settles(arm, lambda now: now.node('kinematics').level == 'ok')


def _settles(arm: 'Arm', condition: 'Callable[[ArmState], bool]') -> bool:
    try:
        return arm.wait_for(condition, SETTLING)
    except NoAnswerError:
        return False


def _bent(state: 'ArmState') -> list[str]:
    """Return the bent segments and their angles; kinematics may still be unaware of them."""
    return [f'segment {n} by {degrees(angle):.0f} degrees'
            for n, angle in enumerate(state.bending_angles or (), 1)
            if abs(degrees(angle)) > STRAIGHT]
