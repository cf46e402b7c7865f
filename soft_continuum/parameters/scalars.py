# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Values as they stand in parameter files: read as rcl reads them, and written so."""

from math import inf, nan
import re
import sys

import yaml

from soft_continuum.parameters.parameter import Value

Scalar = bool | int | float | str

TRUTH = {form: truth for truth, words in ((True, ('yes', 'true', 'on')), (False, (
    'no', 'false', 'off'))) for word in words for form in (word, word.title(), word.upper())}
TRUTH |= {'y': True, 'Y': True, 'n': False, 'N': False}
INTEGER = re.compile(r'([-+]?)(?:0[xX]([0-9a-fA-F]+)|(0[0-7]*)|([1-9][0-9]{0,18}))')
NUMBER = re.compile(r'[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?')
HEXADECIMAL = re.compile(
    r'[-+]?0[xX](?:[0-9a-fA-F]+\.?[0-9a-fA-F]*|\.[0-9a-fA-F]+)(?:[pP][-+]?[0-9]+)?')
NOT_FINITE = re.compile(r'([-+]?)(?:(inf(?:inity)?)|nan(?:\([A-Za-z0-9_]*\))?)', re.IGNORECASE)
DOTTED = {f'{sign}.{word}': f'{sign}inf' for sign in ('', '+', '-')
          for word in ('inf', 'Inf', 'INF')} | dict.fromkeys(('.nan', '.NaN', '.NAN'), 'nan')
"""What YAML writes for what strtod calls inf and nan."""
UNQUOTED = re.compile(r'-?[A-Za-z0-9_./+][A-Za-z0-9_./+-]*')
EXACT = 17
"""Digits that tell every float from all others."""


def read_scalar(text: str, quoted: bool = False) -> Scalar:
    """
    Return the value of a scalar of YAML, as rcl has it (get_value in its parse.c).

    It is not that of YAML: 010 is eight, 1_000 and 1:30 are texts, y is true, 2e2 is a number.
    """
    if quoted:
        return text
    if text in TRUTH:
        return TRUTH[text]
    digits = text.lstrip(' \t\n\v\f\r')  # as strtoll and strtod do
    if (found := INTEGER.fullmatch(digits)):
        sign, hexadecimal, octal, decimal = found.groups()
        size = int(hexadecimal, 16) if hexadecimal else int(octal, 8) if octal else int(decimal)
        if -2**63 <= (value := -size if sign == '-' else size) < 2**63:
            return value
    number = _float(DOTTED.get(text, digits))
    return text if number is None else number


def _float(text: str) -> float | None:
    """Return what strtod makes of a text; None for a part of it, and for what is out of range."""
    if (found := NOT_FINITE.fullmatch(text)):
        return nan if not found[2] else -inf if found[1] == '-' else inf
    try:
        if NUMBER.fullmatch(text):
            number, mantissa = float(text), re.split('[eE]', text)[0]
        elif HEXADECIMAL.fullmatch(text):
            number, mantissa = float.fromhex(text), re.split('[xXpP]', text)[1]
        else:
            return None
    except OverflowError:
        return None
    small = abs(number) < sys.float_info.min and mantissa.strip('+-0.')
    return None if small or abs(number) == inf else number


def as_yaml(value: Value, digits: int = 8) -> str:
    """
    Return a value as a parameter file has it: numbers with a decimal point, as ROS wants.

    Numbers that are too small to be read again (subnormal) become 0.0.
    """
    if isinstance(value, list | tuple):
        return f'[{", ".join(as_yaml(item, digits) for item in value)}]'
    if isinstance(value, bool):
        return str(value).lower()
    if value == inf:
        return '.inf'
    if isinstance(value, float):
        value = 0.0 if abs(value) < sys.float_info.min else value
        mantissa, e, exponent = f'{value:.{digits}g}'.partition('e')
        return (mantissa if '.' in mantissa else f'{mantissa}.0') + e + exponent
    if isinstance(value, int) or (
            UNQUOTED.fullmatch(value) and isinstance(read_scalar(value), str)):
        return str(value)
    style = "'" if value.isprintable() else '"'
    text: str = yaml.safe_dump(value, default_style=style, allow_unicode=True, width=inf)
    return text.strip()
