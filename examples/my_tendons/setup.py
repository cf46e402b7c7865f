# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""Builds and installs the ROS 2 package my_tendons."""

from setuptools import setup

PACKAGE = 'my_tendons'

setup(
    name=PACKAGE,
    version='0.1.0',
    description='A driver of tendon motors for soft_continuum',
    license='Apache-2.0',
    maintainer='Me',
    maintainer_email='me@example.org',
    packages=[PACKAGE],
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        (f'share/{PACKAGE}/config', [f'config/{PACKAGE}.yaml']),
    ],
    zip_safe=True,
    entry_points={
        # The name that users write into tendon_driver, and the class.
        'soft_continuum.tendon_drivers': [f'{PACKAGE} = {PACKAGE}.motor_box:MotorBox'],
    },
)
