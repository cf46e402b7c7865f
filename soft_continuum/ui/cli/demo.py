# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The shapes of an arm on a simulated rig, by default the paper's three: ``./run demo``.

Starts the nodes as processes in a separate namespace, sends the sequence like any client, shows
its progress, prints a table for each shape and writes a picture.
"""

from collections.abc import Mapping
import os
from pathlib import Path
import signal
import sys
from time import sleep

import numpy as np

from soft_continuum.client import Arm, ArmState, ClientError, Pose, RunningSequence
from soft_continuum.client.measured import MeasuredDisc
from soft_continuum.client.state import angles_text
from soft_continuum.extras import require
from soft_continuum.lab.analysis.verbs import finish_panels, new_panels
from soft_continuum.mechanics import arm as mechanics
from soft_continuum.mechanics import constant_curvature
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.chain import Chain, Equilibrium
from soft_continuum.mechanics.directions import bending_vectors
from soft_continuum.mechanics.drawing import draw_arm, projection_of
from soft_continuum.mechanics.rotations import quaternions
from soft_continuum.parameters.arguments import given_path, Parser, WRONG_USAGE
from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.ros.names import JAMMING_VALVES
from soft_continuum.sequencing import Phase
from soft_continuum.sim.emulators.tendon_motors import TENDON_MOTORS
from soft_continuum.ui.cli.operate import Output
from soft_continuum.ui.cli.processes import NodeProcesses
from soft_continuum.ui.cli.up import add_twin_options, ALL, arguments_of, chosen_nodes
from soft_continuum.user_files import description_file

ARMS = ('manipulator', 'spatial_jamming', 'tendon_arm')
"""The shipped descriptions, config/NAME.yaml; the first is the arm of the paper."""
HOLD = 0.5  # s
SETTLING, MEASURING = 0.5, 1.5  # s
STARTING_TIMEOUT = 60.0  # s: the model may have to be compiled


def main() -> int:
    """Run the demo; return the exit status."""
    parser = Parser('demo', 'Set the three shapes of the paper, or those of a spatial arm, on a '
                    'simulated rig.')
    parser.add_argument('--arm', choices=ARMS, default=ARMS[0],
                        help='one of the descriptions in config/ (default: %(default)s, the arm '
                        'of the paper)')
    parser.add_argument('--picture', type=given_path, default=Path('demo_shapes.png'),
                        help='where to write the picture (default: %(default)s)')
    parser.add_argument('--tendon-driver', choices=TENDON_MOTORS,
                        help='motors of the twin: steppers (grbl, the default) or servos '
                        '(dynamixel)')
    add_twin_options(parser)
    # A namespace of its own keeps it apart from an arm that may be running.
    parser.set_defaults(namespace=f'demo_{os.getpid()}', jamming_driver=None, computer=ALL,
                        teleop=False)
    options = parser.parse_args()
    if not options.picture.resolve().parent.is_dir():
        parser.error(f'--picture {options.picture}: there is no such directory')
    if options.picture.is_symlink():
        parser.error(f'--picture {options.picture} is a link; name the file that it leads to')
    if options.tendon_driver and not options.twin:
        parser.error('--tendon-driver needs --twin here')
    if options.camera and not options.twin:
        parser.error('--camera needs --twin here: only the twin has camera images')
    require('matplotlib')
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    rig = f'the twin, preset {options.twin}' if options.twin else 'a simulated rig'
    options.params_file = [description_file(options.arm)]
    try:
        nodes = chosen_nodes(options)
        print(f'Starting the nodes on {rig} ...', flush=True)
        with (arguments_of(options) as arguments,
              NodeProcesses(nodes, [*arguments, '--log-level', 'error']),
              Arm(options.namespace, timeout=STARTING_TIMEOUT) as arm):
            if options.twin:
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
    """Prepare a rig: stiffen the arm if possible, and reference it as straight."""
    arm.wait_for(lambda state: state.speeds and None not in state.stiff)
    if jamming:
        arm.stiffen()
    arm.reference()


def _run(arm: Arm, picture: Path, *, camera: bool) -> None:
    """Run the shapes, print a table for each and write the picture."""
    arm.wait_for(lambda state: state.pulls and state.tip and None not in state.stiff)
    description, shapes = arm.description, arm.shapes
    hold = HOLD + SETTLING + MEASURING if camera else HOLD
    reached, measured = _follow(arm, arm.start(*shapes, hold=hold), camera=camera)
    if unseen := ', '.join(name for name in shapes if name not in reached):
        raise ClientError(f'{unseen} was set, but not measured while it was held; is the computer '
                          'overloaded? Close other programs and try again')
    drawn, chain = {}, Chain(description)
    for name, angles in shapes.items():
        towards = arm.shape_directions.get(name, ())
        bending = bending_vectors(description, angles, towards)
        shown = angles_text(angles, towards) if towards else (
            f' {", ".join(f"{np.degrees(a):+.1f}" for a in angles)} degrees')
        print(f'\n{name}:{shown}')
        _show_poses(description, bending, reached[name], measured.get(name, {}))
        drawn[name] = chain.at(np.array(reached[name].joint_angles)), bending
    shapes_figure(picture, drawn)
    print(f'\nSimulated data. The rigid chain is under gravity, constant curvature is not.\n'
          f'Picture: {picture}')


def shapes_figure(path: str | Path, shapes: Mapping[str, tuple[Equilibrium, Array]]) -> None:
    """
    Write a figure of shapes side by side, by constant curvature and by the rigid chain.

    shapes: by name, the state, and the commanded bending (segments, 2), rad.
    """
    arm, count = next(iter(shapes.values()))[0].chain.arm, len(shapes)
    projection = projection_of(arm)
    figure, panels = new_panels(1, count, 4.4 * count, 5.2, projection=projection)
    for axes, (name, (state, bending)) in zip(panels, shapes.items(), strict=True):
        draw_arm(axes, state)
        arcs = 1e3 * constant_curvature.poses(arm, bending)[0][:, arm.pose_axes[:3]]
        axes.plot(*arcs.T, 's', markersize=8, markerfacecolor='none', markeredgecolor='0.1',
                  label='constant curvature')
        axes.set_title(name, y=None if projection is None else 0.96, parse_math=False)
    finish_panels(path, figure, 2 if count == 1 else 5)


def _show_poses(description: mechanics.Arm, bending: Array, state: ArmState,
                measured: Mapping[int, MeasuredDisc]) -> None:
    """Print the positions of segments and tip: chain model, measured, constant curvature."""
    signed = description.pose_axes[3:].sum() == 1  # then one angle tells where it points
    arcs, turns = constant_curvature.poses(description, bending)
    poses = [(f'end of segment {i}, rigid chain', pose)
             for i, pose in enumerate(state.segment_poses or (), start=1)]
    poses += [(f'end of segment {n}, measured', _pose(disc.pose))
              for n, disc in measured.items() if n]
    if state.tip is not None:
        poses.append(('tip, rigid chain', state.tip))
    poses.append(('tip, constant curvature', _pose(
        np.concatenate([arcs[-1], quaternions(turns[-1])]))))
    print(' ' * 31 + ''.join(f'{axis} in mm   ' for axis in description.axes)
          + ('tangent in degrees' if signed else 'degrees from z'))
    for label, pose in poses:
        place = 1e3 * np.array(pose.position)[description.pose_axes[:3]]
        print(f'{label:<30}' + ''.join(f'{number:8.2f}  ' for number in place)
              + f'{np.degrees(pose.angle if signed else pose.tilt):10.2f}')
    print('pulls: ' + ', '.join(f'{tendon} {pull * 1e3:.3f} mm' for tendon, pull in zip(
        state.tendons, state.pulls or (), strict=True)))


def _pose(pose: Array) -> Pose:
    x, y, z, *turn = pose.tolist()
    return Pose((x, y, z), (turn[0], turn[1], turn[2], turn[3]))


def _follow(arm: Arm, running: RunningSequence, *, camera: bool
            ) -> tuple[dict[str, ArmState], dict[str, dict[int, MeasuredDisc]]]:
    """Show the progress; return the state in which each shape was held, and its measurements."""
    reached: dict[str, ArmState] = {}
    measured: dict[str, dict[int, MeasuredDisc]] = {}
    output, before = Output(Parser('demo', ''), as_json=False), None
    for now in running.updates():
        output.progress(now, before)
        before = now
        if now.phase == Phase.HOLDING:
            reached[now.shape] = arm.state
            if camera and now.shape not in measured:
                measured[now.shape] = _measure(arm)
    running.result()
    output.print('')
    return reached, measured


def _measure(arm: Arm) -> dict[int, MeasuredDisc]:
    """Return the discs at rest; none if the computer is too slow for the images."""
    sleep(SETTLING)
    try:
        return arm.measure(MEASURING)
    except ClientError as error:
        print(f'\n{error}', file=sys.stderr)
        return {}
