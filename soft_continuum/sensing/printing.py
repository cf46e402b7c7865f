# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Tags to print at true scale, with a ruler, and a drawing of where they go."""

from pathlib import Path

from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.patches import Circle, Rectangle

from soft_continuum.sensing.layout import Layout, TagLayout
from soft_continuum.sensing.pages import board_page, BORDER, Page, tag_pages


def write_tags(path: Path, layout: Layout) -> None:
    """Write a PDF of A4 with all tags of a layout; raises OSError, ParameterError."""
    pages = layout.pages()
    with PdfPages(path) as pdf:
        for page in (*pages, board_page()):  # as large as the page: nothing scales it
            pdf.savefig(page)


def plane_pages(layout: TagLayout) -> list[Page]:
    """Return the pages of a planar arm."""
    of_discs = [f'disc {n}{" (base)" if n == 0 else ""}, {height * 1e3:g} mm up'
                for n, height in enumerate(layout.heights)]
    of_fixed = [f'{n}: x {x * 1e3:+.0f} mm, z {z * 1e3:+.0f} mm' for n, (x, z) in zip(
        layout.fixed_numbers, layout.fixed, strict=True)]
    return [_drawing(layout),
            *tag_pages('Tags of the discs: number 0 at the base', range(len(layout.heights)),
                       layout.disc_size, of_discs),
            *tag_pages('Fixed tags', layout.fixed_numbers, layout.fixed_size, of_fixed)]


def _drawing(layout: TagLayout) -> Page:
    """Return the page that says where the tags go."""
    page = Page('Where the tags go, seen from the camera (from -y): x to the right, z along the '
                 'straight arm.\nThis page is not to scale.')
    axes = page.add_axes((0.14, 0.36, 0.78, 0.50))
    half = layout.fixed_size / 2.0
    for number, (x, z) in zip(layout.fixed_numbers, layout.fixed, strict=True):
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
