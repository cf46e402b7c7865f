# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Where the files of a user are, by the XDG Base Directory Specification."""

import os
from pathlib import Path


def saved_shapes() -> Path:
    """Return where shapes and sequences are saved, whether there are any or not."""
    return _folder('XDG_CONFIG_HOME', '.config') / 'shapes.yaml'


def shape_names() -> Path:
    """Return where the names of the shape library are kept for the next TAB."""
    return _folder('XDG_CACHE_HOME', '.cache') / 'shapes'


def dynamixel_zeros() -> Path:
    """Return where the zeros of Dynamixel servos are kept for the time without their power."""
    return _folder('XDG_STATE_HOME', '.local/state') / 'dynamixel_zeros.json'


def config_home() -> Path:
    """Return where this user's programs have what they are configured with."""
    return _home('XDG_CONFIG_HOME', '.config')


def _folder(variable: str, default: str) -> Path:
    return _home(variable, default) / 'soft_continuum'


def _home(variable: str, default: str) -> Path:
    given = Path(os.environ.get(variable, ''))
    return given if given.is_absolute() else Path.home() / default  # as the specification says
