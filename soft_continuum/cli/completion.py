# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Tab completion by argcomplete, which ros2cli uses too.

Names of shapes come from a cache that ``soft_continuum shapes`` writes, so TAB does not wait for
nodes.
"""

from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import Any

from soft_continuum.arguments import DONE, Parser
from soft_continuum.text import read_bytes
from soft_continuum.user_files import shape_names

MAX_CACHE = 100_000  # bytes


def main(argv: Sequence[str] | None = None) -> int:
    """Print the completion script of a shell."""
    parser = Parser('completion', 'Print the script for tab completion. For bash put this into '
                    '~/.bashrc: source <(soft_continuum completion bash)')
    parser.add_argument('shell', choices=('bash', 'zsh', 'fish'))
    shell = parser.parse_args(argv).shell
    from argcomplete.shell_integration import shellcode
    print(shellcode(['soft_continuum'], shell='bash' if shell == 'zsh' else shell))
    return DONE


def cached_shapes(**_: Any) -> list[str]:
    """Return the names in the shape library when it was last listed."""
    try:
        return read_bytes(shape_names(), MAX_CACHE).decode('utf-8').splitlines()
    except (OSError, ValueError):
        return []


def cache_shapes(names: Iterable[str]) -> None:
    """Cache the names in the shape library for the next TAB."""
    with suppress(OSError):
        shape_names().parent.mkdir(parents=True, exist_ok=True)
        shape_names().write_text('\n'.join(names), encoding='utf-8')
