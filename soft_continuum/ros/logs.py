# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Where ROS writes the logs of this suite, and how much of them is kept.

ROS makes a file for every process that starts and deletes none.
"""

from collections.abc import Mapping, MutableMapping
from contextlib import suppress
from pathlib import Path

FOLDER = 'ROS_LOG_DIR'
MAX_BYTES, MAX_FILES = 50_000_000, 500  # that are kept of what processes that ended have written


def choose_log_folder(environment: MutableMapping[str, str]) -> None:
    """Have ROS write into a folder of this suite, before it is initialised; the user's stays."""
    if not environment.get(FOLDER):
        environment[FOLDER] = str(_own_folder(environment))


def discard_old_logs(environment: Mapping[str, str], max_bytes: int = MAX_BYTES,
                     max_files: int = MAX_FILES) -> None:
    """
    Delete the logs that were written to least recently, beyond what is kept.

    A folder that the user has chosen is left alone.
    """
    folder = _own_folder(environment)
    if environment.get(FOLDER) != str(folder):
        return
    logs = []
    with suppress(OSError):
        for path in folder.glob('*.log'):
            with suppress(OSError):  # another process deletes, too
                about = path.lstat()
                logs.append((about.st_mtime, about.st_size, path))
    size = 0
    for number, (_, length, path) in enumerate(sorted(logs, reverse=True), 1):
        size += length
        if size > max_bytes or number > max_files:
            with suppress(OSError):
                path.unlink()


def _own_folder(environment: Mapping[str, str]) -> Path:
    return Path(environment.get('ROS_HOME') or Path.home() / '.ros', 'log', 'soft_continuum')
