# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The log folder of this suite, and its clean-up.

ROS creates a file for every process and deletes none.
"""

from collections.abc import Mapping, MutableMapping
from contextlib import suppress
from errno import EACCES
import os
from pathlib import Path

from soft_continuum.parameters.parameter import ParameterError

FOLDER = 'ROS_LOG_DIR'
MAX_BYTES, MAX_FILES = 50_000_000, 500  # that are kept of what processes that ended have written


def choose_log_folder(environment: MutableMapping[str, str]) -> None:
    """Set the log folder of this suite before ROS is initialised, unless the user set one."""
    if not environment.get(FOLDER):
        environment[FOLDER] = str(_own_folder(environment))


def require_log_folder(environment: Mapping[str, str]) -> None:
    """Raise ParameterError if ROS cannot write logs, without which it does not start."""
    folder = Path(environment.get(FOLDER) or _ros_home(environment) / 'log')
    reason = os.strerror(EACCES)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK | os.X_OK):
            return
    except OSError as error:
        reason = error.strerror or str(error)
    raise ParameterError(f'ROS cannot write its logs to {folder}: {reason}; set {FOLDER} to a '
                         'folder that can be written')


def discard_old_logs(environment: Mapping[str, str], max_bytes: int = MAX_BYTES,
                     max_files: int = MAX_FILES) -> None:
    """
    Delete the oldest logs beyond the limit.

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
    return _ros_home(environment) / 'log' / 'soft_continuum'


def _ros_home(environment: Mapping[str, str]) -> Path:
    return Path(environment.get('ROS_HOME') or Path.home() / '.ros')
