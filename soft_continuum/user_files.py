# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Locations of files: of the user (XDG Base Directory Specification), and of the package."""

import os
from pathlib import Path


def saved_shapes() -> Path:
    """Return the path for saved shapes and sequences, which may not exist."""
    return _folder('XDG_CONFIG_HOME', '.config') / 'shapes.yaml'


def shape_names() -> Path:
    """Return the path of the cached names of the shape library, for TAB completion."""
    return _folder('XDG_CACHE_HOME', '.cache') / 'shapes'


def dynamixel_zeros() -> Path:
    """Return the path of the zeros of Dynamixel servos, kept while they have no power."""
    return _folder('XDG_STATE_HOME', '.local/state') / 'dynamixel_zeros.json'


def config_home() -> Path:
    """Return the configuration directory of the user."""
    return _home('XDG_CONFIG_HOME', '.config')


def pages() -> Path:
    """Return the folder with docs/ and msg_docs/, of the sources or installed."""
    above = Path(__file__).resolve().parents
    return next((folder for parent in above for folder in (parent, parent / 'share/soft_continuum')
                 if (folder / 'msg_docs').is_dir()), above[1])


def description_file(arm: str = 'manipulator') -> Path:
    """Return the path of a shipped description, by default of the paper's arm."""
    return pages() / 'config' / f'{arm}.yaml'


def _folder(variable: str, default: str) -> Path:
    return _home(variable, default) / 'soft_continuum'


def _home(variable: str, default: str) -> Path:
    given = Path(os.environ.get(variable, ''))
    return given if given.is_absolute() else Path.home() / default  # as the specification says
