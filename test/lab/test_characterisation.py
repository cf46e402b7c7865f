# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Stiffness from force-displacement curves is right, and so is what is said of its confidence."""

import numpy as np
import pytest
from scipy.signal import lfilter

from soft_continuum.lab.analysis.characterisation import (
    characterise,
    question_soft,
    question_stiff,
    regress,
)
from soft_continuum.lab.analysis.curves import Curve
from soft_continuum.lab.analysis.delimited import MeasurementError
from soft_continuum.mechanics.laws import MomentCurvature
from support import curve_files as files

UP = files.ramp()
LEAF = 200e9 * 0.0127 * 0.00035**3 / 12  # N m^2, segment 2 of the paper


def result_of(*pairs):
    return characterise([Curve(str(k), *pair) for k, pair in enumerate(pairs)],
                        files.LENGTH, files.LEVER_ARM)


def test_the_stated_lever_arm_gives_another_stiffness_than_the_paper():
    result = characterise([Curve('', UP, files.SLOPE * UP)], files.LENGTH, 0.030)
    assert result.bending_stiffness == pytest.approx(0.02335, abs=5e-6)


def test_one_line_goes_through_all_repetitions():
    result = regress([Curve('', UP, k * UP) for k in (70.0, 72.0, 74.0)])
    assert result.slope == pytest.approx(72.0)
    assert result.each == pytest.approx([70.0, 72.0, 74.0])


@pytest.mark.parametrize('starts', [(50.0, 51.0, 52.0), (0.0, 70.0, 35.0), (0.0, 0.5, 1.0)])
def test_where_repetitions_begin_changes_nothing(starts):
    rng = np.random.default_rng(10)
    forces = [files.noisy(k, ramp, rng) for k, ramp in zip(
        (71.0, 72.0, 73.0), (UP, files.ramp(points=60), UP), strict=True)]
    at_zero, apart = (result_of(*(
        (start * 1e-3 + files.ramp(points=len(force)), force)
        for start, force in zip(begin, forces, strict=True))) for begin in ((0.0,) * 3, starts))
    assert apart.regression.slope == pytest.approx(at_zero.regression.slope)
    assert apart.regression.determination == pytest.approx(at_zero.regression.determination)
    assert apart.settling == pytest.approx(at_zero.settling)
    assert apart.spread == pytest.approx(at_zero.spread)
    assert apart.linearity_error == pytest.approx(at_zero.linearity_error, abs=1e-9)


def test_the_confidence_interval_holds_the_true_slope_as_often_as_it_says():
    rng = np.random.default_rng(11)
    held = 0
    for _ in range(400):
        curves = [Curve('', UP, files.noisy(rng.normal(72.0, 1.0), UP, rng)) for _ in range(3)]
        line = regress(curves)
        held += abs(line.slope - 72.0) <= line.half_width
    assert 0.92 < held / 400 < 0.98


@pytest.mark.parametrize('correlation', [0.0, 0.9])
def test_the_interval_knows_of_correlated_noise_where_repetitions_happen_to_agree(correlation):
    rng = np.random.default_rng(12)
    held = 0
    long = files.ramp(points=1001)
    for _ in range(300):
        noise = lfilter([1.0], [1.0, -correlation], rng.normal(0.0, 0.002, long.size))
        line = regress([Curve('', long, 72.0 * long + noise)] * 2)
        held += abs(line.slope - 72.0) <= line.half_width * np.sqrt(2.0)  # it is one, twice
    assert 0.90 < held / 300 < 0.99


def test_one_repetition_says_nothing_of_how_repetitions_scatter():
    result = result_of((UP, 72.0 * UP))
    assert result.bending_stiffness > 0.0
    assert np.isnan([result.half_width, result.regression.half_width, result.settling,
                     result.spread]).all()


def test_settling_and_spread_are_those_of_the_forces():
    result = result_of(*((UP, k * UP) for k in (72.0, 71.0, 68.4)))
    assert result.settling == pytest.approx(-0.05)
    assert result.spread == pytest.approx(3.6 * 0.010)


def test_hysteresis_is_the_work_lost_over_the_work_put_in():
    both = np.concatenate([UP, UP[-2::-1]])
    force = np.concatenate([72.0 * UP, 54.0 * UP[-2::-1]])
    # The turn is one point of both ways.
    assert result_of((both, force)).hysteresis == pytest.approx((0.25,), abs=0.005)
    assert result_of((UP, 72.0 * UP)).hysteresis == ()


def test_the_way_down_does_not_count_for_the_stiffness():
    both = np.concatenate([UP, UP[-2::-1]])
    force = np.concatenate([72.0 * UP, 20.0 * UP[-2::-1]])
    assert result_of((both, force)).regression.slope == pytest.approx(72.0)


def test_a_linear_segment_has_no_table_however_much_it_settles_or_scatters():
    rng = np.random.default_rng(13)
    for _ in range(20):
        slopes = rng.normal(72.0, 5.0, 3)
        result = result_of(*((UP, files.noisy(k, UP, rng, 0.02)) for k in slopes))
        assert result.table is None


@pytest.mark.parametrize('law', [
    MomentCurvature((0.0, 1.0, 6.0), (0.0, 0.03, 0.09)),   # softens
    MomentCurvature((0.0, 2.0, 4.0), (0.0, 0.03, 0.12)),   # stiffens
])
def test_a_segment_that_is_not_linear_gets_its_moment_curvature_table(law):
    force = np.linspace(0.0, 0.9, 301)
    rng = np.random.default_rng(14)
    result = result_of(*((files.cantilever(law, force), force + rng.normal(0.0, 0.002, 301))
                         for _ in range(3)))
    assert result.linearity_error > 0.05
    assert result.table is not None
    for curvature in np.linspace(0.3, 0.95, 8) * result.table.curvatures[-1]:
        # The kink lies between two rows of the table.
        assert result.table.moment(curvature) == pytest.approx(
            law.moment(curvature), abs=0.05 * result.table.moments[-1])


def test_the_table_of_a_linear_law_would_be_its_line():
    force = np.linspace(0.0, 0.72, 301)
    bent = files.cantilever(MomentCurvature((0.0, 10.0), (0.0, 0.202)), force)
    assert bent[-1] == pytest.approx(0.010, rel=1e-3)  # eq. 8
    assert result_of((bent, force)).linearity_error < 1e-6


def test_a_force_that_falls_is_refused():
    with pytest.raises(MeasurementError, match='the force falls with displacement'):
        result_of((UP, 1.0 - 72.0 * UP))


@pytest.mark.parametrize('factor', [1e-3, 0.1, 10.0, 1e3])
@pytest.mark.parametrize('over_leaf', [1.2, 2.2, 5.0])
def test_a_soft_stiffness_off_by_10_or_1000_is_questioned(factor, over_leaf):
    slope = files.SLOPE * over_leaf / 2.2256
    right, wrong = (result_of((UP, k * UP)) for k in (slope, factor * slope))
    assert question_soft(right, LEAF, 'the leaf spring') == ''
    assert 'times that of the leaf spring' in question_soft(wrong, LEAF, 'the leaf spring')


@pytest.mark.parametrize(('ratio', 'message'), [
    (0.9, 'swapped'), (1e3, 'off by about 100'), (15.0, ''), (4.0, '')])
def test_a_stiff_state_that_is_none_is_questioned(ratio, message):
    result = result_of((UP, ratio * files.SLOPE * UP))
    question = question_stiff(result, 0.020197)
    assert message in question
    assert bool(question) == bool(message)
