# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Which arms tendons alone bend segment by segment."""

from dataclasses import replace

from soft_continuum.mechanics.constant_curvature import fully_actuated
from soft_continuum.parameters.files import load_arm
from soft_continuum.user_files import description_file
from support.flat_arm import of_segments
from support.spatial_arms import three_segments

PAPER = load_arm(description_file())
TENDON_ARM = load_arm(description_file().with_name('tendon_arm.yaml'))


def to_the_tip(count):
    """Return the tendon arm with the first few tendons of its last segment only."""
    return replace(TENDON_ARM, tendons=TENDON_ARM.tendons[-count:])


def hinged(arm):
    """Return an arm whose segments bend about y only."""
    return replace(arm, segments=tuple(
        replace(s, stiffness_x=float('inf')) for s in arm.segments))


def test_two_tendons_along_three_segments_bend_them_together():
    assert not fully_actuated(PAPER)


def test_two_tendons_bend_one_planar_segment():
    assert fully_actuated(of_segments(PAPER, [0]))


def test_three_tendons_for_each_segment_bend_each():
    assert fully_actuated(TENDON_ARM) and fully_actuated(hinged(TENDON_ARM))


def test_tendons_that_all_end_at_the_tip_do_not():
    assert not fully_actuated(to_the_tip(3))
    assert not fully_actuated(three_segments(tendons=3))


def test_one_tendon_less_than_bendings_is_too_few():
    assert not fully_actuated(replace(TENDON_ARM, tendons=TENDON_ARM.tendons[:5]))
