"""The manual as a site: `make manual` builds it into site/ from the pages of this folder. Nothing in it comes from a network."""

import html
import os
import re
import sys
from pathlib import Path

from docutils.nodes import SkipNode
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml

sys.path.insert(0, str(Path(__file__).parent))
import api_reference
import artefact_reference
import benchmark_history
import config_reference
import gallery_pages

project = "strainsight"
extensions = ["myst_nb", "sphinx.ext.autodoc"]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
exclude_patterns = ["images", "static", "*.py"]
# Notebooks are scripts in jupytext's percent format. They run once, until they change; `-D nb_execution_mode=off` runs none.
nb_custom_formats = {".py": ["jupytext.reads", {"fmt": "py:percent"}]}
nb_execution_mode = "cache"
nb_execution_raise_on_error = True
nb_execution_timeout = 900
nb_merge_streams = True
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
nitpicky = True
nitpick_ignore_regex = [("py:.*", ".*")]  # types of other packages and of the kernels have no page
# Blocks without a language are equations and printouts: not to be guessed at.
highlight_language = "text"
html_theme = "furo"
html_title = "strainsight"
html_copy_source = False
html_show_copyright = False
html_static_path = ["static"]
html_css_files = ["manual.css"]
html_show_sphinx = False
html_math_renderer = "mathml"


def inline_math(writer, node):
    """An equation between words, as MathML: no script draws it."""
    writer.body.append(mathml(node, as_block=False))
    raise SkipNode


def block_math(writer, node):
    """An equation on a line of its own."""
    writer.body.append(f'<div class="equation">{mathml(node, as_block=True)}</div>')
    raise SkipNode


def mathml(node, as_block):
    try:
        return tex2mathml(node.astext(), as_block=as_block)
    except MathError as fault:
        raise ValueError(f"not understood as an equation: {html.escape(node.astext())}") from fault


def only_within(app, name, source):
    """Links to files that are beside the manual in the repository, but not in it, become plain words."""
    source[0] = re.sub(r"\[([^]]+)\]\(\.\./(?:\.\./)*(?:meshes|configs|tests|benchmarks)/[^)]*\)", r"\1", source[0])


def only_drawn(app, name, source):
    """Pictures of the gallery that no run has drawn yet are left out."""

    def kept(found):
        return found[0] if (Path(app.srcdir) / name).parent.joinpath(found[1] or found[2]).is_file() else ""

    source[0] = re.sub(r"\[!\[[^]]*\]\(([^)\s]+)\)\]\([^)]*\)|!\[[^]]*\]\(([^)\s]+)\)", kept, source[0])


def prepare_kernels(app):
    """Kernels of notebooks log errors only, and draw without a display."""
    profile = Path(app.doctreedir) / "ipython" / "profile_default"
    profile.mkdir(parents=True, exist_ok=True)
    (profile / "ipython_kernel_config.py").write_text("c.IPKernelApp.log_level = 'ERROR'\n", encoding="utf-8")
    os.environ["IPYTHONDIR"] = str(profile.parent)
    os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")


def setup(app):
    app.connect("builder-inited", prepare_kernels)
    app.connect("autodoc-process-docstring", api_reference.process)
    app.add_html_math_renderer("mathml", (inline_math, None), (block_math, None))
    app.connect("source-read", only_within)
    app.connect("source-read", only_drawn)
    app.connect("builder-inited", lambda app: config_reference.write(Path(app.srcdir) / "config"))
    app.connect("builder-inited", lambda app: artefact_reference.write(Path(app.srcdir) / "artefacts"))
    app.add_config_value("run_examples", True, "env")
    app.connect("builder-inited", lambda app: gallery_pages.write() if int(app.config.run_examples) else None)
    app.connect("builder-inited", lambda app: benchmark_history.write(Path(app.srcdir) / "history"))
