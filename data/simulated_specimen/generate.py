# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
A SIMULATED specimen: measurements of an arm that does not exist, for examples and tests.

It is the paper's arm with what is assumed about the real one: soft segments stiffer than their
leaf springs by what the paper measured for the middle one, and the masses that are estimated from
its geometry times 1.23.  It is computed with a chain four times as fine as the models that are
compared with it.  README.md explains its errors.

``python data/simulated_specimen/generate.py DIR`` writes the files.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from soft_continuum.lab.analysis.measured_shapes import Step
from soft_continuum.mechanics import SLACK, Statics
from soft_continuum.mechanics.arm import Arm, Array, SECOND_ORDER
from soft_continuum.mechanics.stiffness import bending_stiffness_from_slope
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.files import write_parameters
from soft_continuum.parameters.shapes import PAPER_SHAPES
from soft_continuum.ros.description import load_description

SLOPE = 72.0  # N/m, soft segment 2 (paper, eq. 7)
LEVER_ARM = 0.025  # m, with which eq. 8 gives the paper's E I
LARGEST = 0.010  # m, displacement on the testing machine
MASS_FACTOR = 1.23
BODIES = 48
SCAN_NOISE = 0.05e-3  # m, of an optical scanner
CAMERA_NOISE = 0.3e-3  # m, of a camera
PAYLOAD = 0.05  # kg

NOTE = 'SIMULATED specimen, not a measurement'


@dataclass(frozen=True)
class SetShape:
    """Bending angles (rad) that the specimen is set to, and the segment let go at the end."""

    name: str
    angles: tuple[float, ...]
    released: int | None = None
    payload: float = 0.0


def specimen() -> Arm:
    """Return the arm that stands for the real one."""
    arm = arm_from_parameters(load_description() | weighed())
    ratio = (bending_stiffness_from_slope(SLOPE, arm.segments[1].length, LEVER_ARM)
             / arm.segments[1].stiffness_y)
    return replace(arm, bodies_per_segment=BODIES, discretisation=SECOND_ORDER, segments=tuple(
        segment.with_stiffness_factor(ratio) for segment in arm.segments))


def weighed() -> dict[str, tuple[float, ...]]:
    """Return the masses of the specimen as parameters, kg."""
    values = load_description()
    names = ('arm.segment_masses', 'arm.disc_masses')
    return {name: tuple(round(MASS_FACTOR * float(mass), 6)
                        for mass in values[name])  # type: ignore[union-attr]
            for name in names}


def paper_shapes() -> list[SetShape]:
    """Return the three shapes of the paper (III-A)."""
    return [SetShape(name, angles) for name, angles in PAPER_SHAPES.items()]


def identification_shapes() -> list[SetShape]:
    """
    Return shapes that determine the stiffness of every segment.

    A segment that hangs on a tendon has the angle that the tendon gives it, whatever its
    stiffness.  So in some shapes a segment is let go at the end: its own spring holds the weight.
    """
    c_form = PAPER_SHAPES['c_form']
    shapes = paper_shapes()
    for segment in range(len(c_form)):
        shapes.append(SetShape(f'released_{segment + 1}', c_form, segment))
    mirrored = tuple(-angle for angle in c_form)
    shapes.append(SetShape('released_1_left', mirrored, 0))
    shapes.append(SetShape('loaded', c_form, 2, PAYLOAD))
    shapes.append(SetShape('loaded_left', mirrored, 2, PAYLOAD))
    return shapes


def set_on(arm: Arm, shape: SetShape) -> tuple[list[Step], Array]:
    """Return the steps that set a shape and its calculation points (2 * discs, 2), m."""
    statics = Statics(replace(arm, payload=shape.payload))
    state, steps = statics.chain.straight(), []
    for segment, angle in enumerate(shape.angles):
        state = statics.bend(state, segment, angle)
        pulls = np.where(state.tensions > 0.0, state.pulls, SLACK)
        steps.append(Step(segment, (float(pulls[0]), float(pulls[1])), angle))
    if shape.released is not None:
        soft = [i == shape.released for i in range(statics.chain.segments)]
        state = statics.solve(state, (SLACK, SLACK), soft)
        steps.append(Step(shape.released, (SLACK, SLACK), float(
            statics.chain.bending_angles(state.joint_angles)[shape.released])))
    return steps, state.points[:, ::2]


