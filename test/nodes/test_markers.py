# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What is shown beside the arm: where the model alone has it, and what is wrong with it."""

from pathlib import Path

from builtin_interfaces.msg import Time
import pytest
from visualization_msgs.msg import Marker
import yaml

from soft_continuum.colours import PREDICTED, WRONG
from soft_continuum.mechanics import Chain
from soft_continuum.nodes.markers import alarm_marker, prediction_marker, shape_markers
from soft_continuum.parameters.files import load_arm
from soft_continuum.user_files import description_file

CHAIN = Chain(load_arm(description_file()))
BENT = CHAIN.uniform((0.3, -0.2, 0.25))
CONFIG = Path(__file__).resolve().parents[2] / 'config'
ALARM = ('left_tendon is 4.0 mm longer than its motor reports: it slipped in its clamp or left a '
         'guide')


def colour(marker):
    """Return red, green and blue, 0 to 255."""
    return tuple(round(255 * part) for part in (marker.color.r, marker.color.g, marker.color.b))


def is_gone_when_not_repeated(marker):
    """Whether a view removes a marker by itself."""
    return 0.0 < marker.lifetime.sec + 1e-9 * marker.lifetime.nanosec <= 1.0


def test_the_prediction_is_a_translucent_ghost_along_the_backbone():
    marker = prediction_marker(BENT, 'base_link', Time(sec=3))
    assert (marker.type, marker.header.frame_id, marker.header.stamp.sec) == (
        Marker.LINE_STRIP, 'base_link', 3)
    assert colour(marker) == PREDICTED and 0.0 < marker.color.a < 1.0
    x, _, z = BENT.tip
    assert (marker.points[-1].x, marker.points[-1].z) == pytest.approx((x, z))
    assert is_gone_when_not_repeated(marker)


def test_what_is_wrong_stands_above_the_arm_in_lines_that_can_be_read():
    marker = alarm_marker([ALARM, 'the camera has moved'], 0.4, 'base_link', Time())
    assert marker.type == Marker.TEXT_VIEW_FACING and colour(marker) == WRONG
    assert marker.text.replace('\n', ' ') == f'{ALARM} the camera has moved'
    assert max(map(len, marker.text.splitlines())) <= 60
    assert marker.pose.position.z >= 0.4 and marker.scale.z > 0.0
    assert is_gone_when_not_repeated(marker)


def test_rviz_shows_both_beside_the_arm():
    displays = yaml.safe_load((CONFIG / 'arm.rviz').read_text(encoding='utf-8'))[
        'Visualization Manager']['Displays']
    namespaces, = (one['Namespaces'] for one in displays
                   if one.get('Topic', {}).get('Value') == 'shape_markers')
    arm = shape_markers(CHAIN, BENT, (True,) * 3, 50.0, 'base_link', Time()).markers
    extra = [prediction_marker(BENT, 'base_link', Time()), alarm_marker([], 0.4, '', Time())]
    assert namespaces.keys() == {marker.ns for marker in [*arm, *extra]}
    assert all(namespaces[marker.ns] for marker in extra)
