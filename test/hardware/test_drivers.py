# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Drivers are found by name, also those of other packages, whose faults stay their own."""

from pathlib import Path
import re
import subprocess
import sys
import textwrap

import pytest

from soft_continuum.hardware.drivers import (
    driver_names,
    driver_parameters,
    JAMMING_DRIVERS,
    make_driver,
    TENDON_DRIVERS,
)

PAGE = Path(__file__).parents[2] / 'docs' / 'how_to' / 'write_a_driver.md'
METHODS = {
    TENDON_DRIVERS: ('open', 'close', 'read', 'move', 'stop', 'reference'),
    JAMMING_DRIVERS: ('open', 'close', 'read', 'set_evacuated', 'set_pump'),
}


@pytest.mark.parametrize('group', METHODS)
def test_our_drivers_do_what_the_protocol_asks_for(group):
    from soft_continuum.parameters.files import load_description

    for name in driver_names(group):
        driver = make_driver(group, name, load_description(), lambda: 0.0)
        assert all(callable(getattr(driver, method)) for method in METHODS[group])


@pytest.mark.parametrize('group', METHODS)
def test_no_two_drivers_share_a_parameter(group):
    names = [parameter.name for parameter in driver_parameters(group)]
    assert len(names) == len(set(names))
    assert all('.' in name for name in names)


def other_package(directory: Path, module: str) -> None:
    """Install a package as pip would, with the driver ``servo``."""
    (directory / 'my_rig').mkdir()
    (directory / 'my_rig' / '__init__.py').touch()
    (directory / 'my_rig' / 'servo.py').write_text(module, encoding='utf-8')
    info = directory / 'my_rig-1.0.dist-info'
    info.mkdir()
    (info / 'METADATA').write_text('Metadata-Version: 2.1\nName: my_rig\nVersion: 1.0\n')
    (info / 'entry_points.txt').write_text(
        '[soft_continuum.tendon_drivers]\nservo = my_rig.servo:ServoTendons\n')


def run_with(directory: Path, code: str) -> str:
    program = f'import sys; sys.path.insert(0, {str(directory)!r})\n' + textwrap.dedent(code)
    return subprocess.run([sys.executable, '-c', program], capture_output=True, text=True,
                          check=True, timeout=60).stdout


def test_the_driver_of_the_page_is_found_declared_and_made(tmp_path):
    code = re.search(r'```python\n(# my_rig.*?)```', PAGE.read_text('utf-8'), re.DOTALL)
    other_package(tmp_path, code[1])
    assert run_with(tmp_path, """
        from soft_continuum.parameters.files import load_description
        from soft_continuum.parameters.nodes import NODE_PARAMETERS
        from soft_continuum.hardware.drivers import make_driver, TENDON_DRIVERS
        table = {p.name: p for p in NODE_PARAMETERS['tendon_actuation']}
        print(table['tendon_driver'].choices, table['servo.drum_radius'].high)
        driver = make_driver(TENDON_DRIVERS, 'servo', load_description(), lambda: 0.0)
        driver.move((0.001, -0.002), 0.02)
        print(driver.read().pulls)
    """) == "('simulated', 'grbl', 'dynamixel', 'ros_topics', 'servo') 0.1\n(0.001, -0.002)\n"


def test_a_package_that_cannot_be_loaded_fails_only_when_it_is_chosen(tmp_path):
    other_package(tmp_path, 'import no_such_module')
    said = run_with(tmp_path, """
        from soft_continuum.parameters.files import load_description
        from soft_continuum.hardware.drivers import make_driver, TENDON_DRIVERS
        from soft_continuum.hardware.protocols import HardwareError
        try:
            make_driver(TENDON_DRIVERS, 'servo', load_description(), lambda: 0.0)
        except HardwareError as error:
            print(error)
    """)
    assert 'servo (my_rig.servo:ServoTendons) cannot be loaded' in said
    assert 'no_such_module' in said
