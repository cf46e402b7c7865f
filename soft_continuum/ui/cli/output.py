# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Output of the verbs on a running arm: text, or JSON."""

from dataclasses import asdict
import json
from math import isfinite
import sys
from typing import Any, TYPE_CHECKING

from soft_continuum.parameters.arguments import DONE, FAILED, in_verbs, Parser

if TYPE_CHECKING:
    from soft_continuum.client.state import Progress

BAR_LENGTH = 24  # characters


class Output:
    """Prints text or, with ``--json``, one JSON document per line."""

    def __init__(self, parser: Parser, as_json: bool) -> None:
        """parser: reports failures to people."""
        self.as_json = as_json
        self._parser = parser
        self._bar = ''

    def print(self, text: str, **data: Any) -> None:
        """Print ``text``, or ``data`` as JSON."""
        self._end_bar()
        print(json.dumps(_plain(data)) if self.as_json else in_verbs(text), flush=True)

    def done(self, text: str = 'done') -> int:
        """Report success; return the exit status."""
        self.print(text, result='done', message=text)
        return DONE

    def fail(self, reason: object, status: int = FAILED) -> int:
        """Report failure; return the exit status."""
        if self.as_json:
            self.print('', result='failed', message=str(reason))
            return status
        self._end_bar()
        return self._parser.fail(reason, status)

    def progress(self, now: 'Progress', before: 'Progress | None') -> None:
        """Show the progress of a sequence: a bar on a terminal, else one line for each phase."""
        if self.as_json:
            self.print('', **asdict(now))
            return
        from soft_continuum.client.state import progress_text
        text = f'{100 * now.fraction:3.0f} %  {now.shape}, {progress_text(now)}'
        if sys.stdout.isatty():
            full = round(BAR_LENGTH * now.fraction)
            line = f'[{"#" * full}{"." * (BAR_LENGTH - full)}] {text}'
            print(f'\r{line:<{len(self._bar)}}', end='', flush=True)
            self._bar = line
        elif before is None or _step(now) != _step(before):
            print(text, flush=True)

    def _end_bar(self) -> None:
        if self._bar:
            print(flush=True)
            self._bar = ''


def _step(now: 'Progress') -> tuple[object, ...]:
    """Return the part of the progress that starts a new line when it changes."""
    return now.shape_index, now.segment, now.phase, now.correction


def _plain(value: Any) -> Any:
    """Return a value for JSON: nan becomes null."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not isfinite(value) else value
