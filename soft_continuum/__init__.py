# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Model, actuate and sequence planar and spatial continuum arms of variable stiffness."""

from functools import cache


@cache
def version() -> str:
    """
    Return the version and, behind the +, a digest of the sources, such as 0.2.0+1a2b3c4d.

    The digest is the same for the same code, in a clone or installed.
    """
    from hashlib import sha256
    from importlib.metadata import PackageNotFoundError, version
    from os import path, walk
    root = path.dirname(__file__)
    digest = sha256()
    for source in sorted(path.join(folder, name) for folder, _, names in walk(root)
                         for name in names if name.endswith(('.py', '.html'))):
        with open(source, 'rb') as file:
            content = file.read()
        digest.update(f'{source[len(root):]} {len(content)} '.encode())
        digest.update(content)
    try:
        number = version('soft_continuum')
    except PackageNotFoundError:
        number = 'unknown'
    return f'{number}+{digest.hexdigest()[:8]}'
