"""The documentation site: ./trocar.sh docs. The pages are ../*.md; interfaces come from the comments of their sources."""

import os
import re
import sys

root = os.environ["TROCAR_SOURCE"]
sys.path.insert(0, os.path.join(root, "systems/app/python"))

project = "Trocar"
version = release = re.search(r"^project\(trocar VERSION ([0-9.]*)", open(os.path.join(root, "CMakeLists.txt")).read(), re.M)[1]
extensions = ["myst_parser", "sphinx.ext.autodoc", "breathe"]
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 4
source_suffix = [".md"]
root_doc = "index"
html_theme = "alabaster"
html_theme_options = {"description": "Virtual surgery", "fixed_sidebar": True, "page_width": "1100px"}
html_sidebars = {"**": ["about.html", "navigation.html", "searchbox.html"]}
html_copy_source = False
breathe_projects = {"trocar": os.environ["TROCAR_DOXYGEN"]}
breathe_default_project = "trocar"
breathe_domain_by_extension = {"h": "c"}
autodoc_member_order = "bysource"
autodoc_typehints = "description"
# `output` and `csv` blocks of the pages are plain text
highlight_options = {}


def setup(app):
    from pygments.lexers.special import TextLexer
    app.add_lexer("output", TextLexer)
    app.add_lexer("csv", TextLexer)
