# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Tags to print at true scale, rings as strips to fold, and drawings of their positions."""

from collections.abc import Sequence
from math import cos, degrees, sin
from pathlib import Path

from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon, Rectangle
import numpy as np
from numpy.typing import NDArray

from soft_continuum.estimation.sensing.layout import (
    Layout,
    MODULES,
    QUIET_ZONE,
    RingLayout,
    white_modules,
)
from soft_continuum.estimation.sensing.lens import board, COLUMNS, ROWS, SQUARE
from soft_continuum.parameters.parameter import ParameterError

A4 = 0.210, 0.297  # m
INCH = 0.0254  # m
BORDER = 0.015  # m that printers leave white
GAP = 0.010  # m between two tags on a page
RULER = 0.100  # m
FLAP = 0.008  # m at the end of a strip
MAX_SIZE = (A4[0] - 2.0 * BORDER - GAP) / (1.0 + 2.0 * QUIET_ZONE)  # m, of a tag
BELOW = 0.030  # m for the ruler, below strips
ABOVE = 0.012  # m for the title


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


def write_tags(path: Path, layout: Layout) -> None:
    """Write a PDF of A4 with all tags of a layout; raises OSError, ParameterError."""
    pages = _of_rings(layout) if isinstance(layout, RingLayout) else _of_discs(layout)
    with PdfPages(path) as pdf:
        for page in (*pages, board_page()):  # as large as the page: nothing scales it
            pdf.savefig(page)


def _of_discs(layout: Layout) -> list[Page]:
    """Return the pages of a planar arm."""
    of_discs = [f'disc {n}{" (base)" if n == 0 else ""}, {height * 1e3:g} mm up'
                for n, height in enumerate(layout.heights)]
    of_fixed = [f'{n}: x {x * 1e3:+.0f} mm, z {z * 1e3:+.0f} mm' for n, (x, _, z, _) in zip(
        layout.fixed_numbers, layout.fixed, strict=True)]
    return [_drawing(layout),
            *tag_pages('Tags of the discs: number 0 at the base', range(len(layout.heights)),
                       layout.disc_size, of_discs),
            *tag_pages('Fixed tags', layout.fixed_numbers, layout.fixed_size, of_fixed)]


def _drawing(layout: Layout) -> Page:
    """Return the page that shows where the tags go."""
    page = Page('Where the tags go, seen from the camera (from -y): x to the right, z along the '
                 'straight arm.\nThis page is not to scale.')
    axes = page.add_axes((0.14, 0.36, 0.78, 0.50))
    half = layout.fixed_size / 2.0
    for number, (x, _, z, _) in zip(layout.fixed_numbers, layout.fixed, strict=True):
        axes.add_patch(Rectangle((x - half, z - half), 2 * half, 2 * half, color='0.3'))
        axes.text(x, z - half - 0.005, f'{number}\n({x * 1e3:.0f}, {z * 1e3:.0f})', va='top',
                  ha='center', fontsize=8)
    for n, (below, height, middle) in enumerate(zip(
            layout.straight_heights, layout.disc_heights, layout.heights, strict=True)):
        axes.add_patch(Rectangle((-0.02, below), 0.04, height, color='0.8'))
        half = layout.disc_size / 2.0
        axes.add_patch(Rectangle((-half, below + middle - half), 2 * half, 2 * half, color='0.3'))
        axes.text(0.03, below + middle, f'{n}', fontsize=8, va='center')
    axes.add_patch(Circle((0.0, 0.0), 0.004, color='C3'))
    axes.annotate('origin of base_link: bottom\ncentre of the base disc', (0.0, 0.0),
                  (0.06, -0.03), color='C3', fontsize=8, arrowprops={'arrowstyle': '-'})
    low, high = layout.fixed.min(axis=0) - 0.08, layout.fixed.max(axis=0) + 0.06
    axes.set(xlim=(low[0], high[0]), ylim=(low[2], high[2]), xlabel='x [m]', ylabel='z [m]')
    axes.set_aspect('equal')
    page.axes_.text(BORDER, 0.095, _INSTRUCTIONS.format(
        depth=layout.fixed[0, 1] * 1e3), fontsize=8.5, va='top',
        linespacing=1.5)
    return page


_INSTRUCTIONS = """\
1. Print at 100 %, check the ruler on every page, cut along the frames. The paper must stay flat.
2. Stick the fixed tags on one stiff plane behind the arm, upright, centred at the positions in the
   drawing (mm).
3. Stick a tag on each disc, upright on the straight arm, centred on the axis of the arm at the
   height above the bottom of the disc printed below it; {depth:g} mm nearer to the camera than the
   fixed ones (tags.depth).
4. Place the camera on the side from which x is to the right and z is up, with all fixed tags in
   the image.
"""


def _of_rings(layout: RingLayout) -> list[Page]:
    """Return the pages of a spatial arm; raises ParameterError for tags that do not fit on one."""
    of_fixed = [f'{n}: x {1e3 * x:+.0f}, y {1e3 * y:+.0f}, z {1e3 * z:+.0f} mm,\n'
                f'looks to {degrees(turn):.0f} deg' for n, (x, y, z, turn) in zip(
                    layout.fixed_numbers, layout.fixed, strict=True)]
    return [_ring_drawing(layout), *_strips(layout),
            *tag_pages('Fixed tags', layout.fixed_numbers, layout.fixed_size, of_fixed)]


