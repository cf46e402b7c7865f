# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What ends a run, or a plan of it, early."""

from soft_continuum.sequencing.progress import Code


class EndError(Exception):
    """Ends the run with a code and a reason."""

    def __init__(self, code: Code, message: str) -> None:
        super().__init__(message)
        self.code = code


class LeaveError(EndError):
    """The plan must not be followed any further; ends the run unless there is another one."""
