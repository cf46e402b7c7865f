# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The rings of tags of a spatial arm as strips to fold, and a drawing of where everything goes."""

from math import cos, degrees, sin

from matplotlib.patches import Circle, Polygon

from soft_continuum.parameters.parameter import ParameterError
from soft_continuum.sensing.pages import A4, BORDER, FLAP, GAP, Page, tag_pages
from soft_continuum.sensing.ring_layout import RingLayout

BELOW = 0.030  # m for the ruler
ABOVE = 0.012  # m for the title


def ring_pages(layout: RingLayout) -> list[Page]:
    """Return the pages of a spatial arm; raises ParameterError for tags that do not fit on one."""
    of_fixed = [f'{n}: x {1e3 * x:+.0f}, y {1e3 * y:+.0f}, z {1e3 * z:+.0f} mm,\n'
                f'looks to {degrees(turn):.0f} deg' for n, (x, y, z, turn) in zip(
                    layout.fixed_numbers, layout.fixed, strict=True)]
    return [_drawing(layout), *_strips(layout),
            *tag_pages('Fixed tags', layout.fixed_numbers, layout.fixed_size, of_fixed)]


def _strips(layout: RingLayout) -> list[Page]:
    """Return the pages with the strips of all discs, a long one in several parts."""
    room = A4[1] - BELOW - 2.0 * BORDER - ABOVE
    longest = int((room - FLAP) / layout.face)
    columns = int((A4[0] - 2.0 * BORDER + GAP / 2.0) / (layout.face + GAP))
    if not (longest and columns):
        raise ParameterError(f'a tag of {layout.disc_size * 1e3:g} mm does not fit on A4; '
                             'tags.disc_size: 100 mm at most, to print them')
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


def _drawing(layout: RingLayout) -> Page:
    """Return the page that says where the tags go."""
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
    page.axes_.text(BORDER, 0.108, _INSTRUCTIONS.format(
        faces=layout.faces, radius=1e3 * layout.radius, last=layout.faces - 1,
        heights=', '.join(f'{1e3 * height:g}' for height in layout.heights)),
        fontsize=8.5, va='top', linespacing=1.5)
    return page


_INSTRUCTIONS = """\
1. Print at 100 %, check the ruler on every page, cut along the frames.
2. Fold each strip to a ring of {faces} faces and glue it around something stiff whose faces are
   {radius:.1f} mm from its axis: faces 0 to {last} follow each other counterclockwise seen
   from the tip, z points to the tip.
3. Put a ring around each disc, face 0 towards x, its middle {heights} mm
   above the bottom of disc 0, 1, ...; here they are drawn larger than they are.
4. Stick the fixed tags on stiff boards behind the arm, the middle of each where the drawing says
   (mm), z of the base upwards. The arrows say to which side they look. The origin (red) is the
   bottom centre of the base disc.
5. A camera needs three fixed tags in its picture, and looks best at an edge of the rings.
"""
