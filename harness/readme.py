"""The README shows published tables: each between a pair of comments that names it."""

from __future__ import annotations

import re
from pathlib import Path

_BLOCK = re.compile(r"(<!-- table (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)


def refresh(readme: Path, tables: Path) -> None:
    """Put `tables`/NAME.md between every `<!-- table NAME -->` and the `<!-- end -->` after it."""

    def block(match: re.Match[str]) -> str:
        start, name, end = match.groups()
        table = tables / f"{name}.md"
        return f"{start}\n{table.read_text()}\n{end}" if table.exists() else match.group()

    readme.write_text(_BLOCK.sub(block, readme.read_text()))
