# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What is imported only when it is used: names of doors, and optional packages."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
import re
import shlex
import sys
import sysconfig
from typing import Any, TYPE_CHECKING

if TYPE_CHECKING:
    from packaging.requirements import Requirement

USES = {
    'browser': 'the view in a browser',
    'camera': 'cameras and tags',
    'obstacles': 'obstacles',
    'parquet': 'Parquet files',
    'plots': 'figures',
    'record': 'recordings',
    'rig': 'the devices of a rig',
    'study': 'studies',
    'twin': 'the simulated rig in MuJoCo',
}
"""The extras of setup.cfg, which has the versions, and the features that need them."""
MODULES = {'mcap-ros2-support': 'mcap_ros2', 'opencv-python-headless': 'cv2',
           'pyserial': 'serial', 'PyYAML': 'yaml'}
"""Packages whose import name differs from their own."""
FROM_APT = ('argcomplete', 'matplotlib', 'numba', 'numpy', 'packaging', 'scipy', 'serial',
            'setuptools', 'tqdm', 'yaml')
"""Modules listed in package.xml: the package python3-NAME of Ubuntu 24.04 is suitable."""
ROS = re.compile(r'rclpy|ament_index_python|\w+_(msgs|srvs|interfaces)')
PAGE = 'docs/how_to/install.md'


def names_from(package: str, names: Collection[str], modules: Sequence[str]
               ) -> Callable[[str], Any]:
    """
    Return the ``__getattr__`` of a package: it loads ``modules`` in order until one has the name.

    package: its name.  names: its exports, which may be modules themselves.
    """
    def attribute(name: str) -> Any:
        if name in names:
            for module in [name] if name in modules else modules:
                found = import_module(f'{package}.{module}')
                if module == name or hasattr(found, name):
                    return getattr(found, name, found)
        raise AttributeError(f'module {package!r} has no attribute {name!r}')

    return attribute


# Optional packages.


@cache
def requirements() -> Mapping[str, tuple['Requirement', ...]]:
    """Return the requirements of setup.cfg by extra; '': base.  Empty if not installed."""
    from importlib import metadata

    from packaging.requirements import Requirement
    try:
        found = [Requirement(text) for text in metadata.requires('soft_continuum') or ()]
    except metadata.PackageNotFoundError:
        found = []
    return {extra: tuple(one for one in found if (
        one.marker.evaluate({'extra': extra}) if one.marker else not extra))
        for extra in ('', *USES)}


def remedy(error: ImportError) -> str:
    """Return what is missing and how to install it; empty for other errors."""
    module = (error.name or '').partition('.')[0]
    if ROS.fullmatch(module):
        return f'ROS 2 is not set up ({error}); source it and the workspace, or start with ./run'
    return _unfit(module) or (f'{module} cannot be imported: {error}' if _extra(module) else '')


def require(module: str) -> None:
    """Raise ImportError, for remedy, unless a package is installed in a suitable version."""
    if text := _unfit(module):
        raise ImportError(text, name=module)


@contextmanager
def needed(error: Callable[[str], Exception]) -> Iterator[None]:
    """Raise ``error`` with the command to install a package that cannot be imported."""
    try:
        yield
    except ImportError as found:
        if text := remedy(found):
            raise error(text) from None
        raise


def missing(extra: str) -> str:
    """Return the missing or unsuitable packages of an extra, and how to install them."""
    wrong = {one: why for one in requirements()[extra] if (why := _problem(one))}
    if not wrong:
        return ''
    said = ', '.join(f'{one.name} {why}' for one, why in wrong.items())
    return f'{said}; for {USES.get(extra, "soft_continuum")} type{_line(list(wrong))}'


def _extra(module: str) -> str | None:
    """Return the smallest extra with a module; None if no extra has it."""
    found = [extra for extra, packages in requirements().items()
             if module in map(_module, packages)]
    return min(found, key=lambda extra: (len(requirements()[extra]), extra), default=None)


def _unfit(module: str) -> str:
    extra = _extra(module)
    return missing(extra) if extra is not None and any(
        _module(one) == module and _problem(one) for one in requirements()[extra]) else ''


def _module(package: 'Requirement') -> str:
    return MODULES.get(package.name, package.name.replace('-', '_'))


def _problem(package: 'Requirement') -> str:
    if find_spec(_module(package)) is None:
        return 'is not installed'
    from importlib import metadata
    try:
        found = metadata.version(package.name)
    except metadata.PackageNotFoundError:  # such as the OpenCV of apt
        found = str(getattr(import_module(_module(package)), '__version__', ''))
    fits = not found or package.specifier.contains(found, prereleases=True)
    return '' if fits else f'is {found}'


def _line(packages: list['Requirement']) -> str:
    names = [_module(one) for one in packages]
    of_apt = (sys.prefix == sys.base_prefix
              and Path(sysconfig.get_path('stdlib'), 'EXTERNALLY-MANAGED').exists())
    if of_apt and all(name in FROM_APT for name in names):
        return f': sudo apt install {" ".join(f"python3-{name}" for name in names)}'
    command = ['pip', 'install', *(f'{one.name}{one.specifier}' for one in packages)]
    if not of_apt:
        return f': {shlex.join(command)}'
    from importlib import metadata
    # The messages of ROS are built for the NumPy of apt, and pip refuses to install beside it.
    command.append(f'numpy=={metadata.version("numpy")}')
    return f', in the environment that {PAGE} makes: {shlex.join(command)}'
