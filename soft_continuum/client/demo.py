# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The shapes of an arm on a simulated rig, by default the paper's three: ``./run demo``.

Starts the nodes as processes in a namespace of their own, sends the sequence like any
client, shows its progress, then prints a table per shape and writes a picture.
"""

from collections.abc import Mapping
import os
from pathlib import Path
import signal
import sys
from time import sleep

import numpy as np

from soft_continuum.analysis.figures import shapes_figure, spatial_shapes_figure
from soft_continuum.arguments import given_path, Parser, WRONG_USAGE
from soft_continuum.client.arm import Arm
from soft_continuum.client.errors import ClientError
from soft_continuum.client.measured import MeasuredDisc
from soft_continuum.client.sequence import RunningSequence
from soft_continuum.client.state import ArmState, Progress
from soft_continuum.client.state_text import angles_text
from soft_continuum.emulators.tendon_motors import TENDON_MOTORS
from soft_continuum.extras import require
from soft_continuum.mechanics import constant_curvature
from soft_continuum.mechanics.arm import Arm as PlanarArm
from soft_continuum.mechanics.chain import RigidChain
from soft_continuum.mechanics.spatial import constant_curvature as in_space
from soft_continuum.mechanics.spatial.arm import SpatialArm
from soft_continuum.mechanics.spatial.chain import SpatialChain
from soft_continuum.mechanics.spatial.directions import bending_vectors
from soft_continuum.nodes.processes import NodeProcesses
from soft_continuum.nodes.twin_process import add_twin_options, twin_process
from soft_continuum.nodes.up import chosen_nodes, description_file, with_asked
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.ros.conversions import planar_poses
from soft_continuum.ros.names import JAMMING_VALVES
from soft_continuum.sequencing.progress import Phase

ARMS = ('manipulator', 'spatial_jamming', 'tendon_arm')
"""The shipped descriptions, config/NAME.yaml; the first is the arm of the paper."""
HOLD = 0.5  # s
SETTLING, MEASURING = 0.5, 1.5  # s
STARTING_TIMEOUT = 60.0  # s: the model may have to be compiled


def main() -> int:
    """Run the demo; return the exit status."""
    parser = Parser('demo', 'Set the three shapes of the paper on a simulated rig, or those of '
                    'an arm in space.')
    parser.add_argument('--arm', choices=ARMS, default=ARMS[0],
                        help='one of the descriptions in config/ (default: %(default)s, the arm '
                        'of the paper)')
    parser.add_argument('--picture', type=given_path, default=Path('demo_shapes.png'),
                        help='where to write the picture (default: %(default)s)')
    parser.add_argument('--tendon-driver', choices=TENDON_MOTORS,
                        help='what pulls the tendons of the '
                        'twin: steppers (grbl, the default) or servos (dynamixel)')
    add_twin_options(parser)
    options = parser.parse_args()
    if not options.picture.resolve().parent.is_dir():
        parser.error(f'--picture {options.picture}: there is no such directory')
    if options.picture.is_symlink():
        parser.error(f'--picture {options.picture} is a link; name the file that it leads to')
    if options.tendon_driver and not options.twin:
        parser.error('--tendon-driver needs --twin here')
    if options.camera and not options.twin:
        parser.error('--camera needs --twin here: nothing else can be seen')
    require('matplotlib')
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    rig = f'the twin, preset {options.twin}' if options.twin else 'a simulated rig'
    options.params_file = [description_file(options.arm)]
    # A namespace of its own keeps it apart from an arm that may be running.
    namespace = options.namespace = f'demo_{os.getpid()}'
    try:
        nodes = chosen_nodes(options)
        print(f'Starting the nodes on {rig} ...', flush=True)
        with (twin_process(options.twin, options.params_file, namespace, camera=options.camera,
                           tendon_driver=options.tendon_driver) as driving,
              NodeProcesses(nodes, [*with_asked(options, driving), '--log-level', 'error']),
              Arm(namespace, timeout=STARTING_TIMEOUT) as arm):
            if driving:
                _take_as_straight(arm, jamming=JAMMING_VALVES in nodes)
            _run(arm, options.picture, camera=options.camera)
    except KeyboardInterrupt:
        print('\ninterrupted; everything that was started has ended')
        return 130
    except ParameterError as error:
        return parser.fail(error, WRONG_USAGE)
    except ClientError as error:
        print(f'\nthe sequence failed: {error}', file=sys.stderr)
        return 1
    return 0


def _take_as_straight(arm: Arm, *, jamming: bool) -> None:
    """Do what comes first on a rig: stiffen the arm if it can be, and say that it is straight."""
    arm.wait_for(lambda state: state.pulls and None not in state.stiff)
    if jamming:
        arm.stiffen()
    arm.reference()


def _run(arm: Arm, picture: Path, *, camera: bool) -> None:
    """Run the shapes, print a table for each and write the picture."""
    arm.wait_for(lambda state: state.pulls and state.tip and None not in state.stiff)
    description, shapes = arm.description, arm.shapes
    camera = camera and isinstance(description, PlanarArm)  # Arm.measure knows no other
    hold = HOLD + SETTLING + MEASURING if camera else HOLD
    reached, measured = _follow(arm, arm.start(*shapes, hold=hold), camera=camera)
    if isinstance(description, PlanarArm):
        _show_planar(description, shapes, reached, measured, picture)
    else:
        _show_spatial(description, shapes, arm.shape_directions, reached, picture)
    print(f'\nSimulated data. The rigid chain is under gravity, constant curvature is not.\n'
          f'Picture: {picture}')


def _show_planar(description: PlanarArm, shapes: Mapping[str, tuple[float, ...]],
                 reached: Mapping[str, ArmState],
                 measured: Mapping[str, Mapping[int, MeasuredDisc]], picture: Path) -> None:
    for name, angles in shapes.items():
        state = reached[name]
        print(f'\n{name}: {", ".join(f"{np.degrees(a):+.1f}" for a in angles)} degrees')
        print('                               x in mm   z in mm   tangent in degrees')
        poses = [(f'end of segment {i}, rigid chain', pose.x, pose.z, pose.angle)
                 for i, pose in enumerate(state.segment_poses or (), start=1)]
        poses += [(f'end of segment {n}, measured', *planar_poses(disc.pose[None])[0].tolist())
                  for n, disc in measured.get(name, {}).items() if n]
        if state.tip is not None:
            poses.append(('tip, rigid chain', state.tip.x, state.tip.z, state.tip.angle))
        poses.append(('tip, constant curvature',
                      *constant_curvature.poses(description, angles)[-1].tolist()))
        for label, x, z, angle in poses:
            print(f'{label:<30}{x * 1e3:8.2f}  {z * 1e3:8.2f}  {np.degrees(angle):10.2f}')
        _show_pulls(state)
    shapes_figure(picture, RigidChain(description), {
        name: (np.array(reached[name].joint_angles), angles) for name, angles in shapes.items()})


def _show_spatial(description: SpatialArm, shapes: Mapping[str, tuple[float, ...]],
                  directions: Mapping[str, tuple[float, ...]], reached: Mapping[str, ArmState],
                  picture: Path) -> None:
    chain, drawn = SpatialChain(description), {}
    for name, angles in shapes.items():
        state, towards = reached[name], directions.get(name, ())
        arcs, turns = in_space.poses(description, bending_vectors(description, angles, towards))
        print(f'\n{name}:{angles_text(angles, towards)}')
        print('                               x in mm   y in mm   z in mm   degrees from z')
        poses = [(f'end of segment {i}, rigid chain', *pose.position, pose.tilt)
                 for i, pose in enumerate(state.segment_poses or (), start=1)]
        if state.tip is not None:
            poses.append(('tip, rigid chain', *state.tip.position, state.tip.tilt))
        poses.append(('tip, constant curvature', *arcs[-1].tolist(),
                      float(np.arccos(np.clip(turns[-1, 2, 2], -1.0, 1.0)))))
        for label, x, y, z, tilt in poses:
            print(f'{label:<30}{x * 1e3:8.2f}  {y * 1e3:8.2f}  {z * 1e3:8.2f}  '
                  f'{np.degrees(tilt):10.2f}')
        _show_pulls(state)
        drawn[name] = chain.at(np.array(state.joint_angles)), arcs
    spatial_shapes_figure(picture, drawn)


def _show_pulls(state: ArmState) -> None:
    print('pulls: ' + ', '.join(f'{tendon} {pull * 1e3:.3f} mm' for tendon, pull in zip(
        state.tendons, state.pulls or (), strict=True)))


def _follow(arm: Arm, running: RunningSequence, *, camera: bool
            ) -> tuple[dict[str, ArmState], dict[str, dict[int, MeasuredDisc]]]:
    """Show the progress; return the state in which each shape was held, and what was seen."""
    reached: dict[str, ArmState] = {}
    measured: dict[str, dict[int, MeasuredDisc]] = {}
    shown = ''
    for now in running.updates():
        shown = _show(now, shown)
        if now.phase == Phase.HOLDING:
            reached[now.shape] = arm.state
            if camera and now.shape not in measured:
                measured[now.shape] = _measure(arm)
    running.result()
    print(flush=True)
    return reached, measured


def _measure(arm: Arm) -> dict[int, MeasuredDisc]:
    """Return the discs at rest, none where the computer is too slow for the pictures."""
    sleep(SETTLING)
    try:
        return arm.measure(MEASURING)
    except ClientError as error:
        print(f'\n{error}', file=sys.stderr)
        return {}


def _show(now: Progress, shown: str) -> str:
    """Print the progress: on a terminal a phase counts up in place; elsewhere it is one line."""
    segment = f'segment {now.segment}' if now.segment else 'whole arm'
    line = f'{now.shape:<16}{segment:<12}{now.phase}'
    if line != shown or sys.stdout.isatty():
        new_line = '\n' if line != shown and shown else ''
        back = '\r' if sys.stdout.isatty() and not new_line else ''
        print(f'{new_line}{back}{100 * now.fraction:4.0f} %  {line}', end='', flush=True)
    return line
