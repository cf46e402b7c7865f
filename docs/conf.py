# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The documentation as a site, by ``./run docs``; the pages read well without it."""

from soft_continuum.parameters.reference import main as write_parameter_tables

write_parameter_tables()

project = 'soft_continuum'
copyright = '2026 The soft_continuum authors'
extensions = ['myst_parser', 'sphinx.ext.mathjax']
# The source is the root of the repository: pages link to code and configuration.
include_patterns = ['docs/**.md', 'msg_docs/**.md']
exclude_patterns = ['data/**']
root_doc = 'docs/index'
html_theme = 'furo'
html_title = 'soft_continuum'
myst_enable_extensions = ['dollarmath']
myst_fence_as_directive = ['math']
myst_heading_anchors = 3
# Links to folders only a repository can show; test/test_links.py checks all links.
suppress_warnings = ['myst.xref_missing']
