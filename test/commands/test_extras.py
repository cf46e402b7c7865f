# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What needs a Python package that is missing, or has another version, says the line to type."""

from configparser import ConfigParser
from importlib import import_module, metadata
from pathlib import Path
import re
import sys
import sysconfig
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).parents[2]
VIEW = ('ui', 'browser', 'replay recording.mcap')
NEEDED = {
    'argcomplete': ('argcomplete', ('completion bash',)),
    'coal': ('coal', ('plan 100 200 --unit mm --obstacles sphere.yaml',)),
    'cv2': ('opencv-python-headless', ('tags', 'calibrate camera pictures', 'twin_camera',
                                       'camera')),
    'distributed': ('distributed', ('study study.yaml',)),
    'dynamixel_sdk': ('dynamixel-sdk', ('doctor --params-file servos.yaml',
                                        'calibrate servos --params-file servos.yaml --yes')),
    'matplotlib': ('matplotlib', (
        'characterize soft.csv --segment 1 --lever-arm 0.1', 'converge', 'demo',
        'identify pulls.csv shapes.csv', 'validate pulls.csv shapes.csv', 'workspace',
        'report recording',
        'new-arm', 'plan 100 200 --unit mm --picture plan.png', 'study study.yaml', 'tags')),
    'mcap': ('mcap', ('record', 'report recording.mcap', 'export recording.mcap', VIEW[2])),
    'mcap_ros2': ('mcap-ros2-support', ('report recording.mcap', 'export recording.mcap',
                                        VIEW[2])),
    'msgspec': ('msgspec', VIEW),
    'mujoco': ('mujoco', ('twin',)),
    'pint': ('pint', ('characterize soft.csv --segment 1 --lever-arm 0.1',)),
    'pyarrow': ('pyarrow', ('study study.yaml', 'export recording --format parquet')),
    'pymodbus': ('pymodbus', ('doctor --params-file valves.yaml',)),
    'serial': ('pyserial', ('doctor', 'calibrate vacuum', 'install-service')),
    'trimesh': ('trimesh', ('plan 100 200 --unit mm --obstacles mesh.yaml',)),
    'viser': ('viser', VIEW),
    'websockets': ('websockets', VIEW),
}
"""By module: its package, and command lines that need it."""
BROUGHT = {'dask', 'lz4', 'zstandard'}  # by distributed and mcap, which need them themselves
ALWAYS = {'argcomplete', 'pint'}  # of no extra
FILES = {
    'soft.csv': 'displacement [mm],force [N]\n0,0\n1,1\n2,2\n3,3\n',
    'sphere.yaml': 'obstacles: [{name: a, shape: sphere, radius: 0.01, position: [1, 0, 0]}]',
    'mesh.yaml': 'obstacles: [{name: a, shape: mesh, file: box.stl, position: [1.0, 0.0, 0.0]}]',
    'valves.yaml': '/**: {ros__parameters: {jamming_driver: modbus}}',
    'servos.yaml': (ROOT / 'config' / 'dynamixel_rig.yaml').read_text(encoding='utf-8'),
    'recording.mcap': '',
}


def extras():
    """Return what setup.cfg asks for by extra, such as viser~=1.1, but for the tests."""
    config = ConfigParser()
    config.read(ROOT / 'setup.cfg', encoding='utf-8')
    return {'': config['options']['install_requires'].split(),
            **{extra: text.split() for extra, text in config['options.extras_require'].items()
               if extra != 'test'}}


def asked_for(package):
    """Return what setup.cfg asks for of a package."""
    return next(one for some in extras().values() for one in some
                if re.split('[<>=~]', one)[0] == package)


@pytest.fixture
def call(tmp_path, monkeypatch, capfd):
    """Return a function that runs a command line in a suite that is imported anew."""
    def drop():
        for name in [name for name in sys.modules if re.match(r'soft_continuum(\.|$)', name)]:
            del sys.modules[name]

    def run(line):
        capfd.readouterr()
        monkeypatch.setattr(sys, 'argv', ['soft_continuum'])
        status = import_module('soft_continuum.ui.cli.main').main(line.split())
        return status, ''.join(capfd.readouterr())

    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        (tmp_path / name).write_text(text, encoding='utf-8')
    before = dict(sys.modules)
    drop()
    yield run
    drop()
    sys.modules.update(before)


