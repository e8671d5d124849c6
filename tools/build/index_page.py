"""The page of the package index: README.md with links that work there, and the addresses of the project.

The address is that of the repository in which a release is built (GITHUB_SERVER_URL, GITHUB_REPOSITORY); the links lead
to its tag (GITHUB_REF_NAME). Elsewhere the README is as it is, and there are no addresses.
"""

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

_LINK = re.compile(r"(?<=\]\()(?![a-z]+:|#)([^)\s]+)(?=\))")  # a relative one
_PICTURES = (".png", ".svg", ".jpg", ".gif")


def dynamic_metadata(settings: Mapping[str, Any], project: Mapping[str, Any]) -> dict[str, Any]:
    """Return the readme and the addresses, as scikit-build-core asks for them."""
    text = Path("README.md").read_text(encoding="utf-8")
    server, repository = (os.environ.get(f"GITHUB_{name}") for name in ("SERVER_URL", "REPOSITORY"))
    urls: dict[str, str] = {}
    if server and repository:
        home, ref = f"{server}/{repository}", os.environ.get("GITHUB_REF_NAME", "HEAD")
        text = with_absolute_links(text, home, ref)
        urls = {
            "Homepage": home,
            "Documentation": f"{home}/blob/{ref}/docs/README.md",
            "Changelog": f"{home}/blob/{ref}/CHANGELOG.md",
            "Issues": f"{home}/issues",
        }
    return {"readme": {"content-type": "text/markdown", "text": text}, "urls": urls}


def with_absolute_links(text: str, home: str, ref: str) -> str:
    """Return a page of the repository at `home` with links to files of `ref`: pictures themselves, pages of others."""

    def absolute(link: re.Match[str]) -> str:
        kind = "raw" if link[1].endswith(_PICTURES) else "blob"
        return f"{home}/{kind}/{ref}/{link[1]}"

    return _LINK.sub(absolute, text)
