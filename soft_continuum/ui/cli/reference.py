# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Tables in pages that are generated from the code: parameters, verbs, calls of the client.

Each stands between two markers; ``python -m soft_continuum.ui.cli.reference`` and ``./run docs``
rewrite them.
"""

from collections.abc import Iterable, Iterator, Sequence
import inspect
from pathlib import Path
import re

from soft_continuum.client import Arm
from soft_continuum.parameters.arm import ARM_PARAMETERS
from soft_continuum.parameters.parameter import Parameter
from soft_continuum.parameters.scalars import as_yaml
from soft_continuum.parameters.shapes import (
    direction_parameter,
    shape_parameter,
    vacuum_parameter,
)
from soft_continuum.ros.names import SHAPE_SEQUENCER
from soft_continuum.ros.parameter_table import NODE_PARAMETERS
from soft_continuum.ui.cli.main import GROUPS

ROOT = Path(__file__).resolve().parents[3]
COMMAND = 'python -m soft_continuum.ui.cli.reference'
START = f'<!-- table written by: {COMMAND} -->'
END = '<!-- end of table -->'
COLUMNS = ('name (*: can be changed at run time)', 'type and default', 'range', 'description')


def parameter_tables() -> Iterator[tuple[str, Sequence[Parameter]]]:
    """Return the name of each page in ``msg_docs/`` and the parameters in its table."""
    yield 'parameters.md', ARM_PARAMETERS
    for node, parameters in NODE_PARAMETERS.items():
        shapes = ([shape_parameter('<name>'), direction_parameter('<name>'),
                   vacuum_parameter('<name>')]
                  if node == SHAPE_SEQUENCER else [])
        yield f'{node}.md', [*(p for p in parameters if p not in ARM_PARAMETERS), *shapes]


def generated_pages() -> Iterator[tuple[Path, str]]:
    """Return every page that has a table, and the content of the table."""
    for name, parameters in parameter_tables():
        yield ROOT / 'msg_docs' / name, table(parameters)
    yield ROOT / 'docs/reference/command_line.md', markdown_table(('verb', 'function'), (
        row for group, verbs in GROUPS.items()
        for row in (('', f'**{group}**'), *((f'`{one.name}`', one.help) for one in verbs))))
    yield ROOT / 'docs/how_to/use_the_python_client.md', markdown_table(
        ('call', 'action'), map(_call, (name for name in vars(Arm) if name[0] != '_')))


def table(parameters: Sequence[Parameter]) -> str:
    """Return the parameters as a table in Markdown."""
    return markdown_table(COLUMNS, map(_row, parameters))


def markdown_table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown, without the last line feed."""
    return '\n'.join(f'| {" | ".join(row)} |' for row in (
        columns, ('---',) * len(columns), *rows))


def _call(name: str) -> tuple[str, str]:
    """Return a call of ``Arm`` with its arguments, and the first sentence of its docstring."""
    member = inspect.getattr_static(Arm, name)
    about = re.split(r'(?<=[^.])\.(?:\s|$)', inspect.getdoc(member) or '')[0].replace('``', '`')
    if isinstance(member, property):
        return f'`{name}`', about
    _, *arguments = inspect.signature(member).parameters.values()
    return f'`{name}({", ".join(str(a).split(":")[0] for a in arguments)})`', about


def _row(parameter: Parameter) -> tuple[str, ...]:
    name, kind, default, unit, allowed, _, description = cells(parameter)
    return (name if parameter.read_only else f'{name} *',
            ' '.join(filter(None, (kind, default, unit))),
            '' if isinstance(parameter.default, bool) else allowed, description)


def cells(parameter: Parameter) -> tuple[str, ...]:
    """Return name, type, default, unit, range, whether it is read-only, and description."""
    listed = isinstance(parameter.default, tuple)
    default = '' if parameter.default == () else f'`{as_yaml(parameter.default, digits=6)}`'
    allowed = ('' if 'inf' in parameter.allowed else
               f'{"each " if listed else ""}{parameter.allowed}'
               f'{", rising" if parameter.is_range else ""}')
    description = re.sub(r'([|<])', r'\\\1', parameter.meaning)
    return (f'`{parameter.name}`', parameter.type_name, default, parameter.unit, allowed,
            'yes' if parameter.read_only else 'no', description)


def page_with_table(text: str, content: str) -> str:
    """Return a page with its table up to date; raises ValueError when it has no place for one."""
    start, end = text.index(START) + len(START), text.index(END)
    return f'{text[:start]}\n\n{content}\n\n{text[end:]}'


def main() -> None:
    """Write the tables into the pages."""
    for page, content in generated_pages():
        page.write_text(page_with_table(page.read_text(encoding='utf-8'), content),
                        encoding='utf-8')


if __name__ == '__main__':
    main()
