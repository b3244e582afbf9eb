"""What a measurement depends on beside its trial: the code, the machine, the versions."""

from __future__ import annotations

import hashlib
import os
import platform
import subprocess
import uuid
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

from harness import ROOT
from harness.store import Session
from harness.worker import utc_now

SOURCES = {".cpp", ".hpp", ".def"}
PROGRAMS = {"openscad": "--version", "povray": "--version"}
PACKAGES = ("numpy", "pandas", "matplotlib", "OpenImageIO", "manifold3d")


def session(study: str, seed: int) -> Session:
    """Everything about this invocation that its rows have in common."""
    import tracers

    built = dict(tracers.machine())
    return Session(
        session=uuid.uuid4().hex[:12],
        study=study,
        seed=seed,
        session_started_utc=utc_now(),
        git_commit=git_commit(),
        machine=machine(),
        compiler=str(built.pop("compiler")),
        flags=str(built.pop("flags")),
        versions=versions() | {name: str(value) for name, value in built.items()},
    )


@cache
def code_version() -> str:
    """Hash of what is compiled into `tracers`. Other edits leave measurements valid."""
    tracers = ROOT / "tracers"
    files = [ROOT / "CMakeLists.txt"] if (ROOT / "CMakeLists.txt").exists() else []
    files += [
        file
        for file in tracers.rglob("*")
        if file.suffix in SOURCES and file.relative_to(tracers).parts[0] not in ("tests", "bench")
    ]
    digest = hashlib.sha256()
    for file in sorted(files):
        digest.update(str(file.relative_to(ROOT)).encode() + b"\0" + file.read_bytes() + b"\0")
    return digest.hexdigest()[:12]


def git_commit() -> str:
    """The commit, with "+" after it where tracked files differ; "none" outside a repository."""
    commit = _output("git", "-C", str(ROOT), "rev-parse", "--short=12", "HEAD")
    changed = _output("git", "-C", str(ROOT), "status", "--porcelain", "--untracked-files=no")
    return f"{commit}+" if commit and changed else commit or "none"


def vectors() -> str:
    """The widest registers that packets of rays can use; Embree's packets of 16 need AVX-512."""
    has = set(_field("/proc/cpuinfo", "flags").split())
    v3 = {"avx2", "fma", "bmi2"}
    if v3 | {"avx512f", "avx512dq", "avx512vl", "avx512bw", "avx512cd"} <= has:
        return "AVX-512"
    return "AVX2" if v3 <= has else "SSE4.2"


def machine() -> dict[str, Any]:
    """CPU, memory and system."""
    return {
        "cpu": _field("/proc/cpuinfo", "model name") or platform.processor(),
        "vectors": vectors(),
        "cores": os.cpu_count(),
        "memory_bytes": os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"),
        "kernel": platform.release(),
        "system": platform.freedesktop_os_release().get("PRETTY_NAME", platform.system()),
        "load_average": os.getloadavg()[0],
    }


def versions() -> dict[str, str]:
    """Version of every program and package that a result can depend on; "" where it is missing."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = ""
    for program, option in PROGRAMS.items():
        found[program] = _first_number(_output(program, option))
    return found


def _output(*command: str) -> str:
    """Both streams (OpenSCAD and POV-Ray report on stderr); "" if it fails or is not there."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=True)
    except (OSError, subprocess.SubprocessError):
        return ""
    return (done.stdout + done.stderr).strip()


def _first_number(text: str) -> str:
    return next((word for word in text.split() if word[0].isdigit()), "")


def _field(path: str, name: str) -> str:
    lines = Path(path).read_text().splitlines() if Path(path).exists() else []
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith(name)), "")
