# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Unknowns come out as they are, with honest uncertainties, or not at all with a reason."""

from dataclasses import replace

import generate as specimen
import numpy as np
import pytest

from soft_continuum.analysis.identification import identify, shape_error, without
from soft_continuum.analysis.measured_shapes import simulate_steps
from soft_continuum.analysis.path_sensitivity import derivatives_of_points
from soft_continuum.analysis.unknowns import (
    find_unknowns,
    IdentificationError,
    parameters_of,
    with_values,
)
from soft_continuum.mechanics import Statics
from soft_continuum.mechanics.arm import SECOND_ORDER, Tendon
from soft_continuum.mechanics.laws import Jam
from soft_continuum.mechanics.sensitivity import Linearisation
from support import specimen_data as data

STIFFNESS = ['stiffness_1', 'stiffness_2', 'stiffness_3']
TRUE_STIFFNESS = np.array([s.bending_stiffness for s in data.TRUE.segments])
COARSE = replace(data.TRUE, bodies_per_segment=8)


def fit(names, shapes=data.SHAPES, arm=data.DESCRIBED):
    return identify(arm, find_unknowns(names, arm), shapes)


def with_jams(arm, ratio=12.0, friction=0.0):
    return replace(
        arm, tendon=Tendon(friction=friction),
        segments=tuple(replace(s, jam=Jam(ratio=ratio)) for s in arm.segments))


# Derivatives

@pytest.mark.parametrize('arm', [
    COARSE, with_jams(COARSE), with_jams(COARSE, friction=0.1),
    replace(COARSE, tendon=Tendon(axial_stiffness=2e4, free_length=0.3))],
    ids=['rigid when stiff', 'elastic when stiff', 'with friction', 'tendons that stretch'])
@pytest.mark.parametrize('index', [0, 2, 4, 7])
def test_derivatives_are_those_of_the_whole_path(arm, index):
    names = ['stiffness_1', 'stiffness_3', 'segment_mass_2', 'disc_mass_3', 'offset_1', 'mass',
             'tilt']
    if arm.tendon.friction:
        names.append('friction')
    if not arm.segments[0].jam.rigid:
        names.append('ratio_2')
    unknowns = find_unknowns(names, arm)
    scales = np.array([u.scale for u in unknowns])
    values = np.array([u.start for u in unknowns])
    shape = specimen.identification_shapes()[index]
    steps, _ = specimen.set_on(arm, shape)
    arm = replace(arm, payload=shape.payload)

    def statics_at(v):
        return Statics(with_values(arm, unknowns, v))

    def points(v):
        return simulate_steps(statics_at(v), steps)[-1].points[:, :2]

    derivatives = derivatives_of_points(
        statics_at, values, scales, steps, simulate_steps(statics_at(values), steps))
    step = 1e-5 * scales
    for k in range(len(names)):
        change = step * (np.arange(len(names)) == k)
        difference = (points(values + change) - points(values - change)) / (2e-5)
        assert derivatives[:, :, k] * scales[k] == pytest.approx(difference, abs=2e-8), names[k]


def test_derivatives_of_one_step_are_those_of_the_linearised_statics():
    shape = specimen.paper_shapes()[0]
    steps, _ = specimen.set_on(COARSE, specimen.SetShape('one', shape.angles[:1]))
    unknowns = find_unknowns(STIFFNESS, COARSE)
    scales = np.array([u.scale for u in unknowns])
    states = simulate_steps(Statics(with_values(COARSE, unknowns, scales)), steps)
    derivatives = derivatives_of_points(
        lambda v: Statics(with_values(COARSE, unknowns, v)), scales, scales, steps, states)
    tip = Linearisation(Statics(COARSE), states[-1]).bending_stiffness().tip
    assert derivatives[-1] == pytest.approx(tip[:2], rel=1e-6, abs=1e-9)


# Recovery

@pytest.fixture(scope='module')
def found():
    return fit(STIFFNESS)


def test_every_stiffness_is_recovered_within_2_percent(found):
    assert found.values == pytest.approx(TRUE_STIFFNESS, rel=0.02)
    assert found.noise == pytest.approx(0.3e-3, rel=0.2)


def test_the_intervals_hold_the_true_values_as_often_as_they_say():
    clean = [data.measure(data.TRUE, shape) for shape in specimen.identification_shapes()]
    held = 0
    for seed in range(6):
        rng = np.random.default_rng(100 + seed)
        noisy = [replace(s, positions=s.positions + rng.normal(0.0, 0.3e-3, s.positions.shape))
                 for s in clean]
        found = fit(STIFFNESS, noisy, with_values(
            data.DESCRIBED, find_unknowns(STIFFNESS, data.DESCRIBED), TRUE_STIFFNESS))
        held += int(np.sum(np.abs(found.values - TRUE_STIFFNESS) <= found.half_widths))
    assert held >= 14  # of 18: 17 are to be expected, fewer than 14 in one of 500


def test_masses_come_out_beside_stiffness_where_a_known_payload_hangs():
    light = with_values(data.DESCRIBED, find_unknowns(['mass'], data.DESCRIBED), np.array([0.8]))
    found = fit([*STIFFNESS, 'mass'], arm=light)
    assert found.values[-1] == pytest.approx(1.25, abs=found.half_widths[-1])
    assert found.half_widths[-1] < 0.1
    assert np.all(found.correlations[:3, 3] > 0.9)  # only the payload tells them apart


