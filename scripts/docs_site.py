"""Hooks of the documentation's site: pages from the root of the repository, and links that lead out of `docs/`."""

from __future__ import annotations

import os
import re
from pathlib import Path, PurePosixPath

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
# Page of the site, and the file of the repository that it shows.
FROM_ROOT = {
    "index.md": "README.md",
    "contributing.md": "CONTRIBUTING.md",
    "security.md": "SECURITY.md",
    "changelog.md": "CHANGELOG.md",
}
# Examples of messages, by their name: to the site's Markdown a fence has one word.
_NAMED_FENCE = re.compile(r"^```hex \w+$", re.MULTILINE)
_LINK = re.compile(r"(?P<text>!?\[[^\]]*\])\((?P<path>[^()\s#]+)(?P<anchor>#[^()\s]*)?\)")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that lie outside of `docs/`."""
    for page, source in FROM_ROOT.items():
        files.append(File.generated(config, page, content=(ROOT / source).read_text("utf-8")))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:  # noqa: ARG001 mkdocs passes all by name
    """Let links lead to pages of the site; one to a file of the code becomes plain text: the site has no code."""
    here = page.file.src_uri
    source = PurePosixPath(FROM_ROOT.get(here, f"docs/{here}"))
    pages = {path: uri for uri, path in FROM_ROOT.items()}

    def moved(match: re.Match[str]) -> str:
        if "://" in match["path"]:
            return match[0]
        target = os.path.normpath(source.parent / match["path"])
        uri = pages.get(target, target.removeprefix("docs/"))
        if uri == target and not target.startswith("docs/"):
            return match["text"][1:-1]
        return f"{match['text']}({os.path.relpath(uri, PurePosixPath(here).parent)}{match['anchor'] or ''})"

    return _NAMED_FENCE.sub("```text", _LINK.sub(moved, markdown))
