# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What measurements say of the arm is seen in a real browser, beside what the model predicts."""

from math import radians, sin
from pathlib import Path

from geometry_msgs.msg import Point, Pose
from playwright.sync_api import expect
import pytest

from soft_continuum.client.own_file import read_saved
from soft_continuum_interfaces.action import RunShapeSequence
from soft_continuum_interfaces.msg import Anomaly, KinematicsState, PlanStep, TipGoal
from soft_continuum_interfaces.srv import PlanShapes
from support.estimated_arm import CHAIN, EstimatedArm, joint_angles, learned, tip, tip_covariance
from support.page import address_of, DEADLINE, green, start_view
from support.processes import Processes

pytestmark = pytest.mark.timeout(600)
ARTEFACT = Path(__file__).resolve().parents[2] / 'log' / 'browser' / 'estimate.png'
ESTIMATED = {
    'source': KinematicsState.ESTIMATED, 'angle_stddevs': [0.002] * 3,
    'tip_covariance': tip_covariance(3e-4, 4e-4, 0.01), 'parameters': [
        learned('stiffness_factor_1', 1.25, 0.05),
        learned('stiff_ratio_2', 4.1, 0.4, problem='less than 5: is the vacuum full?'),
        learned('offset_left_tendon', -0.0012, 1e-4),
        learned('payload', 0.02, 0.03, determined=False)]}


def brown(colours):
    """Whether pixels are as brown as the outline of the prediction."""
    return ((colours[..., 0] > colours[..., 1] + 25) & (colours[..., 1] > colours[..., 2] + 20)
            & (colours[..., 0] < 190))


def pink(colours):
    """Whether pixels are as pink as the axis x of the handle."""
    red, greens, blue = (colours[..., c] for c in range(3))
    return (red > 200) & (greens < 100) & (blue > 60) & (blue < 150)


def planned_to(angles):
    """Return a plan of two steps, of which one ends in a shape, rad."""
    return PlanShapes.Response(success=True, tip_errors=[4e-4], steps=[PlanStep(
        segment=number, bending_angles=angles, duration=4.4, largest_tension=10.0 + 1.25 * number,
        smallest_clearance=0.027 - 0.002 * number, nearest_obstacle='<post>',
        tip_path=[Pose(position=Point(x=0.05 * part, z=0.3)) for part in range(3)])
        for number in (1, 2)])


def place(request):
    """Return where the tip shall be, m."""
    position = request.shapes[0].tips[0].pose.position
    return position.x, position.y, position.z


def choose_own_shape(page):
    """Choose 30 and -45 degrees."""
    page.open_folder('Own shape', 'Angle 1')
    expect(page.button('Set own shape')).to_be_enabled(timeout=DEADLINE * 1e3)
    for name, degrees in (('Angle 1', 30), ('Angle 2', -45)):
        page.fill(name, str(degrees))


@pytest.fixture(scope='module')
def shown(open_page, tmp_path_factory, module_domain):
    """Return an arm of stand-ins and a page that shows it, for the module."""
    arm, processes = EstimatedArm(module_domain), Processes(
        module_domain, tmp_path_factory.mktemp('view'))
    page = open_page(address_of(start_view(
        processes, 'browser', '--ros-args', '-r', '__ns:=/arm_under_test')))
    expect(page.button('c_form')).to_be_visible(timeout=DEADLINE * 1e3)
    yield arm, page
    page.close()
    processes.close()
    arm.close()


@pytest.fixture
def arm(shown):
    return shown[0]


@pytest.fixture
def page(shown):
    return shown[1]


def test_without_measurements_the_page_says_that_it_shows_a_prediction(page, arm):
    page.wait_for_text('PREDICTED')
    page.wait_for_text('never measured')
    page.wait_for_text('nothing is estimated without a sensor')
    page.wait_for_pixels((brown, 0, 0, 'brown, though nothing is estimated'))
    expect(page.page.locator('#alarm')).to_be_hidden()


def test_the_prediction_is_drawn_beside_the_estimate_and_its_distance_is_said(page, arm):
    arm.age, arm.predicted = 0.05, (0.0, 0.2, -0.3)
    arm.state = KinematicsState(**ESTIMATED)
    page.wait_for_text('ESTIMATED')
    page.wait_for_text('tip ±0.5 mm')
    page.wait_for_text('from the estimate')
    page.wait_for_pixels((brown, 40, 10**6, 'brown, as the prediction is'))
    page.wait_for_text('+17.2° ±0.1°')  # the angle of segment 1


