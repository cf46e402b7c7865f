# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

import ast
from configparser import ConfigParser
from importlib import import_module
from pathlib import Path
import re
import runpy
import shutil
import subprocess
import sys
from xml.etree import ElementTree

from catkin_pkg.changelog import get_changelog_from_path
from catkin_pkg.packages import find_packages
import pytest
import setuptools
import yaml

from soft_continuum import version

ROOT = Path(__file__).resolve().parent.parent
# Where the name of an import is not that of the distribution.
IMPORTED_AS = {'cv2': 'opencv-python-headless', 'dynamixel_sdk': 'dynamixel-sdk',
               'mcap_ros2': 'mcap-ros2-support',
               'mpl_toolkits': 'matplotlib', 'serial': 'pyserial', 'yaml': 'pyyaml'}
TEXTS = ('', '.py', '.html', '.yaml', '.msg', '.srv', '.action')
MANIFESTS = ('package.xml', 'soft_continuum_interfaces/package.xml')


def manifest(path):
    return ElementTree.parse(ROOT / path).getroot()


@pytest.fixture
def setup_arguments(monkeypatch):
    arguments = {}
    monkeypatch.setattr(setuptools, 'setup', arguments.update)
    monkeypatch.chdir(ROOT)
    runpy.run_path('setup.py')
    return arguments


def test_both_packages_and_the_citation_say_what_setup_py_says(setup_arguments):
    for found in map(manifest, MANIFESTS):
        assert found.get('format') == '3'
        for name in ('version', 'maintainer', 'license'):
            assert found.findtext(name) == setup_arguments[name]
        maintainer = found.find('maintainer')
        assert maintainer is not None
        assert maintainer.get('email') == setup_arguments['maintainer_email']
    ours, theirs = ({url.get('type'): url.text for url in manifest(path).iter('url')}
                    for path in MANIFESTS)
    assert ours == theirs
    citation = yaml.safe_load((ROOT / 'CITATION.cff').read_text(encoding='utf-8'))
    assert citation['version'] == setup_arguments['version']


def test_both_packages_have_the_license_and_a_changelog_of_the_same_releases():
    folders = [(ROOT / path).parent for path in MANIFESTS]
    licenses = {(folder / 'LICENSE').read_bytes() for folder in folders}
    assert len(licenses) == 1
    releases = [[(version, date) for version, date, _ in get_changelog_from_path(
        str(folder)).foreach_version()] for folder in folders]
    assert releases[0] == releases[1]
    assert releases[0]


def test_the_build_farm_finds_both_packages_in_a_release_tree(tmp_path):
    if not (ROOT / '.git').exists():
        pytest.skip('no clone of git')
    assert {one.name for one in find_packages(str(ROOT)).values()} == {'soft_continuum'}
    subprocess.run([ROOT / 'run', 'release', 'tree'], cwd=tmp_path, check=True)
    found = find_packages(str(tmp_path / 'tree'))
    assert {folder: package.name for folder, package in found.items()} == {
        name: name for name in ('soft_continuum', 'soft_continuum_interfaces')}
    assert len({package.version for package in found.values()}) == 1
    for package in found.values():
        package.validate()
        assert {'CHANGELOG.rst', 'LICENSE'} <= {path.name for path in Path(
            package.filename).parent.iterdir()}
    written = {str(path.relative_to(tmp_path / 'tree')) for path in (tmp_path / 'tree').rglob('*')
               if not path.is_dir()}
    listed = subprocess.run(['git', 'ls-tree', '-r', '-z', '--name-only', 'HEAD'], cwd=ROOT,
                            check=True, capture_output=True, text=True).stdout.split('\0')[:-1]
    inner = 'soft_continuum_interfaces/'
    assert written == {name if name.startswith(inner) else f'soft_continuum/{name}'
                       for name in listed}


def test_a_release_tree_takes_the_place_of_nothing(tmp_path):
    (tmp_path / 'mine').touch()
    done = subprocess.run([ROOT / 'run', 'release', tmp_path], capture_output=True, text=True)
    assert done.returncode == 1
    assert 'a directory that is new or empty' in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ['mine']


