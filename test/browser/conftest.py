# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""The view as a process, a real Chromium that looks at it, and nodes as in test/nodes."""

from collections.abc import Callable, Iterator
import importlib.util
from pathlib import Path
import re
import shutil
import sys
import time
from typing import Any

import pytest

NODES = Path(__file__).resolve().parent.parent / 'nodes'
sys.path.insert(0, str(NODES))
_spec = importlib.util.spec_from_file_location('node_fixtures', NODES / 'conftest.py')
assert _spec is not None and _spec.loader is not None
_fixtures = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(_fixtures)
_compiled, take_domain, domain = _fixtures._compiled, _fixtures.take_domain, _fixtures.domain
make_rig, rig, processes = _fixtures.make_rig, _fixtures.rig, _fixtures.processes

from page import DEADLINE, Page  # noqa: E402
from processes import NodeProcess, Processes  # noqa: E402

BROWSERS = ('chromium', 'chromium-browser', 'google-chrome')
FLAGS = ('--no-sandbox', '--disable-gpu', '--enable-unsafe-swiftshader', '--disable-quic',
         '--no-first-run', '--disable-background-networking', '--disable-component-update',
         '--disable-sync')
VIEW = 'import sys; from soft_continuum.browser.main import {0}; sys.exit({0}())'


@pytest.fixture(scope='session')
def chromium() -> Iterator[Any]:
    """Return a launched browser, or skip."""
    playwright = pytest.importorskip('playwright.sync_api')
    path = next(filter(None, map(shutil.which, BROWSERS)), None)
    if path is None:
        pytest.skip('no Chromium; on Debian and Ubuntu: apt-get install chromium')
    # Playwright gives it a user data directory of its own.
    with playwright.sync_playwright() as driver:
        launched = driver.chromium.launch(executable_path=path, headless=True, args=list(FLAGS))
        yield launched
        launched.close()


@pytest.fixture
def open_page(chromium: Any) -> Iterator[Callable[[str], Page]]:
    """Return an opener of pages, each in a profile of its own."""
    contexts = []

    def open_at(address: str) -> Page:
        contexts.append(chromium.new_context(viewport={'width': 1200, 'height': 700}))
        page = contexts[-1].new_page()
        page.goto(address, timeout=DEADLINE * 1e3)
        return Page(page)

    yield open_at
    for context in contexts:
        context.close()


@pytest.fixture
def start_view(processes: Processes) -> Callable[..., tuple[NodeProcess, str]]:
    """Return a starter of the view; it gives the process and the address that it printed."""
    def start(program: str = 'browser', *arguments: str) -> tuple[NodeProcess, str]:
        rest = arguments or ('--ros-args', '-r', '__ns:=/arm_under_test')
        process = processes.start(
            [sys.executable, '-c', VIEW.format(program), '--port', '0', *rest])
        deadline = time.monotonic() + DEADLINE
        while True:
            found = re.search(r'The arm is at (\S+)', process.output)
            if found:
                return process, found[1]
            assert process.running, process.output
            assert time.monotonic() < deadline, f'no address:\n{process.output}'
            time.sleep(0.05)

    return start
