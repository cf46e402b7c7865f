# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What ``doctor`` checks of a motor box, besides that it opens and reads."""

import time

from soft_continuum.hardware.commissioning import Check, OK, WARN

LISTENING = 0.5  # s
SLOW = 0.05  # s


def checks_opened(driver):
    """Check how often the box reports; nothing moves."""
    end, oldest = time.monotonic() + LISTENING, 0.0
    while time.monotonic() < end:
        time.sleep(0.001)
        oldest = max(oldest, driver.age)
    yield Check('motor box', WARN if oldest > SLOW else OK,
                f'reports at least every {1e3 * oldest:.0f} ms')
