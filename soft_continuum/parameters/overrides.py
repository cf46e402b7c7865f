# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The values that parameter files and ``-p`` arguments set for a node, as rcl and rclpy read them.

Sections apply to the full name of a node, which ``*`` (one part of it) and ``**`` (any number)
in their names match.  Those of the same name are one section.  If several set a parameter,
the last wins, in the order in which their names appear first, over all files and arguments: so
``/**`` in a second file does not win over ``/kinematics`` in the first, where ``/**`` came first.

Files that rcl takes for something else than they say are refused: a key twice in one mapping,
lists in lists, keys beside ros__parameters.  YAML that not every libyaml reads is refused too.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
import re
from typing import Any, Self

import yaml

from soft_continuum.parameters.parameter import MAX_SHOWN, ParameterError
from soft_continuum.parameters.scalars import read_scalar, Scalar
from soft_continuum.text import printable, read_bytes

MAX_DEPTH = 20  # keys below one another in a parameter file
MAX_SIZE = 100_000  # bytes of such a file
PARAMETERS = 'ros__parameters'
ALL_NODES = '/**'
ANY_NODE = '_'
"""Stands for a node of any name: only sections for all nodes of its namespace apply to it."""
SECTION = re.compile(r'/?(?:(?:\*\*?|[A-Za-z_]\w*)/)*(?:\*\*?|[A-Za-z_]\w*)', re.ASCII)
PART = r'(?:/|(?!__)[A-Za-z_]\w*(?!\w))'
TARGET = re.compile(
    r'(?!ros(?:service|topic)://|.*___)(?:((?!\w*__)[A-Za-z_]\w*):)?'
    rf'({PART}+(?:\.{PART}+)*)', re.ASCII)
"""What an argument ``-p`` may name: a node without namespace if it is for one, a parameter."""
REMAPPED = re.compile(r'(?:(\w+):)?__(ns|node|name):=(.*)')
KINDS = (bool, int, float, str)  # rclpy takes the first of which there is a value
TEXT_TAG = 'tag:yaml.org,2002:str'

Given = Scalar | list[Any] | None
"""A value that is given; None for an empty list, which to ROS is a parameter without value."""
Pairs = list[tuple[str, yaml.Node]]


def full_name(node: str = '', namespace: str = '') -> str:
    """Return the full name of a node, or one that stands for all nodes of a namespace."""
    return '/'.join(['', *filter(None, [namespace.strip('/')]), node or ANY_NODE])


class Loader(yaml.SafeLoader):  # type: ignore[misc]
    """Reads YAML without aliases, as ROS does: a few of them can stand for gigabytes."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Return the next node, unless it is an alias."""
        if self.check_event(yaml.AliasEvent):
            event = self.peek_event()
            raise yaml.composer.ComposerError(
                None, None, f'ROS reads no alias (*{event.anchor}); write the value out',
                event.start_mark)
        return super().compose_node(parent, index)


class _Untyped(Loader):
    """Leaves it to rcl what the type of a scalar is: a tag is one that is written out."""

    def resolve(self, *_: Any) -> str:
        return ''

    def process_directives(self) -> Any:
        directive, found = self.peek_token(), super().process_directives()
        if self.yaml_version not in (None, (1, 1)):
            raise yaml.parser.ParserError(None, None, 'ROS may read YAML 1.1 alone; delete this '
                                          'line', directive.start_mark)
        return found

    def scan_directive_name(self, start_mark: Any) -> Any:
        name = super().scan_directive_name(start_mark)
        if name not in ('YAML', 'TAG'):
            raise yaml.scanner.ScannerError(
                None, None, f'ROS does not know %{printable(name, MAX_SHOWN)}; delete this line',
                start_mark)
        return name

    def scan_plain(self) -> Any:
        token = super().scan_plain()
        if self.flow_level and (':' in token.value or (
                self.peek() == ':' and self.peek(1) in ',[]{}')):
            raise yaml.scanner.ScannerError(
                None, None, f'ROS may not read {printable(token.value, MAX_SHOWN)}, with a colon '
                'between brackets; quote it, and write a blank behind that of a key',
                token.start_mark)
        return token


@dataclass
class _Entry:
    """A parameter of a section: of every kind the last value, and where that was given."""

    name: str
    values: dict[tuple[bool, int], Any] = field(default_factory=dict)
    where: str = ''

    @property
    def value(self) -> Given:
        return self.values[min(self.values)] if self.values else None


class Overrides:
    """What files and arguments set, for nodes of any name."""

    def __init__(self, *paths: str | Path) -> None:
        """Read parameter files; raises ParameterError naming the file, and the line or key."""
        self._sections: dict[str, list[_Entry]] = {}
        self.files: dict[str, list[str]] = {}
        """The sections that each file has."""
        for path in paths:
            self.add_file(path)

    @classmethod
    def of_arguments(cls, arguments: Sequence[str]) -> Self:
        """Read what stands in ROS arguments; raises ParameterError as well for these."""
        overrides = cls()
        for option, text in _ros_options(arguments):
            if option == '--params-file':
                overrides.add_file(text)
            elif option in ('-p', '--param'):
                overrides.add_argument(text)
        return overrides

    def fresh_section(self) -> str:
        """Return the name of a section for all nodes that wins over those that there are."""
        name = ALL_NODES
        while name in self._sections:
            name += ALL_NODES
        return name

    def of(self, node: str) -> dict[str, tuple[Given, str]]:
        """Return the values for a node, by its full name: of each parameter, and from where."""
        return {entry.name: (entry.value, entry.where)
                for name, entries in self._sections.items() if applies(name, node)
                for entry in entries}

    def last_section(self, node: str, parameter: str) -> tuple[str, str]:
        """Return the section whose value of a parameter a node gets, and from where that is."""
        return next((name, entry.where) for name, entries in reversed(self._sections.items())
                    for entry in entries if entry.name == parameter and applies(name, node))

    def add_file(self, path: str | Path) -> None:
        """Read one more file."""
        try:
            documents = parse_yaml(path, lambda text: list(yaml.compose_all(text, _Untyped)))
        except OSError as error:
            raise ParameterError(f'{path}: cannot be read: {error.strerror}') from None
        if not documents or not all(isinstance(d, yaml.MappingNode) for d in documents):
            raise ParameterError(
                f'{path}: a parameter file starts with a node name, or /** for all nodes')
        self.files.setdefault(str(path), [])
        for document in documents:
            self._add_nodes(str(path), self._pairs(str(path), document), '', '')

    def add_argument(self, text: str) -> None:
        """Read one more ``-p [node:]parameter:=value``."""
        before, _, value = text.partition(':=')
        target = TARGET.fullmatch(before)
        try:
            node = yaml.compose(value, _Untyped)
        except yaml.YAMLError:
            node = None
        if target is None or node is None or isinstance(node, yaml.MappingNode):
            raise ParameterError(f'argument -p {text}: expected parameter:=value, or '
                                 'node:parameter:=value with the name of a node alone')
        entries = self._sections.setdefault(target[1] or ALL_NODES, [])
        _set_value(f'argument -p {text}', _find(entries, target[2]), node)

    def _pairs(self, path: str, tree: yaml.MappingNode) -> Pairs:
        for key, _ in tree.value:
            if not isinstance(key, yaml.ScalarNode) or not key.value or '\0' in key.value:
                raise ParameterError(f'{path}, line {key.start_mark.line + 1}: expected a name '
                                     'before the colon')
        return [(key.value, value) for key, value in tree.value]

    def _add_nodes(self, path: str, pairs: Pairs, above: str, top: str) -> str:
        """Read names of nodes, below a namespace; return that as rcl has it at their end."""
        for key, tree in pairs:
            name = f'{above}{"" if above.endswith("/") else "/"}{key}' if above else key
            first = top or key
            children = self._pairs(path, tree) if isinstance(tree, yaml.MappingNode) else []
            if not children or key.startswith(PARAMETERS) or name.count('/') > MAX_DEPTH:
                raise ParameterError(f'{path}: key {printable(first)}: expected {PARAMETERS} '
                                     'below it')
            inner = name
            if PARAMETERS not in dict(children):
                inner = self._add_nodes(path, children, name, first)
            elif len(children) > 1:
                raise ParameterError(f'{path}: key {printable(name)}: {PARAMETERS} has to stand '
                                     'alone below it')
            elif not SECTION.fullmatch(name):
                raise ParameterError(
                    f'{path}: key {printable(name)}: is no name of nodes; such are kinematics, '
                    '/left/kinematics, /left/*, /**')
            else:
                self.files[path].append(name)
                self._add_parameters(
                    path, self._sections.setdefault(name, []), children[0][1], '')
            above = inner.rpartition('/')[0] if above else ''
        return above

    def _add_parameters(self, path: str, entries: list[_Entry], tree: yaml.Node, group: str
                        ) -> str:
        """Read parameters, below a group; return that as rcl has it at their end."""
        if not isinstance(tree, yaml.MappingNode) or (group and not tree.value):
            raise ParameterError(
                f'{path}: key {printable(group or PARAMETERS)}: expected keys below it')
        if group.count('.') > MAX_DEPTH:
            raise ParameterError(f'{path}: keys are nested too deeply: {group[:40]}...')
        seen: set[str] = set()
        for (key, value), (at, _) in zip(self._pairs(path, tree), tree.value, strict=True):
            entry = _find(entries, group or key)
            entry.name = f'{group}.{key}' if group else key
            if key in seen:
                raise ParameterError(f'{path}, line {at.start_mark.line + 1}: key '
                                     f'{printable(entry.name)} stands there twice')
            seen.add(key)
            if isinstance(value, yaml.MappingNode):
                inner = self._add_parameters(path, entries, value, entry.name)
                group = inner.rpartition('.')[0] if group else ''
            else:
                _set_value(path, entry, value)
        return group


def applies(section: str, node: str) -> bool:
    """Return whether the section of a parameter file applies to a node, by its full name."""
    pattern = '/' + section.removeprefix('/')
    return re.fullmatch(pattern.replace('/*', r'(/\w+)'), node, re.ASCII) is not None


def full_name_of(arguments: Sequence[str], node: str, namespace: str = '') -> str:
    """Return the full name that a node has with these ROS arguments, or else with its own."""
    found = {'ns': namespace, 'node': node}
    rules = [REMAPPED.fullmatch(text) for option, text in _ros_options(arguments)
             if option in ('-r', '--remap')]
    for rule in filter(None, reversed(rules)):  # the first one wins
        if rule[1] in (None, node):
            found['ns' if rule[2] == 'ns' else 'node'] = rule[3]
    return full_name(found['node'], found['ns'])


def _ros_options(arguments: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Return every option of ROS that has a value, with that."""
    words, of_ros = iter(arguments), False
    for word in words:
        if word in ('--ros-args', '--'):
            of_ros = word == '--ros-args'
        elif of_ros and word in ('-p', '--param', '--params-file', '-r', '--remap'):
            yield word, next(words, '')
        elif not of_ros and REMAPPED.fullmatch(word):
            yield '--remap', word  # which rcl still takes for one


def _find(entries: list[_Entry], name: str) -> _Entry:
    """Return the first entry of that name, or a new one, as rcl does for two."""
    for entry in entries:
        if entry.name == name:
            return entry
    entries.append(_Entry(name))
    return entries[-1]


def _set_value(where: str, entry: _Entry, node: yaml.Node) -> None:
    key, listed = printable(entry.name), isinstance(node, yaml.SequenceNode)
    items = []
    for item in node.value if listed else [node]:
        if not isinstance(item, yaml.ScalarNode):
            raise ParameterError(f'{where}: key {key}: expected values in the list')
        quoted = item.style in ("'", '"')
        if not quoted and not item.value:
            raise ParameterError(f'{where}: key {key} has no value')
        if '\0' in item.value:
            raise ParameterError(f'{where}: key {key}: a text ends where it has \\0')
        items.append(read_scalar(item.value, quoted or item.tag == TEXT_TAG))
    if len(types := {type(item) for item in items}) > 1:
        decimal = '; write 0.0 rather than 0' if types == {int, float} else ''
        raise ParameterError(f'{where}: parameter {key} is {printable(str(items), MAX_SHOWN)}; '
                             f'allowed: a list of values of one type{decimal}')
    if items:
        entry.values[listed, KINDS.index(type(items[0]))] = items if listed else items[0]
    entry.where = where


def parse_yaml(path: str | Path, parse: Any) -> Any:
    """
    Return what ``parse`` makes of the text of a small file.

    Raises OSError for a file that cannot be read, ParameterError, naming the file and the line,
    for one that is not YAML.
    """
    try:
        return parse(read_bytes(path, MAX_SIZE).decode('utf-8'))
    except UnicodeDecodeError as error:
        raise ParameterError(f'{path}: is not UTF-8 text: {error.reason}') from None
    except yaml.YAMLError as error:
        mark = getattr(error, 'problem_mark', None)
        where = f', line {mark.line + 1}, column {mark.column + 1}' if mark else ''
        raise ParameterError(
            f'{path}{where}: not valid YAML: {getattr(error, "problem", error)}') from None
    except (ValueError, LookupError, AttributeError, TypeError, RecursionError) as error:
        # Of PyYAML for values that it cannot construct, of Path for paths that it cannot open.
        raise ParameterError(f'{path}: not valid YAML: {type(error).__name__} {error}') from None
