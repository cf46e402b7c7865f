# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Tags to print at true scale, with a ruler, and a drawing of where they go."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
import numpy as np

from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.sensing.layout import QUIET, TagLayout
from soft_continuum.sensing.lens_calibration import board, COLUMNS, ROWS, SQUARE
from soft_continuum.sensing.pictures import MODULES, white_modules

A4 = 0.210, 0.297  # m
INCH = 0.0254  # m
BORDER = 0.015  # m that printers leave white
GAP = 0.010  # m between two tags on a page
RULER = 0.100  # m
MAX_SIZE = (A4[0] - 2.0 * BORDER - GAP) / (1.0 + 2.0 * QUIET)  # m, of a tag


class _Page(Figure):
    """A page of A4 whose coordinates are m from its lower left corner."""

    def __init__(self, title: str) -> None:
        super().__init__(figsize=(A4[0] / INCH, A4[1] / INCH))
        self.axes_ = self.add_axes((0.0, 0.0, 1.0, 1.0))
        self.axes_.set(xlim=(0.0, A4[0]), ylim=(0.0, A4[1]))
        self.axes_.axis('off')
        self.axes_.text(BORDER, A4[1] - BORDER, title, va='top', fontsize=9)
        self._ruler()

    def _ruler(self) -> None:
        """Draw a ruler: a printer that scales is found out with a real one."""
        y = BORDER + 0.004
        self.axes_.plot([BORDER, BORDER + RULER], [y, y], 'k', lw=0.6)
        for k in range(int(RULER * 1e3) + 1):
            height = 0.004 if k % 10 == 0 else 0.0025 if k % 5 == 0 else 0.0015
            self.axes_.plot([BORDER + k * 1e-3] * 2, [y, y + height], 'k', lw=0.4)
        self.axes_.text(BORDER + RULER + 0.004, y, f'{RULER * 1e3:.0f} mm: print at 100 % and '
                        'measure this', fontsize=8, va='bottom')

    def tag(self, number: int, x: float, y: float, size: float, label: str) -> None:
        """Draw a tag about (x, y), m, with a frame to cut along and crosses at its middle."""
        edge = size / MODULES
        for row, column in np.argwhere(~white_modules(number)):
            self.axes_.add_patch(Rectangle(
                (x - size / 2.0 + column * edge, y + size / 2.0 - (row + 1) * edge), edge, edge,
                facecolor='k', edgecolor='k', lw=0.05))
        frame = size * (1.0 + 2.0 * QUIET)
        self.axes_.add_patch(Rectangle((x - frame / 2.0, y - frame / 2.0), frame, frame,
                                       fill=False, edgecolor='0.6', lw=0.3))
        for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            near, far = frame / 2.0, frame / 2.0 + 0.003
            self.axes_.plot([x + dx * near, x + dx * far], [y + dy * near, y + dy * far], 'k',
                            lw=0.4)
        self.axes_.text(x + 0.001, y - frame / 2.0 - 0.001, label, fontsize=7, va='top')


def write_tags(path: Path, layout: TagLayout) -> None:
    """Write a PDF of A4 with all tags of a layout; raises OSError."""
    with PdfPages(path) as pdf:
        _save(pdf, _drawing(layout))
        numbers = range(len(layout.heights))
        labels = [f'disc {n}{" (base)" if n == 0 else ""}, {height * 1e3:g} mm up'
                  for n, height in enumerate(layout.heights)]
        for page in _pages('Tags of the discs: number 0 at the base', numbers,
                           layout.disc_size, labels):
            _save(pdf, page)
        labels = [f'{n}: x {x * 1e3:+.0f} mm, z {z * 1e3:+.0f} mm' for n, (x, z) in zip(
            layout.fixed_numbers, layout.fixed, strict=True)]
        for page in _pages('Fixed tags', layout.fixed_numbers, layout.fixed_size, labels):
            _save(pdf, page)
        _save(pdf, _board())


def _save(pdf: PdfPages, page: Figure) -> None:
    pdf.savefig(page)  # type: ignore[no-untyped-call]  # as large as the page: nothing scales it


