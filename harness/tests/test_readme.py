"""The README's tables are those of the report."""

from pathlib import Path

from harness.readme import refresh


def test_a_named_block_is_replaced_and_the_rest_stays(tmp_path: Path) -> None:
    readme = tmp_path / "README.md"
    rest = "b\n<!-- table gone -->\nx\n<!-- end -->\n"
    readme.write_text(f"a\n<!-- table t -->\nold\n<!-- end -->\n{rest}")
    (tmp_path / "t.md").write_text("| new |\n")
    for _ in range(2):
        refresh(readme, tmp_path)
        assert readme.read_text() == f"a\n<!-- table t -->\n\n| new |\n\n<!-- end -->\n{rest}"
