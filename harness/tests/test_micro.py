"""The microbenchmarks: their tables, and that they run, where they are built."""

import io
import json
import subprocess
from pathlib import Path

import pytest
from rich.console import Console

import tracers
from harness import ROOT, UserError, micro
from harness.machine import code_version


def row(name: str, order: int, counter: str = "", seconds: float = 0.0, **more) -> dict:
    """As Google Benchmark writes it."""
    found = {"run_name": name, "run_type": "iteration", "family_index": order, **more}
    return found | ({counter: seconds} if counter else {})


def kept(folder, rows: list[dict]) -> micro.Outcome | None:
    session = {"code_version": code_version()}
    session["machine"] = {"cpu": "abacus", "cores": 1, "load_average": 0.5}
    record = folder / "micro" / "micro.json"
    record.parent.mkdir(exist_ok=True)
    record.write_text(json.dumps({"session": session, "benchmarks": rows}))
    return micro.load(folder)


def test_tables_of_what_was_measured(tmp_path) -> None:
    assert micro.load(tmp_path) is None
    rows = [
        row("scheme/naive/ball/shadow", 4, "s_per_ray", 4e-6),
        row("scheme/naive/ball/primary", 3, "s_per_ray", 3e-6),
        row("scheme/least/ball/primary", 2.5, "s_per_ray", 1e-7) | {"primitives": 1.875},
        row("scheme/fast/ball/primary", 5, error_occurred=True, error_message="no such tree"),
        row("structure/loader/ball", 2, "s_per_byte", 2e-8),
    ]
    for repeat in (1.0, 1.1, 1.2, 1.3, 1.4, 1.5):
        rows.append(row("kernel/cone/float32/hit", 0, "s_per_test", 1e-7 * repeat))
        rows.append(row("kernel/cone/float32/miss", 1, "s_per_test", 1e-9))
    rows.append(row("kernel/cone/float32/hit", 0, "s_per_test", 1.0) | {"run_type": "aggregate"})
    outcome = kept(tmp_path, rows)
    shown = micro.write(outcome, tmp_path).read_text()
    assert "| cone | float32 | 125 [100, 150] | 1.00 [1.00, 1.00] |" in shown
    assert "| loader | ball | 20.0 | byte | 50.0 |" in shown
    assert "| scheme | ball: primary, ns | ball: shadow, ns |" in shown
    assert "| naive | 3,000 | 4,000 |" in shown
    assert "scheme/fast/ball/primary: no such tree." in shown
    assert "A ray enters 1.9 on ball (primary)." in shown
    assert "1 cores of abacus, load average 0.5" in shown
    lines = (tmp_path / "tables" / "micro.csv").read_text().splitlines()
    assert lines[0] == "name,per,item_s,item_s_low,item_s_high,item_s_n"
    assert lines[-1] == "scheme/naive/ball/shadow,ray,4e-06,,,1"


def test_what_is_not_built_is_not_run(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(micro, "PROGRAM", tmp_path / "micro")
    with pytest.raises(UserError, match="run `make bench-micro`"):
        micro.run(Console(), tmp_path)


HEADER = Path("/usr/include/benchmark/benchmark.h")


@pytest.mark.skipif(not HEADER.exists(), reason="needs Google Benchmark")
def test_the_sources_compile() -> None:
    """Nothing but `make bench-micro` builds them."""
    sources = sorted((ROOT / "tracers" / "bench").glob("*.cpp"))
    options = ["-fsyntax-only", "-std=c++20", "-march=x86-64-v2"]
    subprocess.run(["c++", *options, *map(str, sources)], check=True)


@pytest.mark.skipif(not micro.is_built(), reason="needs `make bench-micro` of these sources")
def test_every_scheme_and_kernel_is_run(tmp_path) -> None:
    options = ["--benchmark_repetitions=1", "--benchmark_min_time=0"]
    micro.run(Console(file=io.StringIO()), tmp_path, ["ball"], options)
    measured = micro.load(tmp_path).measured
    assert all(m.item_s.median > 0 for m in measured)
    run = {m.name[1].split()[0] for m in measured if m.name[0] == "scheme"}
    assert run == {"least"} | {scheme.name for scheme in tracers.schemes()}
    kernels = {m.name[1].split()[0] for m in measured if m.name[0] == "kernel"}
    assert kernels == {"sphere", "block", "cylinder", "cone", "torus"}
