# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""Builds and installs the ROS 2 package soft_continuum."""

from glob import glob
import os
from os.path import isfile
import subprocess
import sys

from setuptools import find_packages, setup

PACKAGE = 'soft_continuum'
SHARE = f'share/{PACKAGE}'


def files(*patterns: str) -> list[str]:
    """Return the files that match any of the patterns, in a fixed order."""
    # A symlinked build keeps a dead link to a file that is gone.
    return sorted(path for pattern in patterns for path in glob(pattern) if isfile(path))


distribution = setup(
    name=PACKAGE,
    version='0.2.0',
    description='Tendon-driven continuum arms with jamming segments, on ROS 2',
    license='Apache-2.0',
    maintainer='The soft_continuum authors',
    maintainer_email='soft-continuum@example.org',
    packages=find_packages(include=[PACKAGE, f'{PACKAGE}.*']),
    package_data={PACKAGE: ['py.typed', 'ui/browser/page.html']},
    python_requires='>=3.11',
    zip_safe=False,
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (SHARE, ['package.xml']),
        (f'{SHARE}/config', files('config/*')),
        # On the path after sourcing the workspace.
        ('bin', ['bin/soft_continuum']),
        (f'{SHARE}/launch', files('launch/*.launch.py')),
        # Messages name pages.
        *((f'{SHARE}/{folder}', files(f'{folder}/*.md'))
          for folder in sorted({os.path.dirname(page) for page in files(
              'msg_docs/*.md', 'docs/*.md', 'docs/*/*.md')})),
        (f'{SHARE}/data/simulated_specimen', files('data/simulated_specimen/*')),
    ],
    entry_points={
        'console_scripts': [
            f'{name} = {PACKAGE}.__main__:ros2_run'
            for name in (
                'browser', 'calibrate', 'camera', 'characterize', 'converge', 'disc_sensors',
                'doctor', 'dynamixel_emulator', 'grbl_emulator', 'identify', 'jamming_valves',
                'kinematics', 'modbus_emulator', 'record', 'recorder', 'report', 'servo',
                'shape_sequencer', 'teleop', 'teleop_node', 'tendon_actuation', 'validate',
                'workspace')
        ],
    },
)

# With colcon the solver is compiled now, rather than in the first start: beside its source, or,
# where that stays in the workspace, into the cache of the user.
if (os.environ.get('COLCON') == '1' and {'install', 'develop'} & set(sys.argv)
        and '--uninstall' not in sys.argv):
    installing = 'install' in sys.argv
    directory = distribution.get_command_obj('install').install_lib if installing else os.getcwd()
    print('compiling the model, which takes up to a minute ...', flush=True)
    subprocess.run(
        [sys.executable, '-P', '-c',
         'from soft_continuum.mechanics import _kernel as k; '
         + ('print(k.why_not_built() or k.build(k.HERE))' if installing else 'k.functions()')],
        env={**os.environ, 'PYTHONPATH': f'{directory}:{os.environ.get("PYTHONPATH", "")}'})