def test_tilt_of_the_base_and_guide_offsets_come_out():
    tilted = replace(data.TRUE, mounting_angle=0.02)
    shapes = [data.measure(tilted, s, 0.3e-3, k)
              for k, s in enumerate(specimen.identification_shapes())]
    found = fit([*STIFFNESS, 'offset_2', 'tilt'], shapes)
    assert found.values[-1] == pytest.approx(0.02, abs=0.003)
    assert found.values[-2] == pytest.approx(0.02125, abs=2e-4)
    assert found.values[:3] == pytest.approx(TRUE_STIFFNESS, rel=0.02)


def test_ratios_of_elastic_stiff_segments_come_out():
    true = with_jams(data.TRUE)
    shapes = [data.measure(true, s, 0.1e-3, k)
              for k, s in enumerate(specimen.identification_shapes())]
    found = fit(['ratio_1', 'ratio_2'], shapes, with_jams(
        replace(true, bodies_per_segment=12), ratio=20.0).with_bending_stiffness(
            2, TRUE_STIFFNESS[2]))
    assert found.values[0] == pytest.approx(12.0, rel=0.3)


def test_the_same_data_give_the_same_values_to_the_last_bit(found):
    assert np.array_equal(fit(STIFFNESS).values, found.values)


def test_a_shape_that_the_fit_has_not_seen_is_predicted_as_well():
    kept = without(data.SHAPES, ['c_form', 'released_3'])
    found = fit(STIFFNESS, kept)
    unseen = [s for s in data.SHAPES if s not in kept]
    assert len(unseen) == 2
    for shape in unseen:
        assert shape_error(found.arm, shape).max() < 1.5e-3
        assert shape_error(data.DESCRIBED, shape).max() > 50e-3


# Refusal

@pytest.mark.parametrize(('names', 'shapes', 'message'), [
    ([*STIFFNESS, 'friction'], data.SHAPES,
     'do not determine friction: no measured point moves with it. .* only the tension'),
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
    arm = data.DESCRIBED
    for i, stiffness in enumerate(TRUE_STIFFNESS):
        arm = arm.with_bending_stiffness(i, float(stiffness))
    with pytest.raises(IdentificationError, match=message):
        fit(names, shapes, arm)


def test_points_that_do_not_belong_to_the_pulls_are_refused():
    wrong = [replace(s, positions=s.positions + [0.05, 0.05]) for s in data.SHAPES[3:6]]
    with pytest.raises(IdentificationError, match='went to the end|do not determine'):
        fit(STIFFNESS, wrong)


def test_stretch_and_friction_together_are_refused():
    arm = replace(data.DESCRIBED, tendon=Tendon(axial_stiffness=2e4, friction=0.1))
    with pytest.raises(IdentificationError, match='friction together with tendons that stretch'):
        fit(STIFFNESS, arm=arm)


def test_jams_that_yield_are_refused():
    arm = replace(data.DESCRIBED, segments=tuple(
        replace(s, jam=Jam(ratio=10.0, yield_moment=0.1)) for s in data.DESCRIBED.segments))
    with pytest.raises(IdentificationError, match='jams that yield'):
        fit(STIFFNESS, arm=arm)


@pytest.mark.parametrize(('friction', 'ratio'), [(0.0, 1.01), (1e-6, 2.0), (1.2, 1e6)])
def test_every_description_is_a_start_within_the_bounds(friction, ratio):
    arm = with_jams(data.DESCRIBED, ratio, friction)
    names = [*STIFFNESS, 'ratio_1', 'segment_mass_1', 'disc_mass_3', 'offset_2', 'mass',
             'friction', 'tilt']
    for unknown in find_unknowns(names, arm):
        assert unknown.low < unknown.start < unknown.high
        for value in (unknown.low, unknown.high):
            assert unknown.put(arm, value) != arm


def test_shapes_that_are_not_there_cannot_be_held_out():
    with pytest.raises(IdentificationError, match="no shape 'x' to hold out; .* c_form"):
        without(data.SHAPES, ['x'])
    with pytest.raises(IdentificationError, match='every shape is held out'):
        without(data.SHAPES[:1], ['c_form'])


def test_parameters_name_all_that_was_changed_and_the_springs_it_belongs_to():
    unknowns = find_unknowns(['stiffness_2', 'tilt', 'disc_mass_1'], data.DESCRIBED)
    arm = replace(with_values(data.DESCRIBED, unknowns, np.array([0.02, 0.01, 0.07])),
                  discretisation=SECOND_ORDER)
    parameters = parameters_of(arm, unknowns)
    assert set(parameters) == {
        'arm.discretisation', 'arm.bending_stiffnesses', 'arm.segment_masses',
        'arm.disc_masses', 'arm.mounting_angle'}
    assert parameters['arm.bending_stiffnesses'][1] == 0.02
    assert parameters['arm.disc_masses'][1] == 0.07
    assert parameters['arm.mounting_angle'] == 0.01
