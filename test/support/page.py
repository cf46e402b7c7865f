# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A page in a real browser, and what can be seen on it."""

from collections.abc import Callable
import io
from pathlib import Path
import re
import sys
import time
from typing import Any

import numpy as np
from PIL import Image
from playwright.sync_api import expect

from support.processes import NodeProcess, Processes

DEADLINE = 90.0  # s: everything is rendered in software
expect.set_options(timeout=DEADLINE * 1e3)
# Slow enough to be seen and stopped on its way; at a rate that a busy machine keeps.
SLOW = {'tendon_speed': 0.001, 'tendon_rate': 5.0, 'jamming_rate': 10.0,
        'stale_timeout': 10.0}


class Page:
    """A page of the view."""

    def __init__(self, page: Any) -> None:
        page.set_default_timeout(DEADLINE * 1e3)
        self.page = page

    def close(self) -> None:
        """Close the page and its profile."""
        self.page.context.close()

    @property
    def view(self) -> Any:
        """What viser shows below the bar."""
        return self.page.frame_locator('#view')

    def button(self, name: str, number: int = 0) -> Any:
        """Return a button by its exact label: one of the bar, or below it."""
        where = self.page if name in ('STOP', 'Resume') else self.view
        return where.get_by_role('button', name=name, exact=True).nth(number)

    def click(self, name: str, number: int = 0) -> None:
        """Click a button as a person does."""
        self.button(name, number).click(timeout=DEADLINE * 1e3, no_wait_after=True)
        self._let_send()

    def _let_send(self) -> None:
        """
        Wait until what was done has been sent: viser sends one value in 50 ms, the newest.

        By a timer of the page, after that of viser, however late the page comes to them.
        """
        self.view.locator('body').evaluate('() => new Promise(done => setTimeout(done, 100))')

    def open_folder(self, name: str, label: str) -> None:
        """Open a folder, if none did, and wait until a control in it can be used."""
        control = self.view.get_by_label(label, exact=True).first
        if not control.is_visible():
            self.view.get_by_text(name, exact=True).first.click()
        control.scroll_into_view_if_needed()

    def fill(self, name: str, text: str) -> None:
        """Write into the field, or beside the slider, of a name, as a person does."""
        field = self.view.get_by_label(name, exact=True).and_(
            self.view.get_by_role('textbox')).first
        field.fill(text)
        field.press('Tab')
        self._let_send()

    def switch(self, name: str, on: bool) -> None:
        """Switch a checkbox, wherever it is by then: neither mouse nor focus can miss it."""
        box = self.view.get_by_label(name, exact=True).first
        box.dispatch_event('click')
        expect(box).to_be_checked(checked=on)
        self._let_send()

    def choose(self, name: str, option: str) -> None:
        """Choose from a list of a name."""
        self.view.get_by_label(name).first.click()
        self.view.get_by_role('option', name=option).click()
        self._let_send()

    def wait_for_text(self, text: str) -> None:
        """Wait until a text can be read below the bar."""
        shown = self.view.get_by_text(re.compile(re.escape(text))).first
        try:
            expect(shown).to_be_visible(timeout=DEADLINE * 1e3)
        except AssertionError:
            there = self.view.locator('body').inner_text()
            raise AssertionError(f'{text!r} cannot be read; there is:\n{there}') from None

    def wait_for_no_text(self, text: str) -> None:
        """Wait until a text is nowhere below the bar."""
        shown = self.view.get_by_text(re.compile(re.escape(text)))
        expect(shown).to_have_count(0, timeout=DEADLINE * 1e3)

    def wait_for_bar(self, text: str) -> None:
        """Wait until the bar says something: the state of the arm, or the newest message."""
        expect(self.page.locator('#words')).to_contain_text(text, timeout=DEADLINE * 1e3)

    def record_bar(self) -> Callable[[str], bool]:
        """Record what the bar says from now on; return whether it has said a text since then."""
        self.page.evaluate("""() => {
            const words = document.getElementById('words'), said = window.said = [];
            new MutationObserver(() => said.push(words.innerText)).observe(
                words, {subtree: true, childList: true, characterData: true});
        }""")
        return lambda text: bool(self.page.evaluate(
            'text => window.said.some(words => words.includes(text))', text))

    def is_on_top(self, name: str) -> bool:
        """Return whether nothing covers any point of a button of the bar."""
        return bool(self.page.evaluate("""name => {
            const button = document.getElementById(name), box = button.getBoundingClientRect();
            for (let x = 1; x < 20; ++x) for (let y = 1; y < 20; ++y) {
                const found = document.elementFromPoint(
                    box.left + box.width * x / 20, box.top + box.height * y / 20);
                if (found !== button) return false;
            }
            return true;
        }""", name))

    def picture(self, path: Path | None = None) -> Any:
        """Return the middle of the scene as colours (rows, columns, 3), 0 to 255."""
        colours = self._screenshot(path)
        rows, columns, _ = colours.shape
        return colours[rows // 5:, columns * 20 // 100:columns * 42 // 100]

    def _screenshot(self, path: Path | None = None) -> Any:
        """Return what is seen once the scene was drawn; nothing is drawn from then on."""
        body = self.view.locator('body')
        body.evaluate("""() => new Promise(done => {
            [window.drawing, window.drawn] = [true, false];
            const look = () => window.drawn ? done() : setTimeout(look, 50);
            look();
        })""")
        data = self.page.screenshot(timeout=DEADLINE * 1e3)
        body.evaluate('() => { window.drawing = false; }')
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
        return np.asarray(Image.open(io.BytesIO(data)).convert('RGB')).astype(int)

    def place_of(self, has_colour: Callable[[Any], Any]) -> tuple[float, float]:
        """Return where the middle of all pixels of a colour in the scene is, for the mouse."""
        colours = self._screenshot()
        rows, columns, _ = colours.shape
        found = has_colour(colours)
        found[:rows // 6] = found[:, columns * 6 // 10:] = False  # the bar, the panel
        y, x = (places.mean() for places in found.nonzero())
        scale = self.page.viewport_size['width'] / columns
        return float(x * scale), float(y * scale)

    def drag(self, start: tuple[float, float], by: tuple[float, float]) -> None:
        """Drag with the mouse by some pixels, in a few steps."""
        mouse = self.page.mouse
        mouse.move(*start)
        self.page.wait_for_timeout(300.0)  # until it is drawn what is below the mouse
        mouse.down()
        for part in (0.25, 0.5, 0.75, 1.0):
            mouse.move(start[0] + part * by[0], start[1] + part * by[1])
        mouse.up()

    def wait_for(self, condition: Callable[[], Any], what: str) -> None:
        """Wait until something is so, as after another layout."""
        deadline = time.monotonic() + DEADLINE
        while not condition():
            assert time.monotonic() < deadline, f'never: {what}'
            self.page.wait_for_timeout(100.0)

    def wait_for_pixels(self, *wanted: tuple[Callable[[Any], Any], int, int, str]) -> None:
        """Wait until the middle of the scene has from so many to so many pixels of each colour."""
        deadline = time.monotonic() + DEADLINE
        while True:
            picture = self.picture()
            wrong = [f'{count} pixels are {what}; expected: {low} to {high}'
                     for has_colour, low, high, what in wanted
                     if not low <= (count := int(has_colour(picture).sum())) <= high]
            if not wrong:
                return
            assert time.monotonic() < deadline, wrong


def dark(colours: Any) -> Any:
    """Whether pixels are as dark as a stiff skin."""
    return (colours.max(axis=2) < 110) & (colours[..., 2] > colours[..., 0] + 10)


def orange(colours: Any) -> Any:
    """Whether pixels are as orange as a soft skin."""
    return (colours[..., 0] > 120) & (colours[..., 2] < colours[..., 0] // 2)


def green(colours: Any) -> Any:
    """Whether pixels are as green as the ghost of a target, which is seen through."""
    return (colours[..., 1] > colours[..., 0] + 15) & (colours[..., 1] > colours[..., 2] + 10)


def teal(colours: Any) -> Any:
    """Whether pixels are as teal as the outline of a measured disc."""
    red, greens, blue = (colours[..., c].astype(int) for c in range(3))
    return (greens > red + 60) & (blue > red + 60) & (abs(greens - blue) < 40)


def olive(colours: Any) -> Any:
    """Whether pixels are as olive as obstacles."""
    return (abs(colours[..., 0] - colours[..., 1]) < 12) & (
        colours[..., 2] < colours[..., 1] - 15)


def start_view(processes: Processes, verb: str, *options: str) -> NodeProcess:
    """Start ``browser``, ``ui`` or ``replay``."""
    return processes.start([sys.executable, '-m', 'soft_continuum', verb, '--port', '0', *options])


def address_of(view: NodeProcess) -> str:
    """Wait for the address that a view prints."""
    deadline = time.monotonic() + DEADLINE
    while not (found := re.search(r' is at (http\S+)', view.output)):
        assert view.running, view.output
        assert time.monotonic() < deadline, f'no address:\n{view.output}'
        time.sleep(0.05)
    return found[1]