def test_pages_that_the_product_names_exist_and_are_installed(setup_arguments):
    named = {page for folder in ('soft_continuum', 'soft_continuum_interfaces', 'config', 'launch',
                                 'bin')
             for path in (ROOT / folder).rglob('*') if path.is_file() and path.suffix in TEXTS
             for page in re.findall(r'(?<![\w/.])(?:msg_)?docs/[\w/]+\.md',
                                    path.read_text(encoding='utf-8'))}
    assert {'docs/how_to/set_up_the_network.md', 'msg_docs/parameters.md'} < named
    installed = {f'{folder.removeprefix("share/soft_continuum/")}/{Path(file).name}'
                 for folder, files in setup_arguments['data_files'] for file in files}
    assert not {page for page in named if not (ROOT / page).is_file()}
    assert not named - installed


def test_a_version_differs_where_the_sources_do_and_nowhere_else(tmp_path):
    ignored = shutil.ignore_patterns('__pycache__')
    shutil.copytree(ROOT / 'soft_continuum', tmp_path / 'a', ignore=ignored)
    assert version_in(tmp_path / 'a') == version()
    assert re.fullmatch(r'\d+\.\d+\.\d+\+[0-9a-f]{8}', version())
    (tmp_path / 'a' / '__pycache__').mkdir()
    (tmp_path / 'a' / '__pycache__' / 'text.pyc').write_bytes(b'compiled')
    (tmp_path / 'a' / 'mechanics' / 'kernel.so').write_bytes(b'compiled')
    assert version_in(tmp_path / 'a') == version()
    (tmp_path / 'linked').symlink_to(tmp_path / 'a')
    assert version_in(tmp_path / 'linked') == version()
    found = {version()}
    for change in (lambda: (tmp_path / 'a' / 'text.py').open('a').write('#'),
                   lambda: (tmp_path / 'a' / 'text.py').rename(tmp_path / 'a' / 'texts.py'),
                   lambda: (tmp_path / 'a' / 'ui' / 'browser' / 'page.html').open('a').write(' '),
                   lambda: (tmp_path / 'a' / 'new.py').touch()):
        change()
        found.add(version_in(tmp_path / 'a'))
    assert len(found) == 5


def version_in(folder):
    """Return what the package in a folder says."""
    return str(runpy.run_path(str(folder / '__init__.py'))['version']())


def test_every_console_script_names_a_main_that_exists(setup_arguments):
    scripts = setup_arguments['entry_points']['console_scripts']
    assert scripts
    for script in scripts:
        name, target = script.split(' = ')
        module, function = target.split(':')
        assert callable(getattr(import_module(module), function)), f'{name}: {target}'


def test_every_package_of_the_tree_is_installed_and_no_other(setup_arguments):
    folders = {path.parent for path in (ROOT / 'soft_continuum').rglob('*.py')}
    modules = {'.'.join(folder.relative_to(ROOT).parts) for folder in folders}
    assert set(setup_arguments['packages']) == modules


def test_every_package_that_is_imported_is_declared():
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


def test_rosdep_is_told_of_both_packages():
    # It does not look for packages inside a package.
    pages = (ROOT / 'README.md', *ROOT.glob('docs/**/*.md'), *ROOT.glob('.github/**/*.yaml'))
    commands = [line for page in pages for line in page.read_text(encoding='utf-8').splitlines()
                if 'rosdep install' in line and '--from-paths' in line]
    assert commands
    assert all(re.search(r'--from-paths \S+ \S*soft_continuum_interfaces', line)
               for line in commands), commands


@pytest.mark.parametrize(('nodes', 'more'), [
    (('jamming_valves',), {'scipy'}), (('tendon_actuation', 'shape_sequencer'), set())])
def test_a_node_loads_no_solver_no_compiler_and_no_driver_that_it_has_not(nodes, more):
    # They take 90 MB and seconds of every start.
    modules = ', '.join(f'soft_continuum.nodes.{node}' for node in nodes)
    done = subprocess.run([sys.executable, '-c', f'import sys, {modules}; print(*sys.modules)'],
                          capture_output=True, text=True, check=True)
    heavy = {'asyncio', 'cv2', 'dynamixel_sdk', 'llvmlite', 'matplotlib', 'numba', 'pymodbus',
             'scipy.optimize', 'scipy.spatial', 'serial', 'soft_continuum.hardware.dynamixel.bus'}
    assert not (heavy | more) & set(done.stdout.split())


def imports(path):
    waiting = [ast.parse(path.read_text(encoding='utf-8'))]
    while waiting:  # statements only: they are a tenth of all
        node = waiting.pop()
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module
        waiting += [inner for name in ('body', 'orelse', 'finalbody', 'handlers', 'cases')
                    for inner in getattr(node, name, ())]
