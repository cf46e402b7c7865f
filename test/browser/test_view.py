# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
What a person sees and does in a real browser, and what the arm does then.

One arm and one page, used by one test after the other.
"""

from array import array
from copy import deepcopy
import io
from pathlib import Path
import re
import signal

from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseWithCovarianceStamped
from PIL import Image
from playwright.sync_api import expect
import pytest
from sensor_msgs.msg import CompressedImage
from std_msgs.msg import Bool
from visualization_msgs.msg import Marker, MarkerArray

from soft_continuum.lab.recordings.tables import read_recording
from soft_continuum.planning.obstacles import Box, Capsule, Obstacle, Sphere
from soft_continuum.ros.entries import LATCHED, OBSTACLES, STREAM
from soft_continuum.ros.obstacles import obstacle_to_ros
from soft_continuum.user_files import description_file
from support.descriptions import given_in
from support.page import address_of, dark, DEADLINE, green, olive, orange, SLOW, start_view, teal

pytestmark = pytest.mark.timeout(600)
ARTEFACT = Path(__file__).resolve().parents[2] / 'log' / 'browser' / 'view.png'
MANY = 10**6  # pixels


NOTHING = [(orange, 0, 0, 'orange, though no segment is soft'),
           (teal, 0, 0, 'teal, though nothing is measured'),
           (olive, 0, 5, 'olive, though there is no obstacle')]


def test_what_is_known_of_the_arm_and_around_it_is_drawn_as_long_as_it_is_known(page, rig):
    page.wait_for_text('no sensor measures the discs')
    page.wait_for_pixels((dark, 180, MANY, 'dark, as stiff skins are'), *NOTHING)

    sender = rig.publisher(PoseWithCovarianceStamped, 'disc_3/measured_pose', STREAM)
    message = PoseWithCovarianceStamped()
    message.pose.pose = deepcopy(rig.disc_poses.last.poses[6])
    message.pose.pose.position.x += 0.0123
    message.pose.covariance[[0, 7, 14, 21, 28, 35]] = 1e-6
    message.header.frame_id = 'base_link'
    pictures = rig.publisher(CompressedImage, 'camera/overlay/compressed', STREAM)
    seen = io.BytesIO()
    Image.new('RGB', (64, 48)).save(seen, 'jpeg')
    picture = page.view.get_by_alt_text('The arm as the camera sees it')
    expect(picture).to_have_count(0)

    def publish():
        sender.publish(message)
        pictures.publish(CompressedImage(data=array('B', seen.getvalue())))
        pictures.publish(CompressedImage(data=array('B', b'<script>')))

    sensors = rig.observer.create_timer(0.3, publish)
    obstacles = rig.publisher(MarkerArray, 'obstacles', OBSTACLES)
    obstacles.publish(MarkerArray(markers=[
        marker for one in (Obstacle('ball', Sphere(0.03), (0.14, 0.0, 0.1)),
                           Obstacle('pipe', Capsule(0.015, 0.08), (-0.14, 0.0, 0.1)),
                           Obstacle('box', Box((0.05, 0.05, 0.05)), (0.14, 0.0, 0.25)))
        for marker in obstacle_to_ros((one.name, 0), one, 'base_link', Time())]))
    page.click('soften', 1)
    rig.wait_for(lambda: rig.soft_segments() == [2], 'segment 2 soft')
    page.wait_for(lambda: page.view.get_by_text(re.compile('12.3.mm')).count() > 0,
                  'the distance of disc 3')
    page.wait_for(lambda: picture.evaluate_all(
        'all => all.map(one => one.naturalWidth)') == [64], 'the picture of the camera')
    page.wait_for_pixels((orange, 60, MANY, 'orange, as a soft skin is'),
                         (teal, 40, MANY, 'teal, as what is measured is'),
                         (olive, 100, MANY, 'olive, as obstacles are'))
    page.picture(ARTEFACT)

    sensors.cancel()
    obstacles.publish(MarkerArray(markers=[Marker(action=Marker.DELETEALL)]))
    page.click('stiffen', 1)
    rig.wait_for(lambda: rig.all_stiff, 'all stiff')
    page.wait_for_text('no sensor measures the discs')  # a sensor that says nothing any more
    page.wait_for_pixels(*NOTHING)


def test_the_arm_is_looked_at_from_above_and_from_the_side(page):
    page.click('above')
    page.wait_for_pixels((dark, 0, 170, 'dark, as an arm that points at whoever looks'))
    page.picture(ARTEFACT.with_name('above.png'))
    page.click('side')
    page.wait_for_pixels((dark, 180, MANY, 'dark, as the whole arm'))


def test_tendons_are_jogged_by_steps_and_a_refusal_says_why(page, rig):
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


def test_a_button_begins_and_ends_a_recording_which_is_replayed(
        page, rig, open_page, processes, tmp_path):
    page.wait_for_text('ros2 run soft_continuum recorder')
    expect(page.button('Record')).to_be_disabled()
    node, = rig.start('recorder', ready=False, recorder__directory=str(tmp_path))
    page.click('Record')
    page.wait_for_text('messages, in')
    rig.wait_for_more(rig.joints, 5)  # 1 s
    page.click('End recording')
    page.wait_for_bar('messages in')
    file, = tmp_path.glob('*.mcap')
    assert len(read_recording(file).tendons)
    rig.end(node)

    process = start_view(processes, 'replay', str(file))
    replay = open_page(address_of(process), drawing=False)
    replay.wait_for_bar('No arm moves')
    replay.wait_for_text('by the model')
    time = replay.view.get_by_role('slider').first
    expect(time).to_have_attribute('aria-valuenow', '0')
    replay.click('Play')  # it may be at its end before the browser has drawn it once
    expect(time).not_to_have_attribute('aria-valuenow', '0', timeout=DEADLINE * 1e3)
    # Nothing that would move an arm, and no STOP that would stop none.
    for name in ('Reference', 'soften', '+5', 'Record'):
        expect(replay.button(name)).to_have_count(0)
    expect(replay.button('STOP')).to_be_hidden()
    replay.close()
    process.send(signal.SIGINT)
    assert process.wait() == 0, process.output
    assert 'Traceback' not in process.output, process.output


def test_any_browser_starts_and_stops_a_sequence_and_resume_is_needed_to_go_on(
        page, rig, shared, open_page):
    other = open_page(shared[2], drawing=False)
    other.click('c_form')
    page.wait_for_bar('Setting c_form')
    other.close()  # which changes nothing
    then = len(rig.tendons)
    rig.wait_for(lambda: rig.moving and len(rig.tendons) > then + 10, 'the motion to go on')
    page.wait_for_pixels((green, 25, MANY, 'green, as the shape it goes to is'))
    expect(page.button('soften', 2)).to_be_disabled()
    # STOP is sent when the button goes down and when it is released.
    state = rig.states['tendon_actuation']
    before = state.last.stops
    page.click('STOP')
    rig.wait_for(lambda: state.last.stops >= before + 2, 'both stops')
    rig.wait_for_status('tendon_actuation', 'stopped', 'stop was called')
    rig.wait_for(lambda: rig.at_rest, 'rest')
    rig.assert_rests(5)
    page.wait_for_bar('STOPPED')
    page.wait_for_bar('press Resume')
    page.wait_for_text('press Resume')
    page.wait_for_text('Sequence ended')
    page.wait_for_pixels((green, 0, 5, 'green, though it goes nowhere any more'))
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


def test_an_emergency_stop_greys_what_it_refuses_until_it_is_off(page, rig):
    button = rig.publisher(Bool, 'emergency_stop', LATCHED)
    refused = [page.button('soften', 2), page.button('Stiffen all'), page.button('Resume')]
    button.publish(Bool(data=True))
    page.wait_for_bar('where it was triggered and you press Resume')
    for control in (*refused, page.button('c_form')):
        expect(control).to_be_disabled(timeout=DEADLINE * 1e3)
    button.publish(Bool(data=False))
    for control in refused:
        expect(control).to_be_enabled(timeout=DEADLINE * 1e3)
    page.click('Resume')
    page.wait_for_bar('Ready')


def test_nothing_covers_stop_and_no_panel_covers_the_arm_at_any_size(page, rig):
    page.fill('Sequence', 'nonsense' * 100)
    page.click('Run sequence')
    page.wait_for_bar('Sequence: refused')
    usual = page.page.viewport_size
    for width, height in ((800, 600), (360, 640)):
        page.page.set_viewport_size({'width': width, 'height': height})
        page.wait_for(lambda: page.is_on_top('stop') and page.is_on_top('resume'), 'on top')

        def is_free(width=width):
            canvas = page.view.locator('canvas').first.bounding_box()
            controls = page.view.get_by_text('Shapes', exact=True).first.bounding_box()
            return (canvas['width'] > 0.4 * width and canvas['height'] > 200
                    and (controls['x'] >= canvas['x'] + canvas['width']
                         or controls['y'] >= canvas['y'] + canvas['height']))
        page.wait_for(is_free, f'nothing over the arm at {width} x {height}')
    page.view.locator('body').press('Control+k')  # viser's list of commands, over all of its page
    assert page.is_on_top('stop') and page.is_on_top('resume')
    page.view.locator('body').press('Escape')
    page.page.set_viewport_size(usual)


def test_a_sequence_is_run_as_it_is_written_and_its_end_is_reported(page, rig):
    page.fill('Sequence', 'nonsense')
    page.click('Run sequence')
    page.wait_for_bar("unknown shape 'nonsense'")
    rig.set_parameter('shape_sequencer', 'tendon_speed', 0.1)
    page.fill('Sequence', 'upright_c_form 0.5, c_form')
    page.click('Run sequence')
    page.wait_for_text('Sequence done')
    rig.wait_for(lambda: rig.status_value('shape_sequencer', 'last') == 'SUCCESSFUL', 'success')
    page.wait_for_text('+36.0°')
    page.wait_for_no_text('-36.0°')


def test_the_tip_goes_where_it_was_planned_to(page, rig):
    for name, value in (('tendon_speed', 0.1), ('reach.states', 1000)):
        rig.set_parameter('shape_sequencer', name, value)
    page.open_folder('Reach', 'Drag the tip')
    page.switch('Drag the tip', True)
    page.wait_for_text('the tip is there')
    page.fill('Tip x [mm]', '120')
    page.fill('Tip z [mm]', '260')
    page.wait_for_text('softenings: ')
    has_said = page.record_bar()
    page.click('Go')
    page.wait_for(lambda: has_said('Setting tip at (120, 260) mm'), 'what is being set')
    page.wait_for_bar('Ready')
    tip = rig.disc_poses.last.poses[-1].position
    assert (tip.x, tip.y, tip.z) == pytest.approx((0.12, 0.0, 0.26), abs=2e-3)
    page.switch('Drag the tip', False)


def test_when_the_nodes_end_it_says_how_to_start_them_and_continues_when_they_run(page, rig):
    rig.end(rig._groups[0].nodes[0])
    page.wait_for_bar('No node is running')
    page.wait_for_bar('./run up')
    expect(page.page.locator('body')).to_have_class('lost')  # with a veil over the arm
    page.click('STOP')
    page.wait_for_bar('Stop: failed')
    rig.start_arm(**SLOW)

    def is_ready():
        # The STOP of the released button may still have waited for nodes.
        if rig.states['tendon_actuation'].last.stopped:
            rig.trigger('tendon_actuation/resume')
        return 'Ready' in page.page.locator('#words').inner_text()
    page.wait_for(is_ready, 'Ready')
    page.click('soften', 0)
    rig.wait_for(lambda: rig.soft_segments() == [1], 'segment 1 soft')


def test_another_arm_is_followed_into_space_where_a_bending_has_a_direction(page, rig):
    rig.end(rig._groups[0].nodes[0])
    rig.start_arm(**given_in(description_file().with_name('spatial_jamming.yaml')), **SLOW)
    page.wait_for_text('tendon_3')
    expect(page.button('three-quarter')).to_be_visible()
    page.click('soften', 1)
    rig.wait_for(lambda: rig.soft_segments() == [2], 'segment 2 soft')
    for tendon, step in ((1, '-5'), (2, '-5'), (0, '+5')):  # at 120, 240 and 0 degrees
        page.click(step, tendon)
    page.wait_for_text('° @ 0°')

    page.wait_for_pixels((dark, 180, MANY, 'dark, as stiff skins are'),
                         (orange, 60, MANY, 'orange, as a soft skin is'))

    page.open_folder('Own shape', 'Angle 1')
    page.fill('Angle 1', '30')

    def is_drawn():
        for degrees in (0, -90):  # chosen again, as it is shown for 10 s only
            page.fill('Direction 1', str(degrees))
        return int(green(page.picture()).sum()) >= 25
    page.wait_for(is_drawn, 'green, as the shape that is chosen is')
    page.picture(ARTEFACT.with_name('space.png'))
    rig.set_parameter('shape_sequencer', 'tendon_speed', 0.1)
    page.click('Set own shape')
    page.wait_for_text('30.0° @ -90°')
    page.wait_for_text('+30.0@-90.0')  # as the end of the sequence is reported
