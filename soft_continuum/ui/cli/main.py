# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``soft_continuum VERB``: finds the verb in the registry and calls its function."""

import argparse
from collections.abc import Callable, Sequence
from importlib import import_module
import os
import signal
import sys

from soft_continuum import version
from soft_continuum.parameters.arguments import DONE, FOR_NODES, INTERRUPTED, Parser
from soft_continuum.parameters.parameter import name_hint
from soft_continuum.ui.cli.registry import GROUPS, Verb, VERBS
from soft_continuum.user_files import pages


def main(argv: Sequence[str] | None = None) -> int:
    """
    Call a verb with its options; return the exit status.

    argv: the words after the program, by default those of this process.  Common options may also
    stand before the verb.
    """
    if '_ARGCOMPLETE' in os.environ:
        return _complete()
    words = list(sys.argv[1:] if argv is None else argv)
    parser = _parser()
    parser.add_argument('verb', nargs='?', help=argparse.SUPPRESS)
    parser.add_argument('options', nargs=argparse.REMAINDER, help=argparse.SUPPRESS)
    options = parser.parse_args(words)
    if options.version:
        print(f'soft_continuum {version()}')
        return DONE
    if options.verb is None:
        parser.error('no verb given, such as status or demo')
    if options.verb not in VERBS:
        parser.error(f'unknown verb {options.verb!r}{name_hint(options.verb, VERBS)}')
    before = words[:len(words) - len(options.options) - 1]
    return call(VERBS[options.verb], [*before, *options.options])


def call(verb: Verb, options: Sequence[str]) -> int:
    """Import the function of a verb and call it; return the exit status."""
    sys.argv[1:] = options
    module, _, name = verb.target.partition(':')
    try:
        function: Callable[..., int] = getattr(import_module(f'soft_continuum.{module}'), name)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        return function(*verb.arguments)
    except ImportError as error:
        from soft_continuum.extras import remedy
        if not (text := remedy(error)):
            raise
        return Parser(verb.name, '').fail(text)
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:  # such as into head: the reader has closed the pipe
        return DONE


def completion() -> int:
    """Print the completion script of a shell."""
    parser = Parser('completion', 'Print the script for tab completion. For bash put this into '
                    '~/.bashrc: source <(soft_continuum completion bash)')
    parser.add_argument('shell', choices=('bash', 'zsh', 'fish'))
    shell = parser.parse_args().shell
    from argcomplete.shell_integration import shellcode
    print(shellcode(['soft_continuum'], shell='bash' if shell == 'zsh' else shell))
    return DONE


def _parser() -> Parser:
    width = max(map(len, VERBS))
    listing = '\n\n'.join(
        '\n'.join([f'{group}:', *(f'  {verb.name:<{width}}  {verb.help}' for verb in verbs)])
        for group, verbs in GROUPS.items())
    parser = Parser(
        '', 'Tendon-driven continuum arms with jamming segments: operate them, analyse them, set '
        'them up.\nVERB --help shows the options of a verb. Pages quoted in messages, such as '
        f'docs/index.md, are in {pages()}\n\n{listing}',
        *FOR_NODES, usage='%(prog)s VERB [OPTION]...',
        formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--version', action='store_true', help='print the version and exit')
    return parser


def _complete() -> int:
    """Print what completes the word at the cursor: a verb, or what its own parser offers."""
    from argcomplete.lexers import split_line
    words = split_line(os.environ['COMP_LINE'], int(os.environ['COMP_POINT']))[3]
    for position, word in enumerate(words[1:], start=1):
        if word in VERBS:
            os.environ['_ARGCOMPLETE'] = str(position + 1)  # the parser sees VERB and the rest
            return call(VERBS[word], []) if VERBS[word].completes else DONE
    parser = _parser()
    parser.add_argument('verb', choices=VERBS)
    parser.parse_args()
    return DONE
