# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Which subclasses of Chain, Statics and Linearisation compute planar arms, and which all others.

The bases import neither.  The package, which is above both, enters its choice here.
"""

from collections.abc import Callable
from typing import Any

subclass: Callable[[str, bool], type[Any]]
"""Return the subclass of a base, by its name, for planar arms (true) or others (false)."""
