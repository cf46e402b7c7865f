# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Unknowns come out as they are, with honest uncertainties, or not at all with a reason."""

from dataclasses import replace

import generate as specimen
import numpy as np
import pytest

from soft_continuum.lab.analysis.identification import (
    find_unknowns,
    IdentificationError,
    identify,
    parameters_of,
    shape_error,
    spread_out,
    with_values,
    without,
)
from soft_continuum.lab.analysis.measured_shapes import MeasuredShape, simulate_steps, Step
from soft_continuum.mechanics import SLACK
from soft_continuum.mechanics.arm import mounted, SECOND_ORDER
from soft_continuum.mechanics.sensitivity import Linearisation
from soft_continuum.mechanics.statics import Statics
from soft_continuum.parameters.arm import arm_from_parameters
from support import specimen_data as data

STIFFNESS = ['stiffness_1', 'stiffness_2', 'stiffness_3']
TRUE_STIFFNESS = np.array([s.stiffness_y for s in data.TRUE.segments])
DESCRIBED = spread_out(data.DESCRIPTION)


def fit(names, shapes=data.SHAPES, described=DESCRIBED):
    return identify(described, find_unknowns(names, described), shapes)


def stiff_as(stiffnesses, described=DESCRIBED):
    return {**described, 'arm.bending_stiffnesses': tuple(map(float, stiffnesses))}


def with_jams(described=DESCRIBED, ratio=12.0, **more):
    return {**described, 'arm.stiffness_ratios': (ratio,) * 3,
            **{f'arm.{name}': value for name, value in more.items()}}


def true_with(described):
    """Return the true arm, in what the description has besides its stiffness."""
    return arm_from_parameters({
        **stiff_as(TRUE_STIFFNESS, described), 'arm.discretisation': SECOND_ORDER})


def test_deviations_are_those_of_the_linearised_statics():
    described = {**DESCRIBED, 'arm.mounting_angle': 0.5}
    steps = (Step(0, (SLACK, SLACK)),)
    arm = arm_from_parameters({**described, 'arm.discretisation': SECOND_ORDER})
    tip = simulate_steps(Statics(arm), steps)[-1].poses[-1:, :3]
    found = fit(['stiffness_1'], [MeasuredShape('bow', steps, (7,), tip + [1e-4, np.nan, -1e-4])],
                described)
    statics = Statics(arm_from_parameters(found.arm))
    slope = Linearisation(
        statics, simulate_steps(statics, steps)[-1]).bending_stiffness().tip[[0, 2], 0]
    assert found.stddevs[0] == pytest.approx(found.noise / np.linalg.norm(slope), rel=1e-3)


# Recovery

def test_the_intervals_hold_the_true_values_as_often_as_they_say():
    clean = [data.measure(data.TRUE, shape) for shape in specimen.identification_shapes()]
    held = 0
    for seed in range(6):
        rng = np.random.default_rng(100 + seed)
        noisy = [replace(s, positions=s.positions + rng.normal(0.0, 0.3e-3, s.positions.shape))
                 for s in clean]
        found = fit(STIFFNESS, noisy, stiff_as(TRUE_STIFFNESS))
        held += int(np.sum(np.abs(found.values - TRUE_STIFFNESS) <= found.half_widths))
    assert held >= 14  # of 18: 17 are to be expected, fewer than 14 in one of 500


def test_masses_come_out_beside_stiffness_where_a_known_payload_hangs():
    light = with_values(DESCRIBED, find_unknowns(['mass'], DESCRIBED), np.array([0.8]))
    found = fit([*STIFFNESS, 'mass'], described=light)
    assert found.values[-1] == pytest.approx(1.25, abs=found.half_widths[-1])
    assert found.half_widths[-1] < 0.1
    assert np.all(found.correlations[:3, 3] > 0.9)  # only the payload tells them apart


def test_tilt_of_the_base_and_guide_offsets_come_out():
    tilted = replace(data.TRUE, gravity=mounted(0.02))
    shapes = [data.measure(tilted, s, 0.3e-3, k)
              for k, s in enumerate(specimen.identification_shapes())]
    found = fit([*STIFFNESS, 'offset_2', 'tilt'], shapes)
    assert found.values[-1] == pytest.approx(0.02, abs=0.003)
    assert found.values[-2] == pytest.approx(0.02125, abs=2e-4)
    assert found.values[:3] == pytest.approx(TRUE_STIFFNESS, rel=0.02)


def test_ratios_of_elastic_stiff_segments_come_out():
    true = true_with(with_jams({**DESCRIBED, 'arm.bodies_per_segment': 24}))
    shapes = [data.measure(true, s, 0.1e-3, k)
              for k, s in enumerate(specimen.identification_shapes())]
    found = fit(['ratio_1', 'ratio_2'], shapes, with_jams(stiff_as(TRUE_STIFFNESS), 20.0))
    assert found.values[0] == pytest.approx(12.0, rel=0.3)


