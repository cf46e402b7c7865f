# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``tags``: the printed tags of the discs and of the board behind the arm, as a PDF."""

import argparse
from collections.abc import Sequence

from soft_continuum.lab.analysis.verbs import reserve_outputs, run_verb
from soft_continuum.parameters.arguments import FOR_ANALYSIS, Parser

NAME = 'tags'


def main(argv: Sequence[str] | None = None) -> int:
    """Write the PDF; return the exit status."""
    parser = Parser(NAME, 'Printable tags (36h11) for the described arm: one for each disc, or a '
                    'ring of tags for each disc of a spatial arm, fixed tags for the boards '
                    'behind it, a mounting drawing, and rulers. The parameters tags.* of the node '
                    'camera set their sizes and positions.',
                    *FOR_ANALYSIS)
    return run_verb(parser, _run, argv, 'cv2', 'matplotlib')


def _run(options: argparse.Namespace) -> None:
    from soft_continuum.estimation.sensing.layout import layout_of
    from soft_continuum.ros.description import load_description
    from soft_continuum.ros.names import CAMERA
    layout = layout_of(load_description(
        *options.params_file, node=CAMERA, namespace=options.namespace))
    path, = reserve_outputs(options.output, [f'{NAME}.pdf'], options.force)
    from soft_continuum.estimation.sensing.printing import write_tags
    write_tags(path, layout)
    on_discs = sum(len(layout.ring(n)) for n in range(len(layout.heights)))
    print(f'{on_discs} tags for discs and {len(layout.fixed)} fixed ones: {path}')
