# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Texts of the nodes for the page: short, printable, with the labels of its buttons."""

import re

from soft_continuum.ros.names import NODES

LENGTH = 400  # characters
BUTTONS = {'stop': 'STOP', 'resume': 'Resume', 'reference': 'Reference', 'reset': 'Reset shape',
           'set_all_stiff': 'Stiffen all'}
NODE = f'(?:{"|".join(NODES)})'
SOURCE = re.compile(f'^(?:{NODE}(?:/[a-z_0-9]+)*: )+')
SERVICE = re.compile(f'(call )?(?:~|{NODE})/({"|".join(BUTTONS)})' r'\b')


def plain(text: str) -> str:
    """Return a text with the names of buttons instead of services, cut, in one line."""
    text = text[:2 * LENGTH]
    text = ''.join(c if c.isprintable() else ' ' for c in text)
    text = SERVICE.sub(lambda m: ('press ' if m[1] else '') + BUTTONS[m[2]],
                       SOURCE.sub('', text))
    return text if len(text) <= LENGTH else f'{text[:LENGTH - 1]}…'
