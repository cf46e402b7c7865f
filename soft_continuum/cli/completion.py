# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Tab completion by argcomplete, which ros2cli uses too.

Names of shapes come from a cache that ``soft_continuum shapes`` writes: TAB waits for no node.
"""

from collections.abc import Iterable, Sequence
from contextlib import suppress
import os
from pathlib import Path
import sys
from typing import Any

from soft_continuum.arguments import command_name, DONE, FAILED, Parser


def main(argv: Sequence[str] | None = None) -> int:
    """Print the completion script of a shell, or the cached names of the shapes."""
    parser = Parser('completion', 'Print the script for tab completion. For bash put this into '
                    '~/.bashrc: source <(soft_continuum completion bash)')
    parser.add_argument('what', choices=('bash', 'zsh', 'fish', 'shapes'),
                        help='the shell; shapes: the names that are offered after run')
    what = parser.parse_args(argv).what
    if what == 'shapes':
        print('\n'.join(cached_shapes()))
        return DONE
    try:
        from argcomplete.shell_integration import shellcode
    except ModuleNotFoundError:
        print(f'{command_name("completion")}: needs argcomplete; install python3-argcomplete '
              '(apt) or argcomplete (pip)', file=sys.stderr)
        return FAILED
    print(shellcode(['soft_continuum'], shell='bash' if what == 'zsh' else what))
    return DONE


def _cache() -> Path:
    folder = os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache'
    return Path(folder, 'soft_continuum', 'shapes')


def cached_shapes(**_: Any) -> list[str]:
    """Return the names of the shape library when it was last listed."""
    try:
        return _cache().read_text(encoding='utf-8').splitlines()
    except OSError:
        return []


def cache_shapes(names: Iterable[str]) -> None:
    """Keep the names of the shape library for the next TAB, where there is a cache."""
    with suppress(OSError):
        _cache().parent.mkdir(parents=True, exist_ok=True)
        _cache().write_text('\n'.join(names), encoding='utf-8')
