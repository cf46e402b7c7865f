# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The tables of parameters in ``msg_docs/``, written from those of nodes and arm.

Each stands between two markers; ``python -m soft_continuum.nodes.reference`` rewrites them,
and so does ``./run docs``.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
import re

from soft_continuum.nodes.parameter_table import NODE_PARAMETERS
from soft_continuum.parameters.arm import ARM_PARAMETERS
from soft_continuum.parameters.parameter import Parameter
from soft_continuum.parameters.scalars import as_yaml
from soft_continuum.parameters.shapes import (
    direction_parameter,
    shape_parameter,
    vacuum_parameter,
)
from soft_continuum.ros.names import SHAPE_SEQUENCER

PAGES = Path(__file__).resolve().parents[2] / 'msg_docs'
COMMAND = 'python -m soft_continuum.nodes.reference'
START = f'<!-- table written by: {COMMAND} -->'
END = '<!-- end of table -->'
COLUMNS = ('name', 'type', 'default', 'unit', 'range', 'read-only', 'description')


def tables() -> Iterator[tuple[str, Sequence[Parameter]]]:
    """Return the name of each page and the parameters in its table."""
    yield 'parameters.md', ARM_PARAMETERS
    for node, parameters in NODE_PARAMETERS.items():
        shapes = ([shape_parameter('<name>'), direction_parameter('<name>'),
                   vacuum_parameter('<name>')]
                  if node == SHAPE_SEQUENCER else [])
        yield f'{node}.md', [*(p for p in parameters if p not in ARM_PARAMETERS), *shapes]


def table(parameters: Sequence[Parameter]) -> str:
    """Return the parameters as a table in Markdown."""
    rows = [COLUMNS, ('---',) * len(COLUMNS), *map(_row, parameters)]
    return '\n'.join(f'| {" | ".join(row)} |' for row in rows)


def _row(parameter: Parameter) -> tuple[str, ...]:
    listed = isinstance(parameter.default, tuple)
    default = '' if parameter.default == () else f'`{as_yaml(parameter.default, digits=6)}`'
    allowed = ('' if 'inf' in parameter.allowed else
               f'{"each " if listed else ""}{parameter.allowed}'
               f'{", rising" if parameter.is_range else ""}')
    description = re.sub(r'([|<])', r'\\\1', parameter.meaning)
    return (f'`{parameter.name}`', parameter.type_name, default, parameter.unit, allowed,
            'yes' if parameter.read_only else 'no', description)


def page_with_table(text: str, parameters: Sequence[Parameter]) -> str:
    """Return a page with its table up to date; raises ValueError when it has no place for one."""
    start, end = text.index(START) + len(START), text.index(END)
    return f'{text[:start]}\n\n{table(parameters)}\n\n{text[end:]}'


def main() -> None:
    """Write the tables into the pages."""
    for name, parameters in tables():
        page = PAGES / name
        page.write_text(page_with_table(page.read_text(encoding='utf-8'), parameters),
                        encoding='utf-8')


if __name__ == '__main__':
    main()