def test_learned_parameters_have_a_deviation_or_are_not_determined(page, arm):
    for text in ('stiffness factor, segment 1', '1.25', '0.05', '-1.20', 'less than 5',
                 'not plausible'):
        page.wait_for_text(text)
    row = page.view.get_by_role('row').filter(has_text='payload')
    expect(row).to_contain_text('not determined')


def test_the_measured_error_of_a_run_is_said_in_the_unit_of_its_aim(page, arm):
    page.choose('Aim', 'tip')
    page.click('c_form')
    page.wait_for_bar('Setting c_form')
    assert arm.goals[-1].aim == RunShapeSequence.Goal.TIP
    arm.feed_back(correction=2, error=0.0031)
    page.wait_for_bar('correction 2, 3.1 mm off')
    page.wait_for_text('correction 2')
    page.wait_for_text('3.1 mm')
    page.wait_for_text('measured error of the tip: last minute, 0 to 5 mm')
    arm.end_goal(shapes_completed=1, source=1, bending_angles=[0.1] * 3,
                 tip=tip(0.0, 0.0, 0.0), tip_error=6e-4, corrections=4)
    page.wait_for_bar('reached: tip 0.6 mm from its aim (measured, ±0.5 mm)')


def test_a_shape_of_its_own_is_sent_with_the_angles_of_the_page(page, arm):
    choose_own_shape(page)
    before = len(arm.goals)
    page.click('Set own shape')
    page.wait_for(lambda: len(arm.goals) > before, 'a goal')
    shape, = arm.goals[-1].shapes
    assert list(shape.bending_angles) == pytest.approx([radians(30), radians(-45), 0.0])
    assert not shape.bending_directions
    arm.end_goal(shapes_completed=1)
    page.wait_for_bar('shapes reached: 1')


def test_shapes_and_sequences_are_saved_run_in_rounds_renamed_and_deleted(page, arm):
    choose_own_shape(page)
    page.open_folder('Saved', 'Name')
    page.fill('Name', 'c_form')
    page.click('Save own shape')
    page.wait_for_bar('c_form is the name of another')
    page.fill('Name', 'lean')
    page.click('Save own shape')
    page.wait_for_text('+30.0  -45.0   +0.0 deg')
    page.picture(ARTEFACT.with_name('saved.png'))

    page.fill('Sequence', 'lean 2.5, s_form')
    page.fill('Rounds', '2')
    page.fill('Name', 'wave')
    page.click('Save sequence')
    page.wait_for_text('lean 2.5, s_form 1; 2 times')
    before = len(arm.goals)
    page.click('run')
    for done in (1, 2):
        page.wait_for(lambda done=done: len(arm.goals) == before + done, f'round {done}')
        first, second = arm.goals[-1].shapes
        assert (first.name, first.hold_time.nanosec, second.name) == ('lean', 5 * 10**8, 's_form')
        assert list(first.bending_angles) == pytest.approx([radians(30), radians(-45), 0.0])
        arm.end_goal(shapes_completed=2)
    page.wait_for_bar('Sequence done')

    page.click('delete')  # the shape, which was there first
    page.wait_for_bar('is in the sequence wave')
    page.fill('Name', 'bow')
    page.click('rename')
    page.wait_for_text('bow 2.5, s_form 1; 2 times')
    page.choose('Which', 'wave')
    page.click('delete')
    page.wait_for_bar('wave deleted')
    page.wait_for_no_text('bow 2.5, s_form 1; 2 times')
    page.click('delete')
    page.wait_for_no_text('+30.0  -45.0')
    assert len(arm.goals) == before + 2