def curves(rng: np.random.Generator) -> Iterator[tuple[float, float, float]]:
    """
    Yield time (s), displacement (m) and force (N) of soft segment 2 on a testing machine.

    Three repetitions up and down in steps of 0.05 mm at 0.1 mm/s.  Each is 1 % stiffer than the
    one before, since the powder packs; grains that shift make noise that fades over 0.5 mm; on
    the way down friction between the grains gives a tenth of the force less.
    """
    up = np.linspace(0.0, LARGEST, 201)
    both = np.concatenate([up, up[-2::-1]])
    factor = np.concatenate([np.ones(up.size), np.full(up.size - 1, 0.9)])
    time = 0.0
    for repetition in range(3):
        shift = 0.0
        for u, part in zip(both, factor, strict=True):
            shift = 0.9 * shift + rng.normal(0.0, 0.001 * SLOPE * LARGEST)
            yield time, float(u), float(SLOPE * (0.99 + 0.01 * repetition) * u * part + shift)
            time += 0.5


def write(directory: Path, seed: int = 2022) -> list[Path]:
    """Write the data set; the same seed gives the same files."""
    rng = np.random.default_rng(seed)
    directory.mkdir(parents=True, exist_ok=True)
    arm = specimen()
    written = []
    for name, shapes, noise in (('paper', paper_shapes(), SCAN_NOISE),
                                ('identification', identification_shapes(), CAMERA_NOISE)):
        points = [['shape', 'point', 'x [mm]', 'z [mm]']]
        pulls = [['shape', 'segment', 'angle [deg]', 'right [mm]', 'left [mm]', 'payload [g]']]
        for shape in shapes:
            steps, positions = set_on(arm, shape)
            noisy = positions + rng.normal(0.0, noise, positions.shape)
            noisy[:2] = positions[:2]  # the base disc is the frame
            points += [[shape.name, str(k), *(f'{1e3 * value:.3f}' for value in row)]
                       for k, row in enumerate(noisy, start=1)]
            pulls += [[shape.name, str(step.segment + 1), f'{np.degrees(step.angle):.2f}',
                       *('slack' if p == SLACK else f'{1e3 * p:.3f}' for p in step.pulls),
                       f'{1e3 * shape.payload:g}'] for step in steps]
        about = f'{NOTE}; noise {1e3 * noise:g} mm'
        written += [_write(directory / f'SIMULATED_{name}_points.csv', about, points),
                    _write(directory / f'SIMULATED_{name}_pulls.csv', NOTE, pulls)]
    rows = [['Testzeit', 'Standardweg', 'Standardkraft'], ['s', 'mm', 'N']]
    rows += [[f'{t:.1f}', f'{1e3 * u:.3f}', f'{f:.5f}'] for t, u, f in curves(rng)]
    written.append(_write(directory / 'SIMULATED_segment_2_soft.csv', NOTE,
                          [[cell.replace('.', ',') for cell in row] for row in rows], ';'))
    layer = directory / 'SIMULATED_masses.yaml'
    write_parameters(layer, weighed(), [f'{NOTE}: its masses, as they would be weighed.'])
    return [*written, layer]


def _write(path: Path, about: str, rows: Sequence[Sequence[str]], delimiter: str = ',') -> Path:
    lines = [about, *(delimiter.join(row) for row in rows)]
    path.write_text('\n'.join(lines) + '\n', encoding='utf-8')
    return path


if __name__ == '__main__':
    parser = argparse.ArgumentParser(description='Write the data of the SIMULATED specimen.')
    parser.add_argument('directory', type=Path)
    for file in write(parser.parse_args().directory):
        print(file)
