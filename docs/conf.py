# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The documentation as a site, by ``./run docs``; the pages read well without it."""

from docutils import nodes
from docutils.parsers.rst import roles
from pygments.lexers.special import TextLexer

from soft_continuum.ui.cli.reference import main as write_parameter_tables

write_parameter_tables()

project = 'soft_continuum'
copyright = '2026 The soft_continuum authors'
extensions = ['myst_parser', 'sphinx.ext.apidoc', 'sphinx.ext.autodoc', 'sphinx.ext.mathjax']
# The source is the root of the repository: pages link to code and configuration.
include_patterns = ['docs/**.md', 'docs/reference/api/**.rst', 'msg_docs/**.md']
exclude_patterns = ['data/**', 'docs/reference/api/modules.rst',
                    'docs/reference/api/soft_continuum.rst']
root_doc = 'docs/index'
html_theme = 'furo'
html_title = 'soft_continuum'
html_static_path = ['static']
html_css_files = ['tables.css']
myst_enable_extensions = ['dollarmath']
myst_fence_as_directive = ['math']
myst_heading_anchors = 3
# Links to folders only a repository can show; test/test_pages.py checks all links.
suppress_warnings = ['myst.xref_missing', 'ref.python']

# The Python API, from the docstrings of the packages that scripts and drivers import.
apidoc_modules = [{
    'path': '../soft_continuum',
    'destination': 'docs/reference/api',
    'exclude_patterns': [f'../soft_continuum/{part}' for part in (
        'commissioning', 'lab/new_arm', 'nodes', 'parameters/arguments.py', 'ros', 'ros_topics',
        'sim', 'ui/browser', 'ui/cli', '__main__.py', 'colours.py', 'extras.py',
        'text.py', 'user_files.py')],
    'separate_modules': True,
    'module_first': True,
    'automodule_options': {'members', 'show-inheritance', 'ignore-module-all'},
}]
autodoc_member_order = 'bysource'
autodoc_typehints = 'signature'


# What matplotlib adds to a subclass names its own types.
roles.register_generic_role('mpltype', nodes.literal)


def setup(app):
    """Show mermaid, which GitHub draws, as text."""
    app.add_lexer('mermaid', TextLexer)
