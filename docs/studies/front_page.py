"""README and other files of the root folder as pages of the site: a hook of mkdocs. README is the front page."""

from __future__ import annotations

import re
from typing import Any, Final

from mkdocs.structure.files import File

from docs.studies.figures import ROOT

PAGES: Final = {"README.md": "index.md", "CHANGELOG.md": "changelog.md", "SECURITY.md": "security.md"}
"""Files of the root folder, and the names of their pages."""
LINK: Final = re.compile(r"(!?)\[([^\]]*)\]\((?!\w+:|#)([^)\s]+)\)")


def on_files(files: Any, config: Any) -> Any:
    """Add the pages; links to other files of the root folder become plain text."""
    for name, page in PAGES.items():
        text = (ROOT / name).read_text(encoding="utf-8")
        files.append(File.generated(config, page, content=LINK.sub(_from_docs, text)))
    return files


def _from_docs(link: re.Match[str]) -> str:
    """A link of a file in the root folder, rewritten for a page in docs."""
    picture, text, target = link.groups()
    path, mark, anchor = target.partition("#")
    target = PAGES.get(path, path.removeprefix("docs/") if path.startswith("docs/") else "")
    return f"{picture}[{text}]({target}{mark}{anchor})" if target else text
