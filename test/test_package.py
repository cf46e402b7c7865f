# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

from importlib import import_module
from pathlib import Path
import runpy
from typing import Any
from xml.etree import ElementTree

import pytest
import setuptools

ROOT = Path(__file__).resolve().parent.parent
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
