# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The log of the view, limited in lines whatever browsers and nodes send."""

import logging
from time import monotonic

LINES, PERIOD = 20, 10.0  # in so many s
LOG = logging.getLogger('soft_continuum.ui.browser')
SERVER_LOG = logging.getLogger('soft_continuum.ui.browser.server')
"""For websockets, without its tracebacks about messages from browsers."""


class _RateLimit(logging.Filter):
    """Passes LINES in PERIOD and counts the others."""

    def __init__(self) -> None:
        super().__init__()
        self._start, self._count = monotonic(), 0

    def filter(self, record: logging.LogRecord) -> bool:
        if record.msg == 'opening handshake failed':  # a browser that changed its mind
            return False
        now = monotonic()
        if now - self._start >= PERIOD:
            dropped = self._count - LINES
            self._start, self._count = now, 0
            if dropped > 0:
                record.msg = f'{record.msg}  ({dropped} such lines omitted)'
        self._count += 1
        if record.exc_info and record.name == SERVER_LOG.name:
            record.msg = f'{record.msg}: {type(record.exc_info[1]).__name__}'
            record.exc_info = None
        return self._count <= LINES


for _log in (LOG, SERVER_LOG):
    _log.addFilter(_RateLimit())
