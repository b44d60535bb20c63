"""What mkdocs does after it built the site: the notebooks as pages, which NOTEBOOKS=run runs before."""

from __future__ import annotations

import logging
import os
import tempfile
from pathlib import Path
from typing import Any

LOG = logging.getLogger("mkdocs.hooks.notebooks")


def on_post_build(config: Any) -> None:
    """Write each of notebooks/*.py as a page of its own beside the page that lists them."""
    try:
        import jupytext
        from nbconvert import HTMLExporter
        from nbconvert.preprocessors import ExecutePreprocessor
    except ImportError as error:
        LOG.info('the notebooks are no pages of this site: %s; pip install ".[notebooks]"', error)
        return
    folder = Path(config["site_dir"]) / "notebooks"
    for source in sorted(Path(config["config_file_path"]).parent.glob("notebooks/*.py")):
        notebook = jupytext.read(source)
        if os.environ.get("NOTEBOOKS") == "run":
            with tempfile.TemporaryDirectory() as scratch:
                ExecutePreprocessor(timeout=120).preprocess(notebook, {"metadata": {"path": scratch}})
        page, _ = HTMLExporter().from_notebook_node(notebook)
        (folder / f"{source.stem}.html").write_text(page, encoding="utf-8")
