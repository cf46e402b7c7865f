# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What was learned of the running arm is saved as far as it is determined, and no further."""

import pytest

from soft_continuum.client.estimate import LearnedParameter
from soft_continuum.parameters.files import write_parameters
from soft_continuum.parameters.overrides import Overrides
from soft_continuum.ros.description import load_arm
from soft_continuum.ros.estimates import model_from_ros, parameter_names
from soft_continuum.ui.cli.save_estimate import estimated_parameters, FILE
from soft_continuum.user_files import description_file
from soft_continuum_interfaces.msg import KinematicsState
from support.estimated_arm import ARM, learned


@pytest.fixture
def arm(estimated_of_module):
    return estimated_of_module




@pytest.fixture
def save(arm, call, tmp_path):
    """Return a function that saves what is learned; None: nothing is estimated."""
    def run(parameters, *options):
        arm.age = None if parameters is None else 0.05
        arm.state = KinematicsState(
            source=KinematicsState.PREDICTED if parameters is None else KinematicsState.ESTIMATED,
            parameters=parameters or [])
        return call('save-estimate', '--output', str(tmp_path), *options)

    return run


def test_what_is_determined_becomes_a_description_that_nodes_read(save, tmp_path):
    status, output, errors = save([
        learned('stiffness_factor_1', 1.25, 0.05),
        learned('stiffness_factor_2', 0.9, 0.25, determined=False),
        learned('stiff_ratio_3', 40.0, 4.0), learned('payload', 0.021, 0.002),
        learned('offset_left_tendon', -0.0012, 1e-4)])
    assert (status, errors) == (0, '')
    arm = load_arm(description_file(), tmp_path / FILE)
    before = [s.stiffness_y for s in ARM.segments]
    assert [s.stiffness_y for s in arm.segments] == pytest.approx([1.25 * before[0], *before[1:]])
    assert [s.jam.ratio for s in arm.segments] == pytest.approx(
        [*(s.jam.ratio for s in ARM.segments[:2]), 40.0])
    assert arm.payload == pytest.approx(0.021)
    # Deviations are comments; offsets belong to homing.
    text = (tmp_path / FILE).read_text(encoding='utf-8')
    assert f'# E I, segment 1: {1.25 * before[0]:.4g} +- {0.05 * before[0]:.2g} N m^2' in (
        text.replace('#   ', '# '))
    assert 'As described: stiffness factor, segment 2: not determined' in text
    assert text.startswith('# Estimated from measurements; soft_continuum save-estimate ')
    assert set(Overrides(tmp_path / FILE).of('/kinematics')) == {
        'arm.bending_stiffnesses', 'arm.stiffness_ratios', 'arm.payload'}
    assert 'left_tendon is pulled in by -1.20 +- 0.1 mm beyond what its motor says' in output
    assert 'stiffness factor, segment 2: not determined' in output
    # Nothing is overwritten unless that is asked for.
    status, _, errors = save([learned('payload', 0.5, 0.002)])
    assert status == 2 and 'add --force to overwrite it' in errors
    assert load_arm(description_file(), tmp_path / FILE).payload == pytest.approx(0.021)
    assert save([learned('payload', 0.5, 0.002)], '--force')[0] == 0
    assert load_arm(description_file(), tmp_path / FILE).payload == pytest.approx(0.5)


@pytest.mark.parametrize(('parameters', 'reason'), [
    (None, 'nothing is estimated, the shape is predicted by the model; never measured'),
    ([learned('stiffness_factor_1', 1.0, 0.25, determined=False)],
     'nothing that a description has is determined yet: stiffness factor, segment 1: not'),
    ([learned('offset_left_tendon', 0.001, 1e-4)], 'there are only offsets'),
    ([learned('stiffness_factor_1', float('nan'), 0.1)], 'nan is not positive'),
    ([learned('stiffness_factor_7', 1.0, 0.1)], 'this arm has no such segment'),
    ([learned('colour', 1.0, 0.1)], 'no parameter of a description')])
def test_what_is_not_determined_is_refused_with_the_reason(save, tmp_path, parameters, reason):
    status, _, errors = save(parameters)
    assert status == 1
    assert reason in errors and errors.count('\n') == 1
    assert not list(tmp_path.iterdir())


def test_a_value_that_is_not_plausible_is_written_with_a_warning(save, tmp_path):
    status, _, errors = save([
        learned('stiff_ratio_2', 4.1, 0.4, problem='less than 5: is the vacuum full?')])
    assert status == 0
    assert 'warning: K, segment 2 4.1: less than 5: is the vacuum full?' in errors
    assert '# NOT PLAUSIBLE: K, segment 2 4.1' in (tmp_path / FILE).read_text(encoding='utf-8')


def test_in_space_the_file_gives_the_arm_that_is_estimated(tmp_path):
    files = description_file().with_name('spatial_jamming.yaml'), tmp_path / 'leaf_springs.yaml'
    write_parameters(files[1], {'arm.lateral_bending_stiffnesses': (0.05, 0.0, 0.01),
                                'arm.torsional_stiffnesses': (0.02, 0.0, 0.003)}, [])
    arm = load_arm(*files)
    estimated = dict.fromkeys(parameter_names(arm), 1e-3) | {
        'stiffness_factor_1': 1.25, 'stiffness_factor_2': 0.9, 'stiffness_factor_3': 1.1,
        'stiff_ratio_1': 20.0, 'stiff_ratio_2': 30.0, 'stiff_ratio_3': 40.0, 'payload': 0.02}
    parameters = [learned(name, value, 1e-4) for name, value in estimated.items()]
    known = [LearnedParameter(p.name, p.value, p.stddev, p.determined) for p in parameters]
    write_parameters(tmp_path / FILE, estimated_parameters(known, arm).values, [])
    loaded = load_arm(*files, tmp_path / FILE)
    model = model_from_ros(parameters, arm).chain.arm
    assert loaded.payload == pytest.approx(model.payload)
    for one, other, described in zip(loaded.segments, model.segments, arm.segments, strict=True):
        for name in ('stiffness_x', 'stiffness_y', 'torsional_stiffness'):
            assert getattr(one, name) == pytest.approx(getattr(other, name))
        assert one.jam.ratio == pytest.approx(other.jam.ratio)
        assert one.stiffness_x != described.stiffness_x


def test_without_nodes_there_is_nothing_to_learn_from(arm, call, tmp_path):
    status, _, errors = call('save-estimate', '--output', str(tmp_path), namespace='/nobody',
                             timeout=0.5)
    assert status == 3 and 'do not run' in errors
    assert not list(tmp_path.iterdir())
