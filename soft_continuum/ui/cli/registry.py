# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Every verb of ``soft_continuum VERB``, and the location of its function.

To add a verb, add a line here.  A function is imported when its verb is called, so that ``stop``
does not load unneeded modules.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

OPERATE = 'ui.cli.operate:main'
NODE = 'nodes.runtime:run'


@dataclass(frozen=True)
class Verb:
    """
    A verb.

    help: one line.  target: ``module:function`` in soft_continuum; the function reads its options
    from ``sys.argv[1:]`` and returns the exit status.  arguments: of the function.
    """

    name: str
    help: str
    target: str
    arguments: tuple[Any, ...] = ()

    @property
    def completes(self) -> bool:
        """Whether TAB may call the function: it builds a Parser before it does anything."""
        return not self.target.startswith(('ui.browser.', 'nodes.'))


def _operate(name: str, text: str) -> Verb:
    return Verb(name, text, OPERATE, (name,))


def _node(name: str, text: str) -> Verb:
    return Verb(name, text, NODE, (name,))


GROUPS: Mapping[str, tuple[Verb, ...]] = {
    'start': (
        Verb('demo', "set the paper's three shapes on a simulated rig", 'ui.cli.demo:main'),
        Verb('up', 'start the nodes of an arm', 'ui.cli.up:main'),
        Verb('ui', 'start the four nodes and show the arm in a browser', 'ui.browser.main:ui'),
        Verb('browser', 'show a running arm in a browser', 'ui.browser.main:browser'),
    ),
    'operate a running arm': (
        _operate('status', 'show the state of the arm and its nodes'),
        _operate('watch', 'show the state of the arm twice per second, until Ctrl-C'),
        _operate('shapes', 'list the shape library'),
        _operate('run', 'set shapes in sequence; Ctrl-C cancels'),
        _operate('reach', 'move the tip to a position; Ctrl-C cancels'),
        _operate('follow', 'move the tip along a path from a file'),
        _operate('stiffen', 'evacuate a segment, or all, and wait until it is stiff'),
        _operate('soften', 'vent a segment and wait until it is soft'),
        _operate('vacuum', 'set the vacuum of a segment with a regulator'),
        _operate('jog', 'pull in or pay out tendons by some mm while a segment is soft'),
        _operate('obstacles', 'list, add or remove obstacles'),
        _operate('home', 'straighten the arm from any shape, with a sequence or all at once'),
        Verb('teleop', 'steer with the keyboard', 'ui.cli.teleop:main'),
        _operate('stop', 'stop all motion, holding tension'),
        _operate('resume', 'allow motion after a stop'),
        _operate('reference', 'set the present pulls as the zero of the straight arm'),
        _operate('reset', 'reset kinematics to the straight arm'),
        _operate('tare', 'take the present measurements as those of the straight arm'),
        Verb('record', 'record everything that the arm publishes', 'lab.recordings.record:main'),
        Verb('measure', 'set shapes and measure the discs for identify and validate',
             'ui.cli.measure:main'),
        Verb('save-estimate', 'save the estimated parameters of the arm',
             'ui.cli.save_estimate:main'),
    ),
    'plan, without nodes': (
        Verb('plan', 'print the plan for a tip position, step by step',
             'ui.cli.plan:main'),
    ),
    'set up a rig, while no nodes run': (
        Verb('new-arm', 'describe an arm interactively', 'lab.new_arm.description:main'),
        Verb('doctor', 'check a rig step by step; nothing moves', 'commissioning.doctor:main'),
        Verb('calibrate', 'measure a rig: vacuum, signs, steps, zero; set up servos',
             'commissioning.calibrate:main'),
        Verb('emulate', 'emulate the device of a driver: grbl, dynamixel, modbus',
             'sim.emulators.console:emulate'),
        Verb('twin', 'simulate a rig: the arm in MuJoCo with emulated boards', 'ui.cli.twin:main'),
        Verb('twin_camera', 'simulate a camera of that rig', 'ui.cli.twin:camera'),
        Verb('tags', 'write printable tags for discs and board', 'ui.cli.tags:main'),
        Verb('policy', 'write a policy for SROS 2: access permissions over DDS',
             'ui.cli.policy:main'),
        Verb('install-service', 'start the nodes at boot with systemd',
             'ui.cli.install_service:main'),
    ),
    'analyse measurements': (
        Verb('characterize', 'fit the bending stiffness to force-displacement curves',
             'lab.analysis.characterisation:main'),
        Verb('identify', 'fit parameters of the arm to measured shapes',
             'lab.analysis.identification:main'),
        Verb('validate', 'compare the models with measured shapes',
             'lab.analysis.validation:main'),
        Verb('converge', 'check the convergence of the model with its resolution',
             'lab.analysis.convergence:main'),
        Verb('workspace', 'sample the positions that the tip reaches',
             'lab.analysis.workspace:main'),
        Verb('study', 'compare designs of arms', 'lab.study.summary:main'),
        Verb('report', 'write a one-page report of a recording', 'lab.analysis.report:main'),
        Verb('replay', 'play a recording in a browser', 'ui.browser.main:replay'),
        Verb('export', 'export a recording as CSV, MATLAB or Parquet',
             'lab.analysis.recording:export'),
    ),
    'single nodes and devices, as `ros2 run soft_continuum` names them': (
        _node('tendon_actuation', 'moves the tendons'),
        _node('jamming_valves', 'controls pump, valves and pressure sensors'),
        _node('kinematics', 'computes the shape of the arm'),
        _node('shape_sequencer', 'executes shape sequences'),
        _node('camera', 'measures the poses of the discs with printed tags'),
        _node('disc_sensors', 'converts trackers and IMUs to poses of the discs'),
        _node('servo', 'follows a moving target with the soft segment'),
        Verb('teleop_node', 'the node teleop: steers with a joystick', NODE, ('teleop',)),
        _node('recorder', 'records the topics of the arm on request'),
        Verb('grbl_emulator', 'the same as emulate grbl', 'sim.emulators.grbl:main'),
        Verb('dynamixel_emulator', 'the same as emulate dynamixel',
             'sim.emulators.dynamixel:main'),
        Verb('modbus_emulator', 'the same as emulate modbus', 'sim.emulators.modbus:main'),
    ),
    'shell': (
        Verb('completion', 'print the script for tab completion', 'ui.cli.main:completion'),
    ),
}

VERBS = {verb.name: verb for verbs in GROUPS.values() for verb in verbs}
