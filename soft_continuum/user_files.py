# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Where files are: a user's, by the XDG Base Directory Specification, and those of the package."""

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


def pages() -> Path:
    """Return the folder with docs/ and msg_docs/: the sources, or what is installed of them."""
    above = Path(__file__).resolve().parents
    return next((folder for parent in above for folder in (parent, parent / 'share/soft_continuum')
                 if (folder / 'msg_docs').is_dir()), above[1])


def description_file(arm: str = 'manipulator') -> Path:
    """Return a shipped description, by default that of the arm of the paper."""
    return pages() / 'config' / f'{arm}.yaml'


def _folder(variable: str, default: str) -> Path:
    return _home(variable, default) / 'soft_continuum'


def _home(variable: str, default: str) -> Path:
    given = Path(os.environ.get(variable, ''))
    return given if given.is_absolute() else Path.home() / default  # as the specification says
