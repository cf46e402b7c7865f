# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""
What a person sees and does in a real browser, and what the arm does then.

One arm and one page, used by one test after the other.
"""

from copy import deepcopy
from pathlib import Path
import re

from conftest import OpenPage, SLOW
from geometry_msgs.msg import PoseWithCovarianceStamped
from page import dark, DEADLINE, green, orange, Page, teal
from playwright.sync_api import expect
import pytest
from ros_rig import Rig
from std_msgs.msg import Bool

from soft_continuum.ros.qos import LATCHED, STREAM

pytestmark = pytest.mark.timeout(600)
ARTEFACT = Path(__file__).resolve().parents[2] / 'log' / 'browser' / 'view.png'
MANY = 10**6  # pixels


def test_the_arm_is_drawn_and_a_soft_segment_is_seen_to_be_soft(page: Page, rig: Rig) -> None:
    page.wait_for_pixels(dark, 180, MANY, 'dark, as stiff skins are')
    page.wait_for_pixels(orange, 0, 0, 'orange, though no segment is soft')
    page.click('soften', 1)
    rig.wait_for(lambda: rig.soft_segments() == [2], 'segment 2 soft')
    page.wait_for_pixels(orange, 60, MANY, 'orange, as a soft skin is')
    page.picture(ARTEFACT)
    page.click('stiffen', 1)
    rig.wait_for(lambda: rig.all_stiff, 'all stiff')
    page.wait_for_pixels(orange, 0, 0, 'orange, though no segment is soft')


def test_tendons_are_jogged_by_steps_and_a_refusal_says_why(page: Page, rig: Rig) -> None:
    expect(page.button('-5')).to_be_disabled()  # no jogging while all is stiff
    page.click('soften', 2)
    page.click('-5', 1)
    rig.wait_for(lambda: rig.pulls[1] == pytest.approx(-0.005, abs=2e-5), 'the left one paid out')
    page.click('+1', 0)
    rig.wait_for(lambda: rig.pulls[0] == pytest.approx(0.001, abs=2e-5), 'the right one pulled in')
    assert rig.pulls[1] == pytest.approx(-0.005, abs=2e-5)
    page.click('+5', 0)
    rig.wait_for(lambda: rig.pulls[0] == pytest.approx(0.006, abs=2e-5), 'the right one pulled in')
    page.click('+5', 1)
    page.click('+5', 1)
    page.wait_for_bar('Jog: refused')
    page.wait_for_bar('co_contraction_limit')


def test_stop_stops_a_sequence_and_resume_is_needed_to_go_on(page: Page, rig: Rig) -> None:
    page.click('c_form')
    page.wait_for_bar('Setting c_form')
    page.wait_for_pixels(green, 25, MANY, 'green, as the shape it goes to is')
    expect(page.button('soften', 2)).to_be_disabled()
    page.click('STOP')
    rig.wait_for_status('tendon_actuation', 'stopped', 'stop was called')
    rig.wait_for(lambda: not rig.moving, 'rest')
    rig.assert_rests(5)
    page.wait_for_bar('STOPPED')
    page.wait_for_bar('press Resume')
    page.wait_for_text('press Resume')
    page.wait_for_pixels(green, 0, 5, 'green, though it goes nowhere any more')
    for name in ('c_form', 'Run sequence', '+5', 'Cancel'):
        expect(page.button(name)).to_be_disabled()
    expect(page.page).to_have_title('STOPPED · soft_continuum')
    expect(page.page.locator('body')).to_have_class('stopped')

    page.click('Resume')
    rig.wait_for(lambda: not rig.status_value('tendon_actuation', 'stopped'), 'no stop any more')
    expect(page.button('Resume')).to_be_disabled(timeout=DEADLINE * 1e3)
    expect(page.page).to_have_title('soft_continuum')
    expect(page.button('c_form')).to_be_enabled(timeout=DEADLINE * 1e3)
    rig.assert_rests(5)


def test_what_sensors_see_is_drawn_beside_the_model_and_its_distance_is_said(
        page: Page, rig: Rig) -> None:
    page.wait_for_text('no sensor measures the discs')
    page.wait_for_pixels(teal, 0, 0, 'teal, though nothing is measured')
    sender = rig.publisher(PoseWithCovarianceStamped, 'disc_3/measured_pose', STREAM)
    tip = rig.disc_poses.last.poses[6]
    message = PoseWithCovarianceStamped()
    message.pose.pose = deepcopy(tip)
    message.pose.pose.position.x += 0.0123

    def said() -> bool:
        sender.publish(message)
        return page.view.get_by_text(re.compile('12.3.mm')).count() > 0

    rig.wait_for(said, 'the distance of disc 3')
    sender.publish(message)
    page.picture(ARTEFACT.with_name('measured.png'))
    page.wait_for_pixels(teal, 40, MANY, 'teal, as what is measured is')
    page.wait_for_text('no sensor measures the discs')  # a sensor that says nothing any more


def test_an_emergency_stop_greys_what_it_refuses_until_it_is_off(page: Page, rig: Rig) -> None:
    button = rig.publisher(Bool, 'emergency_stop', LATCHED)
    refused = [page.button('soften', 2), page.button('Stiffen all'), page.button('Resume')]
    button.publish(Bool(data=True))
    page.wait_for_bar('turns it off and you press Resume')
    for control in (*refused, page.button('c_form')):
        expect(control).to_be_disabled(timeout=DEADLINE * 1e3)
    button.publish(Bool(data=False))
    for control in refused:
        expect(control).to_be_enabled(timeout=DEADLINE * 1e3)
    page.click('Resume')
    page.wait_for_bar('Ready')


def test_nothing_covers_stop_and_no_panel_covers_the_arm_at_any_size(
        page: Page, rig: Rig) -> None:
    names = page.view.get_by_role('textbox').first
    names.fill('nonsense' * 100)
    page.click('Run sequence')
    page.wait_for_bar('Sequence: refused')
    usual = page.page.viewport_size
    for width, height in ((800, 600), (390, 844)):
        page.page.set_viewport_size({'width': width, 'height': height})
        assert page.is_on_top('stop') and page.is_on_top('resume'), width
        canvas = page.view.locator('canvas').first.bounding_box()
        controls = page.view.get_by_text('Shapes', exact=True).first.bounding_box()
        assert canvas['width'] > 0.4 * width and canvas['height'] > 200
        assert (controls['x'] >= canvas['x'] + canvas['width']
                or controls['y'] >= canvas['y'] + canvas['height']), (width, canvas, controls)
    page.view.locator('body').press('Control+k')  # viser's list of commands, over all of its page
    assert page.is_on_top('stop') and page.is_on_top('resume')
    page.view.locator('body').press('Escape')
    page.page.set_viewport_size(usual)


def test_two_browsers_see_the_same_and_a_closed_one_changes_nothing(
        page: Page, rig: Rig, shared: tuple[Rig, Page, str], open_page: OpenPage) -> None:
    other = open_page(shared[2])
    other.click('c_form')
    page.wait_for_bar('Setting c_form')
    other.close()
    then = len(rig.tendons)
    rig.wait_for(lambda: rig.moving and len(rig.tendons) > then + 20, 'the motion to go on')
    page.click('STOP')
    page.wait_for_text('Sequence ended')
    rig.wait_for_status('tendon_actuation', 'stopped', 'stop was called')


def test_a_sequence_is_run_as_it_is_written_and_its_end_is_reported(page: Page, rig: Rig) -> None:
    names = page.view.get_by_role('textbox').first
    names.fill('nonsense')
    page.click('Run sequence')
    page.wait_for_bar("unknown shape 'nonsense'")
    rig.set_parameter('shape_sequencer', 'tendon_speed', 0.1)
    names.fill('upright_c_form, c_form')
    page.click('Run sequence')
    page.wait_for_text('Sequence done')
    assert rig.status_value('shape_sequencer', 'last') == 'SUCCESSFUL'
    page.wait_for_text('+36.0°')
    page.wait_for_no_text('-36.0°')


def test_when_the_nodes_end_it_says_how_to_start_them_and_continues_when_they_run(
        page: Page, rig: Rig) -> None:
    rig.end(rig._groups[0].nodes[0])
    page.wait_for_bar('No node is running')
    page.wait_for_bar('./run up')
    page.wait_for_pixels(dark, 0, 75, 'dark, though nothing is known of the arm')
    page.click('STOP')
    page.wait_for_bar('Stop: failed')
    rig.start_arm(**SLOW)
    page.wait_for_bar('Ready')
    page.wait_for_pixels(dark, 180, MANY, 'dark, as stiff skins are')
    page.click('soften', 0)
    rig.wait_for(lambda: rig.soft_segments() == [1], 'segment 1 soft')