def _strips(layout: RingLayout) -> list[Page]:
    """Return the pages with the strips of all discs, a long one in several parts."""
    room = A4[1] - BELOW - 2.0 * BORDER - ABOVE
    longest = int((room - FLAP) / layout.face)
    columns = int((A4[0] - 2.0 * BORDER + GAP / 2.0) / (layout.face + GAP))
    if not (longest and columns):
        most = layout.disc_size / layout.face * (A4[0] - 2.0 * BORDER - GAP / 2.0)
        raise ParameterError(f'a tag of {layout.disc_size * 1e3:g} mm does not fit on A4; '
                             f'tags.disc_size: {most * 1e3:.0f} mm at most, to print them')
    parts = []
    for disc in range(len(layout.heights)):
        numbers = list(layout.ring(disc))
        labels = [f'{number}: disc {disc}, face {k}, {360.0 * k / layout.faces:.0f} deg'
                  for k, number in enumerate(numbers)]
        parts += [(numbers[k:k + longest], labels[k:k + longest])
                  for k in range(0, layout.faces, longest)]
    pages = []
    for first in range(0, len(parts), columns):
        page = Page(f'Rings of the discs: fold along the dashed lines, the tags outside. Edge of '
                    f'a black square: {layout.disc_size * 1e3:g} mm.')
        for k, (numbers, labels) in enumerate(parts[first:first + columns]):
            page.strip(numbers, labels,
                       BORDER + GAP / 2.0 + layout.face / 2.0 + k * (layout.face + GAP),
                       BORDER + BELOW, layout.disc_size)
        pages.append(page)
    return pages


def _ring_drawing(layout: RingLayout) -> Page:
    """Return the page that shows where the tags go."""
    page = Page('Where the tags go, seen from the tip along the arm (z towards you, x to the '
                'right).\nThis page is not to scale.')
    axes = page.add_axes((0.14, 0.40, 0.78, 0.50))
    half = layout.fixed_size / 2.0
    places: dict[tuple[float, ...], list[str]] = {}
    for number, (x, y, z, turn) in zip(layout.fixed_numbers, layout.fixed, strict=True):
        places.setdefault((x, y, turn), []).append(f'{number} (z {z * 1e3:.0f})')
    for (x, y, turn), texts in places.items():
        across, out = (-sin(turn), cos(turn)), (cos(turn), sin(turn))
        axes.plot(*([c - half * a, c + half * a] for c, a in zip((x, y), across, strict=True)),
                  color='0.2', lw=3)
        axes.annotate('', (x + 0.05 * out[0], y + 0.05 * out[1]), (x, y),
                      arrowprops={'arrowstyle': '->', 'color': '0.2'})
        axes.text(x - 0.015 * out[0], y - 0.015 * out[1], '\n'.join(
            [*texts, f'({x * 1e3:.0f}, {y * 1e3:.0f})']), fontsize=7,
            ha=('right', 'center', 'left')[1 - round(out[0])],
            va=('top', 'center', 'bottom')[1 - round(out[1])])
    big = 0.08 / layout.radius  # the ring is drawn larger than it is
    axes.add_patch(Polygon(big * layout.rim[:, :2], fill=False, edgecolor='0.2', lw=2))
    axes.add_patch(Circle((0.0, 0.0), big * layout.disc_radii[0], color='0.85'))
    for k, tag in enumerate(layout.ring(0).values()):
        x, y = 1.2 * big * tag.centre[:2]
        axes.text(x, y, f'{k}', fontsize=8, ha='center', va='center')
    axes.annotate('x', (0.0, 0.0), (0.06, 0.0), color='C3', va='center', ha='center',
                  arrowprops={'arrowstyle': '<-', 'color': 'C3'})
    axes.plot(0.0, 0.0, 'o', color='C3', ms=4)
    low, high = layout.fixed[:, :2].min(axis=0), layout.fixed[:, :2].max(axis=0)
    axes.set(xlim=(min(-0.15, low[0]) - 0.15, max(0.15, high[0]) + 0.15),
             ylim=(min(-0.15, low[1]) - 0.15, max(0.15, high[1]) + 0.15),
             xlabel='x [m]', ylabel='y [m]')
    axes.set_aspect('equal')
    page.axes_.text(BORDER, 0.108, _RING_INSTRUCTIONS.format(
        faces=layout.faces, radius=1e3 * layout.radius, last=layout.faces - 1,
        heights=', '.join(f'{1e3 * height:g}' for height in layout.heights)),
        fontsize=8.5, va='top', linespacing=1.5)
    return page


_RING_INSTRUCTIONS = """\
1. Print at 100 %, check the ruler on every page, cut along the frames.
2. Fold each strip to a ring of {faces} faces and glue it around something stiff whose faces are
   {radius:.1f} mm from its axis: faces 0 to {last} follow each other counterclockwise seen
   from the tip, z points to the tip.
3. Put a ring around each disc, face 0 towards x, its middle {heights} mm
   above the bottom of disc 0, 1, ...; the drawing enlarges the rings.
4. Stick the fixed tags on stiff boards behind the arm, centred at the positions in the drawing
   (mm), z of the base upwards. The arrows show which way they face. The origin (red) is the
   bottom centre of the base disc.
5. A camera needs three fixed tags in its image, and measures best facing an edge of the rings.
"""
