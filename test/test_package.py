# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

import ast
from collections.abc import Iterator
from configparser import ConfigParser
from importlib import import_module
from pathlib import Path
import re
import runpy
import subprocess
import sys
from typing import Any
from xml.etree import ElementTree

import pytest
import setuptools

ROOT = Path(__file__).resolve().parent.parent
# Where the name of an import is not that of the distribution.
IMPORTED_AS = {'cv2': 'opencv-python-headless', 'dynamixel_sdk': 'dynamixel-sdk',
               'mcap_ros2': 'mcap-ros2-support',
               'mpl_toolkits': 'matplotlib', 'serial': 'pyserial', 'yaml': 'pyyaml'}
MANIFESTS = ('package.xml', 'soft_continuum_interfaces/package.xml')


def manifest(path: str) -> ElementTree.Element:
    return ElementTree.parse(ROOT / path).getroot()


@pytest.fixture
def setup_arguments(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    arguments: dict[str, Any] = {}
    monkeypatch.setattr(setuptools, 'setup', arguments.update)
    monkeypatch.chdir(ROOT)
    runpy.run_path('setup.py')
    return arguments


@pytest.mark.parametrize('path', MANIFESTS)
def test_a_package_has_the_version_of_setup_py(
    path: str, setup_arguments: dict[str, Any]
) -> None:
    assert manifest(path).findtext('version') == setup_arguments['version']


@pytest.mark.parametrize('path', MANIFESTS)
def test_a_manifest_is_format_3(path: str) -> None:
    assert manifest(path).get('format') == '3'


def test_both_packages_have_the_license_of_setup_py(setup_arguments: dict[str, Any]) -> None:
    licenses = {manifest(path).findtext('license') for path in MANIFESTS}
    assert licenses == {setup_arguments['license']}


def test_every_console_script_names_a_main_that_exists(setup_arguments: dict[str, Any]) -> None:
    scripts = setup_arguments['entry_points']['console_scripts']
    assert scripts
    for script in scripts:
        name, target = script.split(' = ')
        module, function = target.split(':')
        assert callable(getattr(import_module(module), function)), f'{name}: {target}'


def test_every_package_of_the_tree_is_installed_and_no_other(
    setup_arguments: dict[str, Any],
) -> None:
    folders = {path.parent for path in (ROOT / 'soft_continuum').rglob('*.py')}
    modules = {'.'.join(folder.relative_to(ROOT).parts) for folder in folders}
    assert set(setup_arguments['packages']) == modules


def test_every_package_that_is_imported_is_declared() -> None:
    config = ConfigParser()
    config.read(ROOT / 'setup.cfg')
    declared = '\n'.join((config['options']['install_requires'],
                          *config['options.extras_require'].values()))
    names = {name.lower() for name in re.findall(r'^[\w-]+', declared, re.MULTILINE)}
    ros = {element.text for kind in ('depend', 'exec_depend')
           for element in manifest('package.xml').iter(kind)}
    imported = {name.split('.')[0] for path in (ROOT / 'soft_continuum').rglob('*.py')
                for name in imports(path)} - sys.stdlib_module_names - {'soft_continuum'}
    distributions = {name: IMPORTED_AS.get(name, name) for name in imported}
    missing = {name for name, distribution in distributions.items()
               if distribution not in names and name not in ros}
    assert not missing


def test_rosdep_is_told_of_both_packages() -> None:
    # It does not look for packages inside a package.
    pages = (ROOT / 'README.md', *ROOT.glob('docs/**/*.md'), *ROOT.glob('.github/**/*.yaml'))
    commands = [line for page in pages for line in page.read_text(encoding='utf-8').splitlines()
                if 'rosdep install' in line and '--from-paths' in line]
    assert commands
    assert all(re.search(r'--from-paths \S+ \S*soft_continuum_interfaces', line)
               for line in commands), commands


@pytest.mark.parametrize(('node', 'more'), [
    ('jamming_valves', {'scipy'}), ('tendon_actuation', set()), ('shape_sequencer', set())])
def test_a_node_loads_no_solver_no_compiler_and_no_driver_that_it_has_not(
        node: str, more: set[str]) -> None:
    # They take 90 MB and seconds of every start.
    script = f'import sys, soft_continuum.nodes.{node}; print(*sys.modules)'
    done = subprocess.run([sys.executable, '-c', script], capture_output=True, text=True,
                          check=True)
    heavy = {'asyncio', 'cv2', 'dynamixel_sdk', 'llvmlite', 'matplotlib', 'numba', 'pymodbus',
             'scipy.optimize', 'scipy.spatial', 'serial', 'soft_continuum.hardware.dynamixel.bus'}
    assert not (heavy | more) & set(done.stdout.split())


def imports(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module
