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
    driver_parameters,
    families,
    JAMMING_DRIVERS,
    TENDON_DRIVERS,
)

PAGE = Path(__file__).parents[2] / 'docs' / 'how_to' / 'write_a_driver.md'
EXAMPLE = Path(__file__).parents[2] / 'examples' / 'my_tendons'
METHODS = {
    TENDON_DRIVERS: ('open', 'close', 'read', 'move', 'stop', 'reference'),
    JAMMING_DRIVERS: ('open', 'close', 'read', 'set_evacuated', 'set_pump'),
}


@pytest.mark.parametrize('group', METHODS)
def test_our_drivers_do_what_the_protocol_asks_for(group):
    from soft_continuum.ros.description import load_description

    for family in families(group).values():
        driver = family.make(load_description(), lambda: 0.0)
        assert all(callable(getattr(driver, method)) for method in METHODS[group])


@pytest.mark.parametrize('group', METHODS)
def test_no_two_drivers_share_a_parameter(group):
    names = [parameter.name for parameter in driver_parameters(group)]
    assert len(names) == len(set(names))
    assert all('.' in name for name in names)


def other_package(directory, module):
    """Install a package as pip would, with the driver ``servo``."""
    (directory / 'my_rig').mkdir()
    (directory / 'my_rig' / '__init__.py').touch()
    (directory / 'my_rig' / 'servo.py').write_text(module, encoding='utf-8')
    info = directory / 'my_rig-1.0.dist-info'
    info.mkdir()
    (info / 'METADATA').write_text('Metadata-Version: 2.1\nName: my_rig\nVersion: 1.0\n')
    (info / 'entry_points.txt').write_text(
        '[soft_continuum.tendon_drivers]\nservo = my_rig.servo:ServoTendons\n')


def run_with(directory, code):
    program = f'import sys; sys.path.insert(0, {str(directory)!r})\n' + textwrap.dedent(code)
    return subprocess.run([sys.executable, '-c', program], capture_output=True, text=True,
                          check=True, timeout=60).stdout


def test_the_page_shows_what_stands_in_the_example():
    example = ''.join(path.read_text('utf-8') for path in EXAMPLE.rglob('*.py'))
    shown = re.findall(r'```python\n(.*?)```', PAGE.read_text('utf-8'), re.DOTALL)
    assert len(shown) == 2
    assert all(block in example for block in shown)


def test_a_package_that_cannot_be_loaded_fails_only_when_it_is_chosen(tmp_path):
    other_package(tmp_path, 'import no_such_module')
    said = run_with(tmp_path, """
        from soft_continuum.ros.description import load_description
        from soft_continuum.hardware.drivers import families, TENDON_DRIVERS
        from soft_continuum.hardware.protocols import HardwareError
        try:
            families(TENDON_DRIVERS)['servo'].make(load_description(), lambda: 0.0)
        except HardwareError as error:
            print(error)
    """)
    assert 'servo (my_rig.servo:ServoTendons) cannot be loaded' in said
    assert 'no_such_module' in said


def test_an_entry_point_registers_parameters_checks_calibration_and_emulator(tmp_path):
    other_package(tmp_path, textwrap.dedent("""
        from soft_continuum.hardware.commissioning import Check, Drive, OK
        from soft_continuum.parameters.parameter import Parameter

        PORT, DRIVE = 'servo.port', Drive('servo.signs', 'servo.radii', inverse=True)
        main = str

        def checks(values):
            yield Check('servo', OK, values['servo.port'])

        class ServoTendons:
            PARAMETERS = (Parameter('servo.port', '', 'its port'),)
            COMMISSIONING = EMULATOR = 'my_rig.servo'
    """))
    said = run_with(tmp_path, """
        from soft_continuum.hardware.drivers import (
            driver_parameters, emulated_devices, families, TENDON_DRIVERS)
        family = families(TENDON_DRIVERS)['servo']
        print(family.parameters[0] in driver_parameters(TENDON_DRIVERS), family.port,
              family.drive.scale, [check.message for check in family.checks({'servo.port': 'a'})],
              [*family.checks_opened(None)], family.clear_zero({}),
              emulated_devices()['servo'].emulator.main(1), family.topics({}))
    """)
    assert said == "True servo.port servo.radii ['a'] [] None 1 ({}, {})\n"
