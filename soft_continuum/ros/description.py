# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Arm and rig, as parameter files describe them to each node, read without ROS."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from soft_continuum.mechanics.arm import Arm
from soft_continuum.parameters.arm import arm_from_parameters, ARM_PARAMETERS
from soft_continuum.parameters.files import given_parameters
from soft_continuum.parameters.overrides import applies, full_name, full_name_of, Overrides
from soft_continuum.parameters.parameter import Parameter, ParameterError, Value
from soft_continuum.parameters.shapes import (
    DIRECTION_PREFIX,
    SHAPE_PREFIX,
    shapes_from_parameters,
    VACUUM_PREFIX,
)
from soft_continuum.ros.parameter_table import (
    ALL_PARAMETERS,
    default_frame,
    DESCRIBED,
    FRAME,
    jamming_settings,
    NODE_PARAMETERS,
)

SHAPES = (SHAPE_PREFIX, DIRECTION_PREFIX, VACUUM_PREFIX)
UNCHECKED = (*SHAPES, 'qos_overrides.')
"""Prefixes of names that are allowed without being in a table."""
OF_ROS = (
    Parameter('use_sim_time', False, 'whether to use the time of the topic /clock'),
    Parameter('start_type_description_service', True, 'whether to offer the service '
              '~/get_type_description'),
)
"""Parameters that ROS adds to every node."""
DEFAULTS = {p.name: p.default for p in ALL_PARAMETERS}


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
    values: dict[str, Value] = DEFAULTS | {FRAME.name: default_frame(namespace)}
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


def check_parameter_files(arguments: Sequence[str], nodes: Sequence[str]) -> Overrides:
    """
    Read the parameters in ROS arguments as rcl does; return their values.

    Raises ParameterError with the file and the key of an invalid value; rclpy would only abort.
    """
    overrides = Overrides.of_arguments(arguments)
    for name in nodes:
        full_name = full_name_of(arguments, name)
        described(overrides, full_name, alone=True)
        for key, (value, where) in overrides.of(full_name).items():
            _refuse_whole_numbers(where, key, value)
    return overrides


def _refuse_whole_numbers(where: str, key: str, value: Any) -> None:
    """Refuse integers where ROS, other than the library, insists on a decimal point."""
    default = DEFAULTS.get(key, (0.0,) if key.startswith(SHAPES) else 0)
    items = value if isinstance(value, list) else [value]
    measure = isinstance(default, float) or (
        isinstance(default, tuple) and not (default and isinstance(default[0], int)))
    whole = [item for item in items if isinstance(item, int) and not isinstance(item, bool)]
    if measure and whole:
        raise ParameterError(
            f'{where}: parameter {key} is {value}; ROS needs a decimal point: write '
            f'{float(whole[0])} rather than {whole[0]}')
