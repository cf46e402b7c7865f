# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The client and the command line bring the tip somewhere, and ask for plans."""

from math import cos, hypot, radians, sin

import pytest

from soft_continuum.client import RefusedError, Tip

TOLERANCE = 1e-3  # m


def test_reach_brings_the_tip_to_a_place_and_a_plan_tells_before(arm, client):
    plan = client.plan(Tip((0.12, 0.26)))
    assert plan.found and plan.message == ''
    assert plan.softenings == len(plan.steps) >= 1
    end = plan.steps[-1].tip[-1]
    assert hypot(end.x - 0.12, end.z - 0.26) <= TOLERANCE and end.is_planar
    assert 0.0 < plan.tension < 60.0 and plan.duration > 0.0
    seen = []
    result = client.reach(0.12, 0.26, progress=seen.append)
    assert result.reached.tip_error <= TOLERANCE and result.reached.replans == 0
    assert result.reached.bending_angles == pytest.approx(plan.steps[-1].bending_angles, abs=0.01)
    assert {progress.shape for progress in seen} == {'tip at (120, 260) mm'}
    assert {progress.aim for progress in seen} == {'tip'}


def test_what_the_tip_cannot_do_is_refused(client):
    with pytest.raises(RefusedError, match='y = 0.01 m; a planar arm'):
        client.reach(0.12, 0.01, 0.26)
    with pytest.raises(RefusedError, match='out of reach'):
        client.run(Tip((0.5, 0.5)), 'c_form')
    with pytest.raises(ValueError, match='path'):
        client.follow([])
    plan = client.plan(Tip((0.5, 0.5)))
    assert not plan.found and 'out of reach' in plan.message
    for wrong in ({'position': (0.1,)}, {'position': (0.1, float('nan'))},
                  {'position': (0.1, 0.2), 'direction': (0.0, 0.0, 0.0)},
                  {'position': (0.1, 0.2), 'angle': 0.1, 'direction': (0.0, 0.0, 1.0)}):
        with pytest.raises(ValueError, match='position|direction'):
            Tip(**wrong)


@pytest.mark.parametrize('angle', [0.0, 0.7, -1.2, radians(180.0)])
def test_a_direction_turns_z_by_its_angle(angle):
    x, y, z, w = Tip((0.1, 0.2), angle=angle).quaternion
    # Where a rotation by the quaternion brings the z axis.
    assert (2.0 * (x * z + w * y), 1.0 - 2.0 * (x * x + y * y)) == pytest.approx(
        (sin(angle), cos(angle)), abs=1e-12)


def test_the_command_line_reaches_and_follows(arm, call, tmp_path):
    status, output, errors = call('reach', '-100', '280', '--unit', 'mm')
    assert (status, errors) == (0, '')
    assert 'tip at (-100, 280) mm, segment' in output and output.splitlines()[-2] == 'done'
    path = tmp_path / 'path.csv'
    path.write_text('x [mm],z [mm]\n-100,280\n-90,288\n')
    status, output, errors = call('follow', str(path), '--unit', 'mm', '--tolerance', '4')
    assert (status, errors) == (0, '')
    assert 'path through 2 points' in output
    status, _, errors = call('reach', '500', '500', '--unit', 'mm')
    assert (status, errors.count('\n')) == (1, 1) and 'out of reach' in errors
