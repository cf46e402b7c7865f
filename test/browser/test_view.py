# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""What a person sees and does in a real browser, and what the arm does then."""

from collections.abc import Callable
from pathlib import Path
import signal

from page import dark, DEADLINE, green, orange, Page
from playwright.sync_api import expect
import pytest
from ros_rig import ALL, Rig

pytestmark = pytest.mark.timeout(600)
ARTEFACT = Path(__file__).resolve().parents[2] / 'log' / 'browser' / 'view.png'
OpenPage = Callable[[str], Page]
StartView = Callable[..., tuple]
# Slow enough to be seen and stopped on its way.
SLOW = {'tendon_speed': 0.004, 'silence_timeout': 10.0}


@pytest.fixture
def page(rig: Rig, start_view: StartView, open_page: OpenPage) -> Page:
    """Return the view of a running arm that is straight and stiff."""
    rig.start_arm(**SLOW)
    opened = open_page(start_view()[1])
    opened.wait_for_text('shape_sequencer')
    expect(opened.button('c_form')).to_be_visible(timeout=DEADLINE * 1e3)
    return opened


def test_the_arm_is_drawn_and_a_soft_segment_is_seen_to_be_soft(page: Page, rig: Rig) -> None:
    page.wait_for_pixels(dark, 1500, 10**6, 'dark, as stiff skins are')
    page.wait_for_pixels(orange, 0, 0, 'orange, though no segment is soft')
    page.click('soften', 1)
    rig.wait_for(lambda: rig.soft_segments() == [2], 'segment 2 soft')
    page.wait_for_pixels(orange, 500, 10**6, 'orange, as a soft skin is')
    page.picture(ARTEFACT)
    page.click('stiffen', 1)
    rig.wait_for(lambda: rig.all_stiff, 'all stiff')
    page.wait_for_pixels(orange, 0, 0, 'orange, though no segment is soft')


def test_a_jog_moves_one_tendon_by_its_step(page: Page, rig: Rig) -> None:
    expect(page.button('-5')).to_have_count(0)  # nothing to jog with while all is stiff
    page.click('soften', 2)
    page.click('-5', 1)
    rig.wait_for(lambda: rig.pulls[1] == pytest.approx(-0.005, abs=2e-5), 'the left tendon out')
    page.click('+1', 0)
    rig.wait_for(lambda: rig.pulls[0] == pytest.approx(0.001, abs=2e-5), 'the right tendon pulled')
    assert rig.pulls[1] == pytest.approx(-0.005, abs=2e-5)


def test_a_refused_jog_says_why(page: Page, rig: Rig) -> None:
    page.click('soften', 2)
    page.click('+5', 0)
    page.click('+5', 1)
    expect(page.notification('Jog: refused')).to_contain_text('co_contraction_limit')
    assert rig.pulls[1] == pytest.approx(0.0, abs=1e-3)


def test_stop_stops_a_sequence_and_resume_is_needed_to_go_on(page: Page, rig: Rig) -> None:
    page.click('c_form')
    rig.wait_for(lambda: rig.moving and abs(rig.pulls[0]) > 1e-4, 'a motion')
    page.wait_for_text('segment 1, moving')
    page.wait_for_pixels(green, 200, 10**6, 'green, as the shape it goes to is')
    page.click('soften', 2)
    expect(page.notification('Soften segment 3: refused')).to_contain_text('sequence is running')
    assert rig.soft_segments() == [1]
    page.click('STOP')
    rig.wait_for_status('tendon_actuation', 'stopped', 'stop was called')
    rig.assert_rests()
    page.wait_for_text('STOPPED')
    page.wait_for_pixels(green, 0, 20, 'green, though it goes nowhere any more')

    page.click('s_form')
    expect(page.notification('Sequence: refused')).to_contain_text('resume')
    page.wait_for_text('Sequence: refused')
    rig.assert_rests()
    page.click('Resume')
    rig.wait_for(lambda: not rig.status_value('tendon_actuation', 'stopped'), 'no stop any more')
    rig.assert_rests()


def test_a_sequence_is_run_as_it_is_written_and_its_end_is_told(page: Page, rig: Rig) -> None:
    names = page.page.get_by_role('textbox').first
    names.fill('nonsense')
    page.click('Run sequence')
    expect(page.notification('Sequence: refused')).to_contain_text("unknown shape 'nonsense'")
    rig.set_parameter('shape_sequencer', 'tendon_speed', 0.1)
    names.fill('upright_c_form, c_form')
    page.click('Run sequence')
    page.wait_for_text('Sequence done')
    assert rig.status_value('shape_sequencer', 'last') == 'SUCCESSFUL'
    page.wait_for_text('+36.0°')
    page.wait_for_no_text('-36.0°')


def test_without_nodes_it_says_how_to_start_them_and_goes_on_when_they_come(
        rig: Rig, start_view: StartView, open_page: OpenPage) -> None:
    page = open_page(start_view()[1])
    page.wait_for_text('No node is running')
    page.wait_for_text('./run up')
    page.click('STOP')
    expect(page.notification('Stop')).to_contain_text('tendon_actuation does not run')
    nodes = rig.start_arm()
    page.wait_for_no_text('No node is running')
    page.wait_for_pixels(dark, 1500, 10**6, 'dark, as stiff skins are')
    rig.end(nodes[0])
    page.wait_for_text('No node is running')
    page.wait_for_pixels(dark, 0, 300, 'dark, though nothing is known of the arm')
    rig.start_arm()
    page.wait_for_pixels(dark, 1500, 10**6, 'dark, as stiff skins are')
    page.click('soften', 0)
    rig.wait_for(lambda: rig.soft_segments() == [1], 'segment 1 soft')


def test_two_browsers_see_the_same_and_a_lost_one_changes_nothing(
        rig: Rig, start_view: StartView, open_page: OpenPage) -> None:
    rig.start_arm(**{**SLOW, 'tendon_speed': 0.0005})
    address = start_view()[1]
    first, second = open_page(address), open_page(address)
    first.click('c_form')
    second.wait_for_text('segment 1, moving')
    first.page.close()
    then = abs(rig.pulls[0])
    rig.wait_for(lambda: not rig.stiff[0].last.data and abs(rig.pulls[0]) > then + 1e-3,
                 'the motion to go on')
    second.click('STOP')
    expect(second.notification('Sequence ended')).to_be_visible(timeout=DEADLINE * 1e3)
    rig.wait_for_status('tendon_actuation', 'stopped', 'stop was called')


def test_nodes_and_view_start_and_end_together(
        make_rig: Callable[..., Rig], start_view: StartView, open_page: OpenPage) -> None:
    rig = make_rig(namespace='/left')
    process, address = start_view('ui', '--namespace', 'left')
    rig.wait_until_ready(*ALL)
    page = open_page(address)
    page.click('soften', 0)
    rig.wait_for(lambda: rig.soft_segments() == [1], 'segment 1 soft')
    process.send(signal.SIGINT)
    assert process.wait() == 0, process.output
    assert 'Traceback' not in process.output, process.output
