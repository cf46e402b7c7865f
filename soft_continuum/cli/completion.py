# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Tab completion for bash, written from the parsers."""

import argparse
from collections.abc import Mapping

SCRIPT = """\
# bash completion of soft_continuum: source <(soft_continuum completion bash)
_soft_continuum() {{
    local current=${{COMP_WORDS[COMP_CWORD]}} command= word words=
    for word in "${{COMP_WORDS[@]:1:COMP_CWORD-1}}"; do
        case " {commands} " in *" $word "*) command=$word && break ;; esac
    done
    case $command in
        '') words='{commands}' ;;
{cases}
    esac
    case $command/$current in
        run/[!-]* | run/) words+=" $("${{COMP_WORDS[0]}}" completion shapes 2>/dev/null)" ;;
        stiffen/*) words+=' all' ;;
    esac
    mapfile -t COMPREPLY < <(compgen -W "$words" -- "$current")
}}
complete -o default -F _soft_continuum soft_continuum
"""


def bash_script(parsers: Mapping[str, argparse.ArgumentParser]) -> str:
    """Return the script for these commands and their options."""
    cases = '\n'.join(
        f"        {name}) words='{' '.join(sorted(parser._option_string_actions))}' ;;"
        for name, parser in parsers.items())
    return SCRIPT.format(commands=' '.join(parsers), cases=cases)
