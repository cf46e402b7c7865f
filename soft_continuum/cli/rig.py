# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The parameter files of a rig: reads them as its nodes do, writes results as another one."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
import os
from pathlib import Path
from typing import Any

from soft_continuum.parameters.files import load_description
from soft_continuum.parameters.nodes import NODE_PARAMETERS
from soft_continuum.parameters.parameter import ParameterError


def rig_parameters(paths: Sequence[Path]) -> dict[str, Any]:
    """
    Return every parameter as the node that has it reads it from ``paths``; later files win.

    Raises ParameterError as load_description does, and for a parameter that two nodes would read
    differently.
    """
    values: dict[str, Any] = {}
    owners: dict[str, str] = {}
    for node, table in NODE_PARAMETERS.items():
        seen = load_description(*paths, node=node)
        for name in (p.name for p in table):
            owner = owners.setdefault(name, node)
            if values.setdefault(name, seen[name]) != seen[name]:
                raise ParameterError(
                    f'parameter {name} is {values[name]} for {owner} and {seen[name]} for {node}; '
                    'write it once, below /**')
    return values


def as_list(values: tuple[float, ...]) -> str:
    """Return numbers as ROS reads a list of doubles: each with a decimal point."""
    return f'[{", ".join(f"{value:.8g}" if value % 1 else f"{value:.1f}" for value in values)}]'


def write_parameters(path: Path, results: Mapping[str, tuple[float, ...] | float],
                     comment: str) -> None:
    """Write a ROS 2 parameter file for all nodes, whole or not at all."""
    lines = [f'# {comment}', '/**:', '  ros__parameters:']
    group = ''
    for name, value in results.items():
        section, key = name.split('.')
        if section != group:
            group = section
            lines.append(f'    {group}:')
        text = as_list(value) if isinstance(value, tuple) else f'{value:#.5g}'
        lines.append(f'      {key}: {text}')
    partial = path.with_name(f'.{path.name}.{os.getpid()}')
    try:
        partial.write_text('\n'.join(lines) + '\n', encoding='utf-8')
        os.replace(partial, path)
    finally:
        with suppress(FileNotFoundError):
            partial.unlink()
