"""OpenSCAD, run so that no failure passes: a .scad in, its evaluated .csg out."""

from __future__ import annotations

import hashlib
import json
import os
import re
import subprocess
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from harness import UserError
from harness.atomic import replacing


class OpenScadError(UserError):
    """One line: what OpenSCAD refused, with file and line where it names them."""


def evaluate(scad: Path, csg: Path, defines: Mapping[str, object] | None = None) -> None:
    """Write the model that `scad` describes to `csg`, whole or not at all.

    `defines` are assigned after the file's own variables, as by `openscad -D`. A warning is a
    failure, too: OpenSCAD leaves out what it does not know, and exits with 0.
    """
    _run(scad, csg, defines or {}, [])


def to_csg(model: Path, cache_dir: Path) -> Path:
    """The .csg of a model: itself, or evaluated into `cache_dir` unless it stands there already.

    A record beside the .csg names OpenSCAD's version and every file that it read, by content; it
    holds for as long as they are all the same.
    """
    if model.suffix not in (".csg", ".scad"):
        raise OpenScadError(f"{model}: a model is a .scad or a .csg file")
    _require_file(model)
    if model.suffix == ".csg":
        return model

    place = hashlib.sha256(os.fsencode(model.resolve())).hexdigest()[:8]
    record_path = cache_dir / f"{model.stem}-{place}.json"
    try:
        record = json.loads(record_path.read_text())
        csg = cache_dir / record["csg"]
        if record["inputs"] == _fingerprint(map(Path, record["inputs"]["files"])) and csg.is_file():
            return csg
    except (OSError, ValueError, KeyError, TypeError):
        pass  # never evaluated, or a record that cannot be read

    with TemporaryDirectory() as scratch:
        evaluated, dependencies = Path(scratch, "model.csg"), Path(scratch, "dependencies")
        _run(model, evaluated, {}, ["-d", str(dependencies)])
        inputs = _fingerprint(_files_in(dependencies.read_text(errors="surrogateescape")))
        text = evaluated.read_bytes()
    csg = cache_dir / f"{model.stem}-{hashlib.sha256(text).hexdigest()[:16]}.csg"
    with replacing(csg) as whole:
        whole.write_bytes(text)
    with replacing(record_path) as whole:
        whole.write_text(json.dumps({"csg": csg.name, "inputs": inputs}, indent=1) + "\n")
    return csg


@cache
def version() -> str:
    finished = _openscad(["--version"])
    return (finished.stderr or finished.stdout).strip()


def literal(value: object) -> str:
    """A Python value as OpenSCAD writes it."""
    if value is None:
        return "undef"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(literal, value)) + "]"
    return repr(value)


def _run(scad: Path, csg: Path, defines: Mapping[str, object], options: list[str]) -> None:
    _require_file(scad)
    assignments = [f"-D{name}={literal(value)}" for name, value in defines.items()]
    with replacing(csg) as whole:
        # Absolute paths, for OpenSCAD takes relative ones from the folder of the .scad.
        finished = _openscad(
            ["-o", str(whole.resolve()), *options, *assignments, str(scad.resolve())]
        )
        if complaint := _complaint(scad, finished):
            raise OpenScadError(complaint)
        # After a failed write it exits with 0 as well.
        if not whole.read_bytes().endswith(b"\n"):
            raise OpenScadError(f"{csg}: OpenSCAD could not write all of it")


def _openscad(arguments: list[str]) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "LC_ALL": "C.UTF-8", "LANGUAGE": "C"}  # messages in English
    try:
        return subprocess.run(
            ["openscad", *arguments],
            capture_output=True,
            text=True,
            errors="replace",
            env=environment,
            stdin=subprocess.DEVNULL,
            check=False,
        )
    except FileNotFoundError:
        raise OpenScadError("openscad is not installed: apt-get install openscad") from None


def _complaint(scad: Path, finished: subprocess.CompletedProcess[str]) -> str:
    """The first complaint as `file:line: message`, or nothing."""
    complaints = re.findall(r"^(?:ERROR|WARNING): *(.+)", finished.stderr, re.MULTILINE)
    if complaints:
        more = f" (and {len(complaints) - 1} more)" if len(complaints) > 1 else ""
        if placed := re.fullmatch(r"(.*?),? in file (.+), line (\d+)", complaints[0]):
            message, file, line = placed.groups()
            # The parser names files from the current folder, all else from that of the .scad.
            place = Path(file) if message.startswith("Parser error") else scad.parent / file
            place = scad if place.resolve() == scad.resolve() else place
            return f"{place}:{line}: {message}{more}"
        return f"{scad}: {complaints[0]}{more}"
    if finished.returncode < 0:
        return f"{scad}: OpenSCAD was ended by signal {-finished.returncode}"
    if finished.returncode:
        lines = [line.strip() for line in finished.stderr.splitlines() if line.strip()]
        return f"{scad}: {lines[0] if lines else f'OpenSCAD failed ({finished.returncode})'}"
    return ""


def _files_in(makefile: str) -> list[Path]:
    """The prerequisites that `openscad -d` wrote: a line each, spaces escaped."""
    lines = makefile.splitlines()[1:]
    return [Path(line.strip().removesuffix(" \\").replace("\\ ", " ")) for line in lines]


def _fingerprint(files: Iterable[Path]) -> dict:
    """What an evaluation depends on. A file that was looked for in vain counts by its absence."""
    contents = {
        str(file): hashlib.sha256(file.read_bytes()).hexdigest() if file.is_file() else None
        for file in files
    }
    return {"openscad": version(), "files": contents}


def _require_file(path: Path) -> None:
    if not path.is_file():
        raise OpenScadError(f"{path}: {'not a file' if path.exists() else 'no such file'}")
