"""A report: the tables and plots of what has been measured, and what paper.tex reads."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from harness import RESULTS, ROOT, STORE, UserError, models, plots, study
from harness.claims import claims
from harness.figures import FIGURES, figure
from harness.results import Results
from harness.results import load as load_results
from harness.scheme_tables import (
    constants,
    fastest_exact,
    machine,
    references,
    schemes,
    work,
)
from harness.store import Store
from harness.table import Table, latex_text, write_forms
from harness.tables import break_even, characteristics, optimum, reductions, timing
from harness.trials import cost_picture

GENERATED = ROOT / "paper" / "generated"


def load_study(name: str) -> study.Study:
    return study.load(study.find(name))


def load(name: str, folder: Path) -> tuple[Results, Results, Path]:
    """What `folder` has of a study and of the grid study, which is reported with the paper's; and
    where the report goes. A study of the user's own has a folder to itself."""
    store = folder / STORE
    if not store.exists():
        raise UserError(f"{store}: nothing measured yet; run `csgbench sweep` first")
    opened = Store(store)
    main, grid = (
        load_results(opened, load_study(study))
        for study in ("paper" if name == "grid" else name, "grid")
    )
    return main, grid, folder if main.study.name == "paper" else folder / main.study.name


def all_tables(paper: Results, grid: Results, counted: dict[str, dict]) -> list[Table]:
    """`counted`: of each model its `halfspaces`, `nodes` and `kinds`."""
    figures = {name: figure(name, paper) for name in FIGURES}
    figures = {name: fig for name, fig in figures.items() if any(row.ours for row in fig.rows)}
    return [
        characteristics(paper, counted),
        *(timing(name, fig) for name, fig in figures.items()),
        *([claims(paper)] if figures else []),
        reductions(figures.values()),
        optimum(figures.values(), grid, paper.code_version),
        break_even(figures.values()),
        *(schemes(model, paper) for model in counted),
        fastest_exact(paper),
        constants(paper),
        work(paper),
        references(paper),
        machine(paper),
    ]


def write_tables(paper: Results, grid: Results, folder: Path) -> Path:
    """`folder`/tables.md has all tables, `folder`/tables/ each as Markdown, CSV and LaTeX with the
    values that paper.tex cites, and `folder`/trials.csv the raw rows they come from."""
    tables = all_tables(paper, grid, models.characteristics(paper.study.models))
    tables = [table for table in tables if table.rows]
    each = folder / "tables"
    write_forms(tables, each)
    (each / "values.tex").write_text(_values(tables))
    (folder / "tables.md").write_text(_document(tables, paper))
    paper.rows.to_csv(folder / "trials.csv", index=False, lineterminator="\n")
    if (paper.study.name, folder) == ("paper", RESULTS):
        _copy(each.glob("*.tex"), each, GENERATED)
    return folder / "tables.md"


def write_plots(paper: Results, grid: Results, folder: Path) -> Path:
    """To `folder`/plots, each as SVG and PNG."""
    for name, canvas in plots.all_plots(paper, grid, cost_picture):
        plots.save(canvas, folder / "plots" / name)
    return folder / "plots"


def _document(tables: list[Table], results: Results) -> str:
    left_out = [f"- {line}" for line in results.refusals()]
    left_out += [f"- {model}: not compared with POV-Ray" for model in results.unchecked]
    parts = [f"# {results.study.title}\n", *(table.markdown() for table in tables)]
    if left_out:
        parts.append("### Not tabled, or not checked\n\n" + "\n".join(left_out) + "\n")
    return "\n".join(parts)


def _values(tables: list[Table]) -> str:
    r"""\result{table/row/column} in LaTeX: any cell of any table; a wrong path is an error."""
    lines = [
        r"% Written by `csgbench tables`. \result{figure8/5:10 Yes/trace_s} is a cell of a table;",
        r"% /low and /high after it are the ends of its interval.",
        r"\newcommand{\result}[1]{\ifcsname result@#1\endcsname\csname result@#1\endcsname",
        r"  \else\errmessage{no result '#1'}\fi}",
    ]
    lines += [
        rf"\expandafter\def\csname result@{path}\endcsname{{{latex_text(value)}}}"
        for table in tables
        for path, value in table.values()
    ]
    return "\n".join([*lines, ""])


def publish(folder: Path, target: Path) -> None:
    """Copy what a reader of the repository sees, of all studies: all but the LaTeX."""
    patterns = ("*.md", "*trials.csv", "tables/*.md", "tables/*.csv", "plots/*", "reference/*")
    for source in (
        folder,
        *(folder / name for name in ("accuracy", "bench", "stability", "scale")),
    ):
        _copy((file for pattern in patterns for file in source.glob(pattern)), source, target)


def _copy(files: Iterable[Path], source: Path, target: Path) -> None:
    for file in files:
        copy = target / file.relative_to(source)
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_bytes(file.read_bytes())
