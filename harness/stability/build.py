"""Other builds of `tracers`: for another instruction set, or with a bug planted in its source."""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from harness import ROOT, UserError

FOLDER = ROOT / "build" / "other"


@dataclass(frozen=True)
class Edit:
    """One replacement in a source file of `tracers`; the old text stands there once."""

    file: str
    old: str
    new: str


def build(name: str, edits: Sequence[Edit] = (), *, isa: str = "", optimization: str = "") -> Path:
    """The extension module of a changed copy of the sources. What did not change since the last
    build of the same name is not compiled again.

    UserError if an edit no longer fits the source or the copy does not compile."""
    sources, out = FOLDER / name / "source", FOLDER / name / "out"
    _copy_changed(sources, {Path(edit.file): edit for edit in edits})
    options = {"TRACERS_ISA": isa, "TRACERS_OPTIMIZATION": optimization}
    given = [f"-D{key}={value}" for key, value in options.items() if value]
    _run(["cmake", "-S", sources, "-B", out, "-G", "Ninja", f"-DPython_EXECUTABLE={sys.executable}",
          "-DWARNINGS_AS_ERRORS=OFF", *given])  # fmt: skip
    _run(["cmake", "--build", out])
    return next(out.glob("tracers*.so"))


def _copy_changed(target: Path, edits: dict[Path, Edit]) -> None:
    """Make `target` the sources with the edits, leaving files alone whose text stays the same."""
    files = [ROOT / "CMakeLists.txt", *(ROOT / "tracers").rglob("*.?pp")]
    wanted = {file.relative_to(ROOT) for file in [*files, ROOT / "tracers/schemes/schemes.def"]}
    for file in edits.keys() - wanted:
        raise UserError(f"{file}: no such source")
    for file in wanted:
        text = (ROOT / file).read_text()
        if edit := edits.get(file):
            if text.count(edit.old) != 1:
                raise UserError(f"{file}: '{edit.old}' stands there {text.count(edit.old)} times")
            text = text.replace(edit.old, edit.new)
        copy = target / file
        if not copy.exists() or copy.read_text() != text:
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_text(text)
    for copy in (target / "tracers").rglob("*.?pp"):
        if copy.relative_to(target) not in wanted:
            copy.unlink()


def _run(command: Sequence[str | Path]) -> None:
    tools = Path(sys.executable).parent  # cmake and ninja of the virtual environment
    environment = {"PATH": f"{tools}:/usr/local/bin:/usr/bin:/bin"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    if done.returncode:
        lines = [
            line for line in (done.stdout + done.stderr).splitlines() if "error" in line.lower()
        ]
        raise UserError(f"{command[0]} failed: {(lines or ['without a message'])[0]}")


def load(module: Path) -> None:
    """Make this build what `import tracers` gives. Before anything has imported it."""
    if "tracers" in sys.modules:
        raise RuntimeError("tracers is imported already")
    spec = importlib.util.spec_from_file_location("tracers", module)
    sys.modules["tracers"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(sys.modules["tracers"])


def clean() -> None:
    shutil.rmtree(FOLDER, ignore_errors=True)
