# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

"""A page in a real browser, and what can be seen on it."""

from collections.abc import Callable
import io
from pathlib import Path
import re
import time
from typing import Any

import numpy as np
from PIL import Image
from playwright.sync_api import expect

DEADLINE = 90.0  # s: everything is rendered in software


class Page:
    """A page of the view."""

    def __init__(self, page: Any) -> None:
        self.page = page

    def close(self) -> None:
        """Close the page and its profile."""
        self.page.context.close()

    def button(self, name: str, number: int = 0) -> Any:
        """Return a button by its exact label."""
        return self.page.get_by_role('button', name=name, exact=True).nth(number)

    def click(self, name: str, number: int = 0) -> None:
        """Click a button as a person does."""
        self.button(name, number).click(timeout=DEADLINE * 1e3)

    def wait_for_text(self, text: str) -> None:
        """Wait until a text can be read somewhere on the page."""
        shown = self.page.get_by_text(re.compile(re.escape(text))).first
        expect(shown).to_be_visible(timeout=DEADLINE * 1e3)

    def wait_for_no_text(self, text: str) -> None:
        """Wait until a text is nowhere on the page."""
        shown = self.page.get_by_text(re.compile(re.escape(text)))
        expect(shown).to_have_count(0, timeout=DEADLINE * 1e3)

    def notification(self, title: str) -> Any:
        """Return the latest notification with this title, when it is there."""
        shown = self.page.get_by_role('alert').filter(has_text=title).last
        expect(shown).to_be_visible(timeout=DEADLINE * 1e3)
        return shown

    def picture(self, path: Path | None = None) -> Any:
        """Return the middle of the scene as colours (rows, columns, 3), 0 to 255."""
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            self.page.screenshot(path=path, timeout=DEADLINE * 1e3)
        data = self.page.screenshot(timeout=DEADLINE * 1e3)
        colours = np.asarray(Image.open(io.BytesIO(data)).convert('RGB')).astype(int)
        rows, columns, _ = colours.shape
        return colours[rows // 6:, columns * 9 // 20:columns * 13 // 20]

    def wait_for_pixels(self, has_colour: Callable[[Any], Any], low: int, high: int,
                        what: str) -> None:
        """Wait until so many pixels of the middle of the scene have a colour."""
        deadline = time.monotonic() + DEADLINE
        while True:
            count = int(has_colour(self.picture()).sum())
            if low <= count <= high:
                return
            assert time.monotonic() < deadline, (
                f'{count} pixels are {what}; expected: {low} to {high}')


def dark(colours: Any) -> Any:
    """Whether pixels are as dark as a stiff skin."""
    return (colours.max(axis=2) < 110) & (colours[..., 2] > colours[..., 0] + 10)


def orange(colours: Any) -> Any:
    """Whether pixels are as orange as a soft skin."""
    return (colours[..., 0] > 120) & (colours[..., 2] < colours[..., 0] // 2)


def green(colours: Any) -> Any:
    """Whether pixels are as green as the ghost of a target, which is seen through."""
    return (colours[..., 1] > colours[..., 0] + 15) & (colours[..., 1] > colours[..., 2] + 10)
