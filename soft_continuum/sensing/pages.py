# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Pages of A4 at true scale, with a ruler: tags, strips of tags, and the board for the lens."""

from collections.abc import Sequence

from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
import numpy as np
from numpy.typing import NDArray

from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.sensing.layout import QUIET_ZONE
from soft_continuum.sensing.lens_calibration import board, COLUMNS, ROWS, SQUARE
from soft_continuum.sensing.pictures import MODULES, white_modules

A4 = 0.210, 0.297  # m
INCH = 0.0254  # m
BORDER = 0.015  # m that printers leave white
GAP = 0.010  # m between two tags on a page
RULER = 0.100  # m
FLAP = 0.008  # m at the end of a strip
MAX_SIZE = (A4[0] - 2.0 * BORDER - GAP) / (1.0 + 2.0 * QUIET_ZONE)  # m, of a tag


class Page(Figure):
    """A page of A4 whose coordinates are m from its lower left corner."""

    def __init__(self, title: str) -> None:
        super().__init__(figsize=(A4[0] / INCH, A4[1] / INCH))
        self.axes_ = self.add_axes((0.0, 0.0, 1.0, 1.0))
        self.axes_.set(xlim=(0.0, A4[0]), ylim=(0.0, A4[1]))
        self.axes_.axis('off')
        self.axes_.text(BORDER, A4[1] - BORDER, title, va='top', fontsize=9)
        self._ruler()

    def _ruler(self) -> None:
        """Draw a ruler, to detect scaling by the printer with a real one."""
        y = BORDER + 0.004
        self.axes_.plot([BORDER, BORDER + RULER], [y, y], 'k', lw=0.6)
        mm = np.arange(round(RULER * 1e3) + 1)
        heights = np.where(mm % 10 == 0, 0.004, np.where(mm % 5 == 0, 0.0025, 0.0015))
        self.axes_.vlines(BORDER + mm * 1e-3, y, y + heights, 'k', lw=0.4)
        self.axes_.text(BORDER + RULER + 0.004, y, f'{RULER * 1e3:.0f} mm: print at 100 % and '
                        'measure this', fontsize=8, va='bottom')

    def tag(self, number: int, x: float, y: float, size: float, label: str) -> None:
        """Draw a tag about (x, y), m, with a frame to cut along and crosses at its middle."""
        self._modules(white_modules(number), x, y, size)
        frame = size * (1.0 + 2.0 * QUIET_ZONE)
        self.axes_.add_patch(Rectangle((x - frame / 2.0, y - frame / 2.0), frame, frame,
                                       fill=False, edgecolor='0.6', lw=0.3))
        for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            near, far = frame / 2.0, frame / 2.0 + 0.003
            self.axes_.plot([x + dx * near, x + dx * far], [y + dy * near, y + dy * far], 'k',
                            lw=0.4)
        self.axes_.text(x + 0.001, y - frame / 2.0 - 0.001, label, fontsize=7, va='top')

    def strip(self, numbers: Sequence[int], labels: Sequence[str], x: float, y: float, size: float
              ) -> None:
        """
        Draw a strip of tags to fold, from (x, y) upwards, m: its middle and its lower end.

        The tags' up direction is left.  Fold lines are between them, a flap is at the end.
        """
        face = size * (1.0 + 2.0 * QUIET_ZONE)
        for k, (number, label) in enumerate(zip(numbers, labels, strict=True)):
            self._modules(np.rot90(white_modules(number)), x, y + (k + 0.5) * face, size)
            self.axes_.plot([x - face / 2.0, x + face / 2.0], [y + (k + 1) * face] * 2, '--',
                            color='0.5', lw=0.4)
            self.axes_.text(x + face / 2.0 + 0.001, y + (k + 0.5) * face, label, fontsize=6,
                            rotation=90, va='center', ha='left')
        length = len(numbers) * face + FLAP
        self.axes_.add_patch(Rectangle((x - face / 2.0, y), face, length, fill=False,
                                       edgecolor='0.6', lw=0.3))
        self.axes_.text(x, y + length - FLAP / 2.0, 'glue', fontsize=6, ha='center', va='center')
        self.axes_.annotate('z', (x - face / 2.0 + 0.001, y + face / 2.0),
                            (x - face / 2.0 - 0.005, y + face / 2.0), fontsize=7, va='center',
                            ha='center', arrowprops={'arrowstyle': '<-', 'lw': 0.5})

    def _modules(self, white: NDArray[np.bool_], x: float, y: float, size: float) -> None:
        """Draw the black modules of a tag about (x, y), m."""
        rows, columns = np.nonzero(~white)
        lower_left = np.column_stack([columns, MODULES - 1 - rows]) - MODULES / 2.0
        squares = lower_left[:, None] + [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
        self.axes_.add_collection(PolyCollection(
            list((x, y) + size / MODULES * squares), facecolor='k', edgecolor='k', lw=0.05),
            autolim=False)


def tag_pages(title: str, numbers: Sequence[int], size: float, labels: Sequence[str]
           ) -> list[Page]:
    """Return the pages for these tags."""
    frame = size * (1.0 + 2.0 * QUIET_ZONE) + GAP
    if frame > A4[0] - 2.0 * BORDER:
        raise ParameterError(f'a tag of {size * 1e3:g} mm does not fit on A4; tags.disc_size and '
                             f'tags.fixed_size: {MAX_SIZE * 1e3:.0f} mm at most, to print them')
    columns = max(1, int((A4[0] - 2.0 * BORDER) / frame))
    rows = max(1, int((A4[1] - 2.0 * BORDER - 0.03) / frame))
    pages = []
    for first in range(0, len(numbers), columns * rows):
        page = Page(f'{title}. Edge of the black square: {size * 1e3:g} mm.')
        for k, (number, label) in enumerate(
                list(zip(numbers, labels, strict=True))[first:first + columns * rows]):
            row, column = divmod(k, columns)
            page.tag(number, BORDER + (column + 0.5) * frame,
                     A4[1] - BORDER - 0.012 - (row + 0.5) * frame, size, label)
        pages.append(page)
    return pages


def board_page() -> Page:
    """Return the board for `calibrate camera`."""
    page = Page('For `soft_continuum calibrate camera`: glue it onto something stiff and flat.')
    width, height = COLUMNS * SQUARE, ROWS * SQUARE
    dots = 40  # per square, a multiple of what its tags are drawn with
    picture = board().generateImage((COLUMNS * dots, ROWS * dots), marginSize=0)
    left, below = (A4[0] - width) / 2.0, (A4[1] - height) / 2.0
    page.axes_.imshow(picture, cmap='gray', extent=(left, left + width, below, below + height),
                      interpolation='nearest', zorder=0)
    page.axes_.set(xlim=(0.0, A4[0]), ylim=(0.0, A4[1]))
    return page
