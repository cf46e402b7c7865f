# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The bar at the top of the page: STOP, Resume, whether the arm may move, the newest message.

It is not part of viser's page but above it, with its own connection, so no element of viser can
cover or remove STOP.
"""

import asyncio
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
import json
from math import inf
from pathlib import Path
from time import monotonic

from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed

from soft_continuum.client.estimate import anomaly_text
from soft_continuum.client.observed import STALE_AFTER
from soft_continuum.client.state import ArmState, progress_text
from soft_continuum.client.tasks import HOW_TO_START
from soft_continuum.ros.names import TENDON_ACTUATION
from soft_continuum.ui.browser.limits import LOG, RateLimiter
from soft_continuum.ui.browser.session import Notice, notice_text

PAGE = Path(__file__).with_name('page.html').read_text(encoding='utf-8')
PATH = '/bar'
MAX_ALARMS, ALARM_LENGTH = 3, 160  # shown below the bar, and characters of each
CHECK_PERIOD = 0.1  # s between two checks for changes
REMEDY = (f'{HOW_TO_START[0].upper()}{HOW_TO_START[1:]}; this page then continues.'
          .replace('`', ''))
SEND_PERIOD = 1.0  # s until it is sent again, as a heartbeat of the connection


@dataclass(frozen=True)
class BarState:
    """
    Content of the bar; kind: 'ready', 'moving', 'stopped', 'lost' or 'replay'.

    alarm: anomalies of the arm, one in each line, below the bar.
    """

    kind: str
    headline: str
    text: str = ''
    notice: str = ''
    problem: bool = False
    may_resume: bool = False
    alarm: str = ''


LOST = BarState('lost', 'No data from the arm',
                'The view has stopped following it. Press STOP, then start the view again.')


def bar_state(state: ArmState, notices: Iterable[Notice] = ()) -> BarState:
    """Return the content of the bar for an arm, with the last of the recent notices."""
    kind, headline, text = _motion(state)
    may_resume = kind == 'stopped' and not state.emergency_stop
    missing = [node.name for node in state.nodes if node.stale]
    if len(missing) == len(state.nodes):
        text = f'No node is running. {REMEDY}'
    elif missing:
        text = f'{text} Not running: {", ".join(missing)}. {REMEDY}'.strip()
    alarm = alarm_text(state)
    new = [notice for notice in notices if notice.is_new]
    if not new:
        return BarState(kind, headline, text, may_resume=may_resume, alarm=alarm)
    last, more = new[-1], sum(notice.count for notice in new[:-1])
    return BarState(kind, headline, text, f'{last.title}: {last.text}{last.times}'
                    + (f' (+{more} under Messages)' if more else ''), last.is_problem,
                    may_resume, alarm)


def alarm_text(state: ArmState) -> str:
    """Return the anomalies of the arm, one in each line; empty for none."""
    anomalies = state.estimate.anomalies if state.estimate else ()
    lines = [notice_text(anomaly_text(anomaly), ALARM_LENGTH) for anomaly in anomalies]
    if len(lines) > MAX_ALARMS:
        lines[MAX_ALARMS:] = [f'{len(lines) - MAX_ALARMS} more under Measured shape']
    return '\n'.join(f'{line[:1].upper()}{line[1:]}' for line in lines)


def _motion(state: ArmState) -> tuple[str, str, str]:
    """Return kind, headline and text for whether the arm may move."""
    if state.stopped is None or state.node(TENDON_ACTUATION).stale:
        return 'lost', 'Arm state unknown', ''
    if state.stopped:
        remedy = ('the emergency stop is reset where it was triggered and you press Resume'
                  if state.emergency_stop else 'you press Resume')
        return 'stopped', 'STOPPED', f'{notice_text(state.stopped)}. Nothing moves until {remedy}.'
    if state.progress is not None:
        return ('moving', f'Setting {notice_text(state.progress.shape)}',
                notice_text(progress_text(state.progress)))
    return 'ready', 'Ready', ''


class Bar:
    """
    Sends the content of the bar to every page, and receives ``stop`` and ``resume``.

    commands: what these do; called on the thread of the server.
    """

    def __init__(self) -> None:
        """Show that the state is unknown."""
        self.commands: dict[str, Callable[[], None]] = {}
        self._shown, self._since = LOST, -inf

    def show(self, state: BarState) -> None:
        """Show a state, from any thread; call it again before STALE_AFTER."""
        self._shown, self._since = state, monotonic()

    async def follow(self, connection: ServerConnection) -> None:
        """Serve the bar of one page until the page is closed."""
        sender, limiter = asyncio.create_task(self._send(connection)), RateLimiter()
        try:
            async for word in connection:
                await limiter.keep()
                command = self.commands.get(word) if isinstance(word, str) else None
                if command is None:
                    LOG.warning('dropped a message that is neither stop nor resume: %.40r', word)
                else:
                    command()
        except ConnectionClosed:
            pass
        finally:
            sender.cancel()

    async def _send(self, connection: ServerConnection) -> None:
        sent, when = None, -inf
        while True:
            shown = self._shown if monotonic() - self._since < STALE_AFTER else LOST
            if shown != sent or monotonic() - when >= SEND_PERIOD:
                sent, when = shown, monotonic()
                await connection.send(json.dumps(asdict(shown)))
            await asyncio.sleep(CHECK_PERIOD)