def block(monkeypatch, *modules):
    """Let modules not be found."""
    for name in [name for name in sys.modules if name.partition('.')[0] in modules]:
        monkeypatch.delitem(sys.modules, name)
    for name in modules:
        monkeypatch.setitem(sys.modules, name, None)


@pytest.mark.parametrize('module', NEEDED)
def test_what_needs_a_package_that_is_missing_says_the_line_that_installs_it(
        module, call, monkeypatch):
    package, lines = NEEDED[module]
    block(monkeypatch, module)
    for line in lines:
        status, said = call(line)
        assert status in (1, 2), line
        assert f'{package} is not installed; for ' in said, (line, said)
        assert re.search(f"pip install .*'{re.escape(asked_for(package))}'", said), (line, said)
        assert 'Traceback' not in said


def test_every_package_of_an_extra_is_known_by_what_needs_it():
    packages = {re.split('[<>=~]', one)[0] for extra, some in extras().items() if extra
                for one in some}
    assert packages == {package for package, _ in NEEDED.values()} - ALWAYS | BROUGHT


def test_the_doctor_names_every_package_that_is_missing(call, monkeypatch):
    block(monkeypatch, *(NEEDED.keys() | BROUGHT) - {'serial'} - ALWAYS)
    status, said = call('doctor')
    assert status == 0  # a simulated rig needs none of them
    for extra, packages in extras().items():
        wanted = [one for one in packages if extra and not one.startswith('pyserial')]
        if wanted:
            line, = re.findall(f'^WARN  packages for {extra}: .*', said, re.MULTILINE)
            assert line.endswith('pip install ' + ' '.join(f"'{one}'" for one in wanted))


@pytest.mark.parametrize('line', ['status', 'up', 'teleop_node', 'measure', 'doctor --network'])
def test_without_ros_a_verb_says_to_source_it(line, call, monkeypatch):
    block(monkeypatch, 'rclpy')
    status, said = call(line)
    assert status == 1
    assert 'source it and the workspace, or start with ./run' in said


def test_a_version_that_does_not_fit_is_not_used(call, monkeypatch):
    version = metadata.version
    monkeypatch.setattr(metadata, 'version', lambda name: {'pymodbus': '3.0.0'}.get(name)
                        or version(name))
    status, said = call('doctor --params-file valves.yaml')
    assert status == 1
    assert said.count(f"pymodbus is 3.0.0; for the devices of a rig type: pip install "
                      f"'{asked_for('pymodbus')}'") == 2  # and the driver refuses it


def test_the_opencv_of_apt_is_too_old(call, monkeypatch):
    def version(name):
        if name.startswith('opencv'):
            raise metadata.PackageNotFoundError(name)
        return known(name)

    known = metadata.version
    monkeypatch.setattr(metadata, 'version', version)
    monkeypatch.setattr('cv2.__version__', '4.6.0')
    line = 'calibrate camera no_pictures'
    assert 'opencv-python-headless is 4.6.0; for cameras' in call(line)[1]
    monkeypatch.setattr('cv2.__version__', '4.11.0')
    assert 'opencv' not in call(line)[1]


def test_a_python_of_apt_gets_packages_of_apt_where_they_fit(call, monkeypatch, tmp_path):
    (tmp_path / 'EXTERNALLY-MANAGED').touch()
    monkeypatch.setattr(sysconfig, 'get_path', lambda name: str(tmp_path))
    monkeypatch.setattr(sys, 'prefix', sys.base_prefix)
    block(monkeypatch, 'matplotlib', 'viser')
    assert call('workspace')[1].endswith(' type: sudo apt install python3-matplotlib\n')
    assert call('ui')[1].endswith(
        ' type, in the environment that docs/how_to/install.md makes: pip install '
        f"'{asked_for('viser')}' numpy=={metadata.version('numpy')}\n")


def test_what_apt_has_is_what_the_manifest_names():
    manifest = ElementTree.parse(ROOT / 'package.xml').getroot()
    keys = {element.text for element in manifest.iter('exec_depend')}
    from soft_continuum.extras import FROM_APT
    assert {f'python3-{name}' for name in FROM_APT} == {
        key for key in keys if key and key.startswith('python3-')}