def test_every_stiffness_is_recovered_and_a_shape_that_the_fit_has_not_seen_predicted():
    kept = without(data.SHAPES, ['c_form', 'released_3'])
    found = fit(STIFFNESS, kept)
    assert found.values == pytest.approx(TRUE_STIFFNESS, rel=0.02)
    assert found.noise == pytest.approx(0.3e-3, rel=0.2)
    unseen = [s for s in data.SHAPES if s not in kept]
    assert len(unseen) == 2
    for shape in unseen:
        assert shape_error(found.arm, shape).max() < 1.5e-3
        assert shape_error(DESCRIBED, shape).max() > 50e-3


# Refusal

@pytest.mark.parametrize(('names', 'shapes', 'message'), [
    ([*STIFFNESS, 'friction'], data.SHAPES,
     'do not determine friction: no measured point moves with it. .* only the tension'),
    (['stiffness', 'mass'], [s for s in data.SHAPES if s.payload == 0.0],
     'stiffness, mass, only a combination'),
    ([*STIFFNESS, 'mass'], [s for s in data.SHAPES if s.payload == 0.0],
     'stiffness_1, stiffness_2, stiffness_3, mass, only a combination .* weigh segments'),
    (['stiffness_2', 'segment_mass_2', 'disc_mass_2'], data.SHAPES, 'only a combination'),
    (STIFFNESS, data.SHAPES[1:3], 'do not determine stiffness_1.*both tendons slack'),
    (['ratio_1'], data.SHAPES, 'do not determine ratio_1: .*all but rigid'),
    (STIFFNESS, [replace(data.SHAPES[0], numbers=(7,), positions=data.SHAPES[0].positions[7:])],
     '2 measured coordinates are too few for 3 unknowns'),
    (['stiffness_4'], data.SHAPES, "no unknown 'stiffness_4'; known: stiffness_1, "),
    (['tilt', 'tilt'], data.SHAPES, 'tilt is named twice'),
])
def test_what_the_data_cannot_tell_is_refused_with_a_reason(names, shapes, message):
    with pytest.raises(IdentificationError, match=message):
        fit(names, shapes, stiff_as(TRUE_STIFFNESS))


def test_points_that_do_not_belong_to_the_pulls_are_refused():
    wrong = [replace(s, positions=s.positions + [0.05, 0.0, 0.05]) for s in data.SHAPES[3:6]]
    with pytest.raises(IdentificationError, match='reached the end|do not determine'):
        fit(STIFFNESS, wrong)


@pytest.mark.parametrize('described', [
    with_jams(tendon_friction=0.1), with_jams(yield_moments=(0.1,)),
    {**DESCRIBED, 'arm.tendon_axial_stiffness': 2e4},
    {**DESCRIBED, 'arm.tendon_axial_stiffness': 2e4, 'arm.tendon_friction': 0.1}],
    ids=['friction', 'jams that yield', 'stretch', 'stretch and friction'])
def test_stiffness_comes_out_whatever_else_the_arm_has(described):
    described = {**described, 'arm.bodies_per_segment': 6}
    true, shapes = true_with(described), []
    for k, shape in enumerate(data.measure(true, s) for s in specimen.identification_shapes()[3:]):
        state = simulate_steps(
            Statics(replace(true, payload=true.payload + shape.payload)), shape.steps)[-1]
        noise = np.random.default_rng(k).normal(0.0, 1e-4, shape.positions.shape)
        shapes.append(replace(shape, positions=state.poses[:, :3] + noise * [1.0, np.nan, 1.0]))
    assert fit(STIFFNESS, shapes, described).values == pytest.approx(TRUE_STIFFNESS, rel=0.02)


@pytest.mark.parametrize(('friction', 'ratio'), [(0.0, 1.01), (1e-6, 2.0), (1.2, 1e6)])
def test_every_description_is_a_start_within_the_bounds(friction, ratio):
    described = with_jams(ratio=ratio, tendon_friction=friction)
    names = [*STIFFNESS, 'ratio_1', 'segment_mass_1', 'disc_mass_3', 'offset_2', 'mass',
             'friction', 'tilt']
    for unknown in find_unknowns(names, described):
        assert unknown.low < unknown.start < unknown.high
        for value in (unknown.low, unknown.high):
            assert unknown.put(described, value) != described


def test_shapes_that_are_not_there_cannot_be_held_out():
    with pytest.raises(IdentificationError, match="no shape 'x' to hold out; .* c_form"):
        without(data.SHAPES, ['x'])
    with pytest.raises(IdentificationError, match='every shape is held out'):
        without(data.SHAPES[:1], ['c_form'])


def test_parameters_name_all_that_was_changed_and_the_springs_it_belongs_to():
    unknowns = find_unknowns(['stiffness_2', 'tilt', 'disc_mass_1'], DESCRIBED)
    parameters = parameters_of({
        **with_values(DESCRIBED, unknowns, np.array([0.02, 0.01, 0.07])),
        'arm.discretisation': SECOND_ORDER}, unknowns)
    assert set(parameters) == {
        'arm.discretisation', 'arm.bending_stiffnesses', 'arm.segment_masses',
        'arm.disc_masses', 'arm.mounting_angle'}
    assert parameters['arm.bending_stiffnesses'][1] == 0.02
    assert parameters['arm.disc_masses'][1] == 0.07
    assert parameters['arm.mounting_angle'] == 0.01
