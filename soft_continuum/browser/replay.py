# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``replay``: a recording in the view, with a time slider."""

from collections.abc import Sequence
from contextlib import ExitStack
import signal
import sys

from soft_continuum.analysis.bag_tables import bag_in
from soft_continuum.analysis.delimited import MeasurementError
from soft_continuum.arguments import DONE, given_path, Parser, WRONG_USAGE
from soft_continuum.browser.access import AccessError
from soft_continuum.browser.main import add_view_options, interrupt, serve
from soft_continuum.recordings.playback import Playback


def main(argv: Sequence[str] | None = None) -> int:
    """Show a recording until Ctrl-C; return the exit status."""
    parser = Parser('replay', 'Play a recording in a browser, with a time slider. No arm moves.',
                    '--namespace')
    parser.add_argument('recording', type=given_path, metavar='RECORDING',
                        help='directory that record wrote, or an MCAP file')
    add_view_options(parser)
    options = parser.parse_args(argv)
    signal.signal(signal.SIGTERM, interrupt)
    try:
        path = bag_in(options.recording)
        playback = Playback(path, options.namespace)
        if not playback.is_described:
            return parser.fail(f'{path} lacks the parameters of the arm, which record writes; use '
                               'report or export', WRONG_USAGE)
        if playback.damage:
            print(f'{path}: {playback.damage}; the part before is shown', file=sys.stderr)
        with ExitStack() as running, playback:
            serve(running, options, 'The recording', playback,
                  f'of {path.name}: {playback.duration:.1f} s. No arm moves.',
                  namespace=playback.namespace)
    except (AccessError, MeasurementError) as error:
        return parser.fail(error, WRONG_USAGE)
    except KeyboardInterrupt:
        pass
    return DONE