def _pages(title: str, numbers: Sequence[int], size: float, labels: Sequence[str]
           ) -> list[_Page]:
    """Return as many pages as these tags need."""
    frame = size * (1.0 + 2.0 * QUIET) + GAP
    if frame > A4[0] - 2.0 * BORDER:
        raise ParameterError(f'a tag of {size * 1e3:g} mm does not fit on A4; tags.disc_size and '
                             f'tags.fixed_size: {MAX_SIZE * 1e3:.0f} mm at most, to print them')
    columns = max(1, int((A4[0] - 2.0 * BORDER) / frame))
    rows = max(1, int((A4[1] - 2.0 * BORDER - 0.03) / frame))
    pages = []
    for first in range(0, len(numbers), columns * rows):
        page = _Page(f'{title}. Edge of the black square: {size * 1e3:g} mm.')
        for k, (number, label) in enumerate(
                list(zip(numbers, labels, strict=True))[first:first + columns * rows]):
            row, column = divmod(k, columns)
            page.tag(number, BORDER + (column + 0.5) * frame,
                     A4[1] - BORDER - 0.012 - (row + 0.5) * frame, size, label)
        pages.append(page)
    return pages


def _board() -> _Page:
    """Return the board for `calibrate camera`."""
    page = _Page('For `soft_continuum calibrate camera`: glue it onto something stiff and flat.')
    width, height = COLUMNS * SQUARE, ROWS * SQUARE
    dots = 40  # per square, a multiple of what its tags are drawn with
    picture = board().generateImage((COLUMNS * dots, ROWS * dots), marginSize=0)
    left, below = (A4[0] - width) / 2.0, (A4[1] - height) / 2.0
    page.axes_.imshow(picture, cmap='gray', extent=(left, left + width, below, below + height),
                      interpolation='nearest', zorder=0)
    page.axes_.set(xlim=(0.0, A4[0]), ylim=(0.0, A4[1]))
    return page


def _drawing(layout: TagLayout) -> _Page:
    """Return the page that says where the tags go."""
    page = _Page('Where the tags go, seen from the camera (from -y): x to the right, z along the '
                 'straight arm.\nThis page is not to scale.')
    axes = page.add_axes((0.14, 0.36, 0.78, 0.50))
    half = layout.fixed_size / 2.0
    for number, (x, z) in zip(layout.fixed_numbers, layout.fixed, strict=True):
        axes.add_patch(Rectangle((x - half, z - half), 2 * half, 2 * half, color='0.3'))
        axes.text(x, z - half - 0.005, f'{number}\n({x * 1e3:.0f}, {z * 1e3:.0f})', va='top',
                  ha='center', fontsize=8)
    below = 0.0
    for n, (height, middle) in enumerate(zip(layout.disc_heights, layout.heights, strict=True)):
        axes.add_patch(Rectangle((-0.02, below), 0.04, height, color='0.8'))
        half = layout.disc_size / 2.0
        axes.add_patch(Rectangle((-half, below + middle - half), 2 * half, 2 * half, color='0.3'))
        axes.text(0.03, below + middle, f'{n}', fontsize=8, va='center')
        below += height + (layout.segment_lengths[n] if n < len(layout.segment_lengths) else 0.0)
    axes.add_patch(Circle((0.0, 0.0), 0.004, color='C3'))
    axes.annotate('origin of base_link: bottom\ncentre of the base disc', (0.0, 0.0),
                  (0.06, -0.03), color='C3', fontsize=8, arrowprops={'arrowstyle': '-'})
    low, high = layout.fixed.min(axis=0) - 0.08, layout.fixed.max(axis=0) + 0.06
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel='x [m]', ylabel='z [m]')
    axes.set_aspect('equal')
    page.axes_.text(BORDER, 0.095, _INSTRUCTIONS.format(
        depth=layout.depth * 1e3), fontsize=8.5, va='top',
        linespacing=1.5)
    return page


_INSTRUCTIONS = """\
1. Print at 100 %, check the ruler on every page, cut along the frames. The paper must stay flat.
2. Stick the fixed tags on one stiff plane behind the arm, upright, their middles where the drawing
   says (mm).
3. Stick a tag on each disc, upright on the straight arm, its middle on the axis of the arm and as
   far above the bottom of the disc as stands below it; {depth:g} mm nearer to the camera than the
   fixed ones (tags.depth).
4. The camera looks from the side at which x is to the right when z is up; all fixed tags in the
   picture.
"""
