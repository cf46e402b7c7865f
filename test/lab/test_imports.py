# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Mechanics and analysis can be imported without ROS, and without matplotlib until they draw."""

import ast
from pathlib import Path
import subprocess
import sys

PACKAGE = Path(__file__).resolve().parents[2] / 'soft_continuum'
WITHOUT_ROS = ('bag', 'tables', 'report')
"""Modules of the recordings that read them."""
MODULES = [*(PACKAGE / 'lab' / 'recordings' / f'{name}.py' for name in WITHOUT_ROS),
           *(path for room in ('mechanics', 'lab/analysis')
             for path in (PACKAGE / room).rglob('*.py'))]
ALLOWED = {*sys.stdlib_module_names, 'numpy', 'scipy', 'numba', 'tqdm'}
OWN = ('mechanics', 'lab.analysis', 'lab.recordings', 'parameters', 'planning.obstacles',
       'ros.description', 'ros.parameter_table', 'colours', 'extras', 'text')


def imported(path):
    """Yield what the module imports, other than inside functions and for types only."""
    pending = [ast.parse(path.read_text(encoding='utf-8'))]
    while pending:
        node = pending.pop()
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module
        elif not (isinstance(node, ast.FunctionDef) or (
                isinstance(node, ast.If) and ast.unparse(node.test) == 'TYPE_CHECKING')):
            pending += ast.iter_child_nodes(node)


def test_a_module_needs_neither_ros_nor_the_rest_of_the_package():
    for path in MODULES:
        if path.name == 'verbs.py':  # it names the errors of all rooms
            continue
        for name in imported(path):
            head, _, own = name.partition('.')
            assert head in ALLOWED or name == 'soft_continuum' or (
                head == 'soft_continuum' and f'{own}.'.startswith(tuple(f'{o}.' for o in OWN))), (
                f'{path.name} imports {name}')


def test_all_of_them_are_imported_where_neither_ros_nor_matplotlib_is():
    names = ['.'.join(path.relative_to(PACKAGE.parent).with_suffix('').parts) for path in MODULES
             if path.parent.name != 'mechanics' or path.name[0] != '_']
    ran = subprocess.run([sys.executable, '-c', """
from importlib import import_module
import sys
sys.modules |= dict.fromkeys(('rclpy', 'ament_index_python', 'geometry_msgs', 'matplotlib'))
for name in sys.argv[1:]:
    import_module(name)
""", *names], capture_output=True, text=True, timeout=60)
    assert ran.returncode == 0, ran.stderr
