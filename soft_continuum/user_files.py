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


def _folder(variable: str, default: str) -> Path:
    return Path(os.environ.get(variable) or Path.home() / default, 'soft_continuum')
