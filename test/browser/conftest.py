# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The view as a process, a real Chromium that shows it, and nodes as in test/nodes."""

import shutil
import subprocess

from playwright.sync_api import expect
import pytest
from std_srvs.srv import SetBool
from viser.infra._infra import WebsockServer

from soft_continuum.ui.browser import limits
from support.page import address_of, DEADLINE, Page, SLOW, start_view
from support.processes import Processes
from support.rig_fixtures import (
    _compiled,
    _patient,
    domain,
    domains,
    make_rig,
    module_domain,
    processes,
    take_domain,
)
from support.ros_rig import Rig

BROWSERS = ('chromium', 'chromium-browser', 'google-chrome')
FLAGS = ('--no-sandbox', '--disable-gpu', '--enable-unsafe-swiftshader', '--disable-quic',
         '--no-first-run', '--disable-background-networking', '--disable-component-update',
         '--disable-sync')
# Frames are rendered in software: a few a second are enough to see what is there, without smooth
# edges, and with a rougher reflection of the surroundings, which take 10 s to prepare otherwise.
# While nobody looks at a page, nothing of its scene is drawn: see Page.
DRAW_LITTLE = """
window.drawing = %s;
window.requestAnimationFrame = draw => setTimeout(() => draw(performance.now()), 250);
window.cancelAnimationFrame = clearTimeout;
const {getContext} = HTMLCanvasElement.prototype;
const webgl = WebGL2RenderingContext.prototype;
const {shaderSource} = webgl;
HTMLCanvasElement.prototype.getContext = function (kind, options) {
    return getContext.call(this, kind, {...options, antialias: false});
};
webgl.shaderSource = function (shader, source) {
    shaderSource.call(this, shader, source.replace(/(#define GGX_SAMPLES) [0-9]+/, '$1 16'));
};
for (const name of ['drawArrays', 'drawElements', 'drawArraysInstanced',
                    'drawElementsInstanced']) {
    const draw = webgl[name];
    webgl[name] = function (...all) {
        if (!window.drawing) return;
        window.drawn = true;
        draw.apply(this, all);
    };
}
"""


def _stop(server, stop=WebsockServer.stop):
    """Stop, and wait: a server prints that it ended, into whatever test runs by then."""
    stop(server)  # this waits for a second only
    server._server_thread.join(DEADLINE)


WebsockServer.stop = _stop


def runs(browser):
    """Tell whether it is there, and not only the script of Ubuntu that asks for a snap."""
    return subprocess.run([browser, '--version'], capture_output=True).returncode == 0


@pytest.fixture(autouse=True)
def _long_log(monkeypatch):
    """Let each test log what it has to, however much those before it did."""
    monkeypatch.setattr(limits, 'LINES', 1000)
    for each in (limits.LOG, limits.SERVER_LOG):
        monkeypatch.setattr(each, 'filters', [limits._RateLimit()])


@pytest.fixture(scope='module')
def open_page(tmp_path_factory):
    """Return an opener of pages, each in a profile of its own."""
    from playwright.sync_api import sync_playwright

    path = next(filter(runs, filter(None, map(shutil.which, BROWSERS))), None)
    if not path:
        pytest.skip('no Chromium that runs; on Debian: apt-get install chromium')
    # It renders in software, all the time: the nodes come first.
    nice = tmp_path_factory.mktemp('chromium') / 'chromium'
    nice.write_text(f'#!/bin/sh\nexec nice -n 5 {path} "$@"\n')
    nice.chmod(0o755)
    with sync_playwright() as driver:
        # Playwright gives it a user data directory of its own.
        chromium = driver.chromium.launch(executable_path=nice, headless=True, args=list(FLAGS))

        def open_at(address, drawing=True):
            # A quarter of the pixels: they are rendered in software.
            context = chromium.new_context(viewport={'width': 900, 'height': 600},
                                           device_scale_factor=0.5)
            context.add_init_script(DRAW_LITTLE % str(drawing).lower())
            page = context.new_page()
            page.goto(address, timeout=DEADLINE * 1e3)
            return Page(page)

        yield open_at
        chromium.close()


@pytest.fixture(scope='module')
def shared(open_page, tmp_path_factory):
    """Return an arm, a page that shows it, and the address of that page, for a module."""
    with domains() as take:
        domain = take()
        rig, processes = Rig(domain), Processes(domain, tmp_path_factory.mktemp('view'))
        view = start_view(processes, 'browser', '--ros-args', '-r', f'__ns:={rig.namespace}')
        rig.start_arm(**SLOW)
        address = address_of(view)
        page = open_page(address)
        expect(page.button('c_form')).to_be_visible(timeout=DEADLINE * 1e3)
        yield rig, page, address
        page.close()
        processes.close()
        rig.close()


@pytest.fixture
def rig(shared):
    """Return the arm of the module; after the test it is idle, stiff and may move."""
    rig = shared[0]
    yield rig
    actuation = rig.states['tendon_actuation']
    if actuation.last.stopped:
        assert rig.trigger('tendon_actuation/resume').success
        rig.wait_for(lambda: not actuation.last.stopped, 'no stop')
    rig.wait_for(lambda: rig.statuses['shape_sequencer'].last.message == 'idle', 'no sequence')
    assert rig.call(SetBool, 'jamming_valves/set_all_stiff', data=True).success
    rig.wait_for(lambda: rig.all_stiff, 'all stiff')


@pytest.fixture
def page(shared):
    """Return the page of the module."""
    return shared[1]
