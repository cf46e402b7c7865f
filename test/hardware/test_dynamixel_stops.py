# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Servos that are stopped in motion rest soon, and stay there.

``./run soak --only dynamixel`` stops them a thousand times.
"""

from random import Random
from statistics import median

from support.servo_rig import BEYOND_TURN, rig
from support.servo_stops import MAX_STOP_TIME, MEDIAN_STOP_TIME, REST_DISTANCE, stop_in_motion


def test_stopped_servos_rest_within_150_ms_and_stay_there(tmp_path):
    random, stops = Random(2), []
    with rig(tmp_path, BEYOND_TURN) as made:
        while len(stops) < 8:
            if (stop := stop_in_motion(made, random)) is not None:
                stops.append(stop)
    times = [stop.slow for stop in stops]
    assert median(times) < MEDIAN_STOP_TIME
    assert max(times) < MAX_STOP_TIME
    assert max(stop.moved for stop in stops) < REST_DISTANCE
