# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Stand-ins for launch and launch_ros, which are not on PyPI: they make command lines alone."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
import sys
from tempfile import NamedTemporaryFile
from types import ModuleType, SimpleNamespace
from typing import Any

import yaml

BRINGUP = Path(__file__).parents[2] / 'launch' / 'bringup.launch.py'


@dataclass
class DeclareLaunchArgument:
    """An argument of a launch file."""

    name: str
    default_value: str = ''
    description: str = ''
    choices: Sequence[str] | None = None


@dataclass
class OpaqueFunction:
    """What is called with the values of the arguments, and returns what is to be started."""

    function: Any


@dataclass
class Node:
    """A node that is to be started."""

    package: str
    executable: str
    name: str = ''
    namespace: str = ''
    parameters: Sequence[Any] = ()
    arguments: Sequence[str] = ()
    output: str = ''
    additional_env: dict[str, str] = field(default_factory=dict)

    @property
    def command(self) -> list[str]:
        """The arguments of the process, as Node._perform_substitutions of launch_ros has them."""
        words = [self.executable, *self.arguments, '--ros-args']
        if self.name:
            words += ['-r', f'__node:={self.name}']
        space = '/' + self.namespace.strip('/')
        if self.namespace:
            words += ['-r', f'__ns:={space}']
        for given in self.parameters:
            words += ['--params-file', self._file_of(space, given) if isinstance(given, dict)
                      else str(given)]
        return words

    def _file_of(self, space: str, values: dict[str, Any]) -> str:
        """Write values as launch_ros does: into a section with the full name of the node."""
        name = f'{space.rstrip("/")}/{self.name}' if self.name else '/**'
        with NamedTemporaryFile('w', prefix='launch_params_', delete=False) as file:
            yaml.dump({name: {'ros__parameters': values}}, file)
        return file.name


@contextmanager
def stand_ins() -> Iterator[None]:
    """Have ``import launch`` and ``import launch_ros`` find these meanwhile."""
    modules = {name: ModuleType(name) for name in (
        'launch', 'launch.actions', 'launch_ros', 'launch_ros.actions')}
    vars(modules['launch'])['LaunchDescription'] = list
    vars(modules['launch.actions']).update(
        DeclareLaunchArgument=DeclareLaunchArgument, OpaqueFunction=OpaqueFunction)
    vars(modules['launch_ros.actions'])['Node'] = Node
    before = {name: sys.modules.get(name) for name in modules}
    sys.modules.update(modules)
    try:
        yield
    finally:
        for name, module in before.items():
            if module is None:
                del sys.modules[name]
            else:
                sys.modules[name] = module


def description(path: Path = BRINGUP) -> list[Any]:
    """Return what generate_launch_description of a launch file returns."""
    spec = spec_from_file_location('launched', path)
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    with stand_ins():
        spec.loader.exec_module(module)
        found: list[Any] = module.generate_launch_description()
    return found


def launched(**given: str) -> list[Node]:
    """Return the nodes that ``ros2 launch`` starts with these arguments."""
    actions = description()
    declared = {a.name: a for a in actions if isinstance(a, DeclareLaunchArgument)}
    for name, value in given.items():
        assert declared[name].choices is None or value in declared[name].choices, (name, value)
    values = {name: given.get(name, one.default_value) for name, one in declared.items()}
    start, = (a.function for a in actions if isinstance(a, OpaqueFunction))
    nodes: list[Node] = start(SimpleNamespace(launch_configurations=values))
    return nodes