def test_the_tip_is_dragged_and_what_it_would_take_is_seen_before_it_goes(page, arm):
    arm.plan = planned_to((-0.3, -0.4, -0.2))
    page.open_folder('Reach', 'Drag the tip')
    page.switch('Drag the tip', True)
    for text in ('REACHABLE', 'softenings: 2', 'tension up to 12.5 N', '9 s of motion',
                 '23 mm from <post>', '0.4 mm from its goal'):
        page.wait_for_text(text)
    page.wait_for_pixels((green, 25, 10**6, 'green, as the shape that would be taken is'))
    tip = CHAIN.plane_points(joint_angles(arm.angles))[-1]
    assert place(arm.planned[-1]) == pytest.approx((tip[0], 0.0, tip[1]), abs=1e-6)
    before = len(arm.planned)
    page.wait_for_pixels((pink, 1, 10**6, 'pink, as the handle is'))
    page.drag(page.place_of(pink), (60.0, 0.0))
    page.wait_for(lambda: len(arm.planned) > before and arm.planned[-1].states == 0,
                  'a plan for where the handle was left')
    assert all(0 < request.states < 5000 for request in arm.planned[before:-1])
    x, y, z = place(arm.planned[-1])
    assert x > tip[0] + 0.02 and y == 0.0  # along the axis of the handle, in the plane of the arm
    page.picture(ARTEFACT.with_name('reach.png'))

    page.fill('Tip z [mm]', '250')
    page.switch('Point it too', True)
    page.fill('Angle [°]', '-30')
    page.wait_for(lambda: arm.planned[-1].shapes[0].tips[0].kind == TipGoal.DIRECTION and
                  place(arm.planned[-1]) == pytest.approx((x, 0.0, 0.25), abs=1e-4) and
                  arm.planned[-1].shapes[0].tips[0].pose.orientation.y == pytest.approx(
                      sin(radians(-15))), 'the goal that was typed')
    before = len(arm.goals)
    expect(page.button('Go')).to_be_enabled(timeout=DEADLINE * 1e3)
    page.click('Go')
    page.wait_for(lambda: len(arm.goals) > before, 'a goal')
    assert arm.goals[-1].shapes[0].tips == arm.planned[-1].shapes[0].tips
    expect(page.button('Go')).to_be_disabled(timeout=DEADLINE * 1e3)
    asked = len(arm.planned)
    arm.end_goal(shapes_completed=1)
    page.wait_for(lambda: len(arm.planned) > asked, 'a plan from where the arm is then')

    page.fill('Shape name', 'there')
    page.click('Save planned shape')
    page.wait_for_bar('there saved')
    assert read_saved().shapes['there'].angles == pytest.approx((-0.3, -0.4, -0.2))
    arm.plan.success, arm.plan.message = False, 'out of reach by 12 mm'
    page.fill('Tip z [mm]', '300')
    for text in ('NO PLAN', 'out of reach by 12 mm', 'nearest reachable'):
        page.wait_for_text(text)
    expect(page.button('Go')).to_be_disabled(timeout=DEADLINE * 1e3)
    page.switch('Drag the tip', False)
    page.wait_for_pixels((green, 0, 5, 'green, though no tip is dragged'))


def test_the_loop_is_switched_and_another_client_is_followed(page, arm):
    switch = page.view.get_by_label('Closed loop').first
    expect(switch).to_be_checked(timeout=DEADLINE * 1e3)
    switch.click()
    page.wait_for_bar('sequences run open loop')
    assert not arm.closed_loop
    expect(switch).not_to_be_checked()
    arm.set_closed_loop(True)
    expect(switch).to_be_checked(timeout=DEADLINE * 1e3)


def test_alarms_are_prominent_and_never_cover_stop(page, arm):
    usual = page.page.viewport_size
    arm.state = KinematicsState(**ESTIMATED, anomalies=[
        Anomaly(cause=Anomaly.TENDON_SLIPPED, tendon='left_tendon', message='look at it ' * 50)
        ] * 5)
    alarm = page.page.locator('#alarm')
    expect(alarm).to_contain_text('Tendon slipped (left_tendon)', timeout=DEADLINE * 1e3)
    expect(alarm).to_contain_text('2 more under Measured shape')
    for width, height in ((1280, 800), (390, 844)):
        page.page.set_viewport_size({'width': width, 'height': height})
        page.wait_for(lambda: page.is_on_top('stop') and page.is_on_top('resume'), 'on top')

        def is_below():
            box, stop = alarm.bounding_box(), page.button('STOP').bounding_box()
            return bool(box) and (  # it is away while the page waits for the view
                box['y'] >= stop['y'] + stop['height'] and box['height'] <= 120)
        page.wait_for(is_below, f'an alarm below STOP at {width} x {height}')
        page.wait_for(lambda: page.view.locator(
            'canvas').first.bounding_box()['height'] > 200, 'a scene')
    page.page.set_viewport_size(usual)
    arm.state = KinematicsState(**ESTIMATED)
    expect(alarm).to_be_hidden(timeout=DEADLINE * 1e3)
    page.wait_for_text('Alarm')  # kept under Messages
