# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
ROS 2 parameter files, which describe arm and rig, read and written without ROS.

Such a file is YAML: node names (``/**`` for all), below them ``ros__parameters``, below that
nested keys; parameters.overrides reads it.  A key that no table of parameters has is refused.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
import re
from textwrap import wrap
from typing import Any

import yaml

from soft_continuum.mechanics.arm import Arm
from soft_continuum.nodes.parameter_table import (
    ALL_PARAMETERS,
    default_frame,
    DESCRIBED,
    FRAME,
    jamming_settings,
    NODE_PARAMETERS,
)
from soft_continuum.parameters.arm import arm_from_parameters, ARM_PARAMETERS
from soft_continuum.parameters.overrides import (
    ALL_NODES,
    applies,
    full_name,
    Loader,
    Overrides,
    parse_yaml,
)
from soft_continuum.parameters.parameter import name_hint, Parameter, ParameterError, Value
from soft_continuum.parameters.scalars import as_yaml, read_scalar
from soft_continuum.parameters.shapes import (
    DIRECTION_PREFIX,
    SHAPE_PREFIX,
    shapes_from_parameters,
    VACUUM_PREFIX,
)
from soft_continuum.text import MAX_NAME, printable, write_whole

WIDTH = 99  # of the comments in one
NUMERIC = '+-.0123456789'  # first characters of numbers

FOREIGN = re.compile(r'\A%YAML:|(?<=\n)---\s*\Z')
"""What OpenCV writes at the beginning, and `ros2 topic echo` at the end."""
UNCHECKED = (SHAPE_PREFIX, DIRECTION_PREFIX, VACUUM_PREFIX, 'qos_overrides.')
"""Prefixes of names that are allowed without being in a table."""
OF_ROS = (
    Parameter('use_sim_time', False, 'whether to use the time of the topic /clock'),
    Parameter('start_type_description_service', True, 'whether to offer the service '
              '~/get_type_description'),
)
"""Parameters that ROS adds to every node."""


def load_description(*paths: str | Path, node: str = '', namespace: str = ''
                     ) -> dict[str, Value]:
    """
    Read description files as a node sees them; later ones win.

    node: its name; without one, what is said for all nodes of the namespace.  Raises
    ParameterError naming the file and the key: also for keys that no node has, lists that do not
    fit together, shapes outside the limits, thresholds in the wrong order, and an arm that a node
    would read otherwise.
    """
    overrides, name = Overrides(*paths), full_name(node, namespace)
    for path, sections in overrides.files.items():  # a node may find nothing in a file
        if not node and not any(applies(section, name) for section in sections):
            which = f'of {namespace}, only for' if namespace else 'only for'
            raise ParameterError(f'{path}: has no section for all nodes (/**), {which} '
                                 f'{", ".join(sections)}; name the namespace of the arm')
    for other in () if node else DESCRIBED:
        described(overrides, full_name(other, namespace))
    return described(overrides, name)


def described(overrides: Overrides, node: str, alone: bool = False) -> dict[str, Value]:
    """
    Return every parameter for a node, by its full name; raises as load_description does.

    alone: these are all that it gets, so a section of its name may describe the arm: launch_ros
    and ros2 param dump write such sections.
    """
    namespace = node.rpartition('/')[0]
    values: dict[str, Value] = {p.name: p.default for p in ALL_PARAMETERS}
    values[FRAME.name] = default_frame(namespace)
    values |= given_parameters(overrides, (*ALL_PARAMETERS, *OF_ROS), node, UNCHECKED)
    try:
        arm = arm_from_parameters(values)
        shapes_from_parameters(values, arm)
        jamming_settings(values)
    except ParameterError as error:
        paths = ', '.join(dict.fromkeys(where for _, where in overrides.of(node).values()))
        raise ParameterError(f'{paths}: {error}') from None
    everywhere = overrides.of(full_name('', namespace))
    for p in ARM_PARAMETERS:
        value = everywhere.get(p.name, (p.default, ''))[0]
        if values[p.name] != (tuple(value) if isinstance(value, list) else value):
            section, path = overrides.last_section(node, p.name)
            if alone and section.strip('/') == node.strip('/'):
                continue
            raise ParameterError(
                f'{path}: section {section} sets {p.name} for {node.rpartition("/")[2]} alone, '
                'which is not the arm that other nodes and commands read; write it below '
                f'{full_name("**", namespace)}')
    return values


def load_arm(*paths: str | Path, namespace: str = '') -> Arm:
    """Read an arm from description files; raises ParameterError as load_description does."""
    return arm_from_parameters(load_description(*paths, namespace=namespace))


def load_rig(paths: Sequence[str | Path], namespace: str = '') -> dict[str, Value]:
    """
    Return every parameter as the node that has it reads it from ``paths``; later files win.

    Raises ParameterError as load_description does, and for a parameter that two nodes would read
    differently.
    """
    overrides = Overrides(*paths)
    values: dict[str, Value] = {}
    owners: dict[str, str] = {}
    for node, table in NODE_PARAMETERS.items():
        seen = described(overrides, full_name(node, namespace))
        for name in (p.name for p in table):
            owner = owners.setdefault(name, node)
            if values.setdefault(name, seen[name]) != seen[name]:
                raise ParameterError(
                    f'parameter {name} is {values[name]} for {owner} and {seen[name]} for {node}; '
                    'write it once, below /**')
    return values


def write_parameters(path: Path, values: Mapping[str, Value], comments: Sequence[str],
                     notes: Mapping[str, str] | None = None, digits: int = 8) -> None:
    """Write parameters_text to a file, whole or not at all."""
    write_whole(path, parameters_text(values, comments, notes, digits))


def parameters_text(values: Mapping[str, Value], comments: Sequence[str],
                    notes: Mapping[str, str] | None = None, digits: int = 8,
                    section: str = ALL_NODES) -> str:
    """
    Return a parameter file, for all nodes unless ``section`` names others.

    values: by dotted names; those of a group come where its first one does: a key that is there
    twice is none that can be read.  comments: lines at the top.  notes: of parameters, by their
    names, which become comments above them.  digits: of numbers.
    """
    lines = [f'# {" ".join(comment.splitlines())}'.rstrip() for comment in comments]
    lines += [f'{section}:', '  ros__parameters:']
    group = ''
    groups = list(dict.fromkeys(name.rpartition('.')[0] for name in values))
    for name, value in sorted(
            values.items(), key=lambda item: groups.index(item[0].rpartition('.')[0])):
        above, _, key = name.rpartition('.')
        if above != group:
            group = above
            lines += [f'    {group}:'] if group else ['']
        indent = 6 * ' ' if group else 4 * ' '
        lines += wrap((notes or {}).get(name, ''), WIDTH, initial_indent=f'{indent}# ',
                      subsequent_indent=f'{indent}# ')
        lines.append(f'{indent}{key}: {as_yaml(value, digits)}')
    return '\n'.join(lines) + '\n'


def given_parameters(overrides: Overrides, known: Sequence[Parameter], node: str,
                     prefixes: Sequence[str] = ()) -> dict[str, Value]:
    """
    Return what is set for a node, by its full name; checked, by dotted names.

    Names that start with one of ``prefixes`` are not checked, and left out where they have no
    value.  Raises ParameterError naming the file and the key that is not allowed.
    """
    values: dict[str, Value] = {}
    table = {p.name: p for p in known}
    for name, (value, where) in overrides.of(node).items():
        try:
            if name in table:
                if value is None:
                    raise ParameterError(f'parameter {name} is []; ROS takes an empty list for no '
                                         'value: leave the line out')
                values[name] = table[name].check(value)
            elif not name.startswith(tuple(prefixes)):
                raise ParameterError(f'unknown parameter {printable(name)}' + (
                    name_hint(name, table) or _known(name, table)))
            elif value is not None:
                values[name] = value  # type: ignore[assignment]
        except ParameterError as error:
            raise ParameterError(f'{where}: {error}') from None
    return values


def _known(name: str, table: Iterable[str]) -> str:
    """Return which parameters there are in the group of an unknown one, or which groups."""
    group = name.partition('.')[0] + '.'
    found = [known for known in table if known.startswith(group)] or {
        f'{first}.*' if dot else first for first, dot, _ in (k.partition('.') for k in table)}
    return f'; known: {", ".join(sorted(found))}'


class _Loader(Loader):
    """Reads numbers as rcl does: 1e-3 is one, 1_000 and 1:30 are texts.  Keys are unique."""

    yaml_implicit_resolvers = {first: found for first, found
                               in Loader.yaml_implicit_resolvers.items() if first not in NUMERIC}

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        """Return the next mapping; of equal keys PyYAML would take the last."""
        node, seen = super().compose_mapping_node(anchor), set()
        for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
            if key.value in seen:
                raise yaml.composer.ComposerError(
                    None, None, f'key {printable(key.value, MAX_NAME)} stands there twice; '
                    'delete or rename one', key.start_mark)
            seen.add(key.value)
        return node


_Loader.add_implicit_resolver('tag:yaml.org,2002:float', re.compile('.'), list(NUMERIC))
_Loader.add_constructor('tag:yaml.org,2002:opencv-matrix', yaml.SafeLoader.construct_yaml_map)
_Loader.add_constructor('tag:yaml.org,2002:float', lambda _, node: read_scalar(node.value))


def read_yaml(path: str | Path) -> Any:
    """
    Return what a small YAML file without aliases holds, also of OpenCV or `ros2 topic echo`.

    Raises OSError for a file that cannot be read, ParameterError, naming the file and the line,
    for one that is not YAML.
    """
    return parse_yaml(path, lambda text: yaml.load(FOREIGN.sub('#', text), _Loader))
