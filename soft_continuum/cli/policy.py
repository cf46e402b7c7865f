# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``policy``: who may do what over DDS, as a policy file of SROS 2."""

import argparse
from collections.abc import Sequence
import shlex

from soft_continuum.analysis.results import reserve_outputs
from soft_continuum.arguments import Parser
from soft_continuum.cli.common import run_verb
from soft_continuum.cli.security_policy import policy
from soft_continuum.parameters.files import load_rig
from soft_continuum.parameters.overrides import full_name
from soft_continuum.ros.enclaves import CLIENT, INPUTS, VIEWER
from soft_continuum.text import write_whole

FILE = 'policy.xml'


def main(argv: Sequence[str] | None = None) -> int:
    """Run the verb; return the exit status."""
    return run_verb(Parser(
        'policy', f'Write {FILE} for SROS 2: what every node of an arm, and every kind of '
        'program, may publish, subscribe to and call. To use it takes ROS 2 from apt.',
        '--params-file', '--namespace', '--output', '--force'), _run, argv)


def _run(options: argparse.Namespace) -> None:
    namespace = options.namespace
    text = policy(load_rig(options.params_file, namespace), namespace)
    path, = reserve_outputs(options.output, [FILE], options.force)
    write_whole(path, text)
    print(f'Written: {path}\n'
          f'  {full_name("NODE", namespace)}: one for each node, which takes it by itself\n'
          f'  {full_name(CLIENT, namespace)}: whoever commands: soft_continuum, the Python '
          'client, the browser\n'
          f'  {full_name(VIEWER, namespace)}: whoever only looks, such as RViz\n'
          f'  {full_name(INPUTS, namespace)}: drivers of sensors, an emergency stop\n'
          'Make the keys, with ROS 2 from apt:\n'
          '  ros2 security create_keystore keystore\n'
          f'  ros2 security generate_artifacts -k keystore -p {shlex.quote(str(path))}\n'
          'docs/how_to/secure_the_network.md goes on from here.')
