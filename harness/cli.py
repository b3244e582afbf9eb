"""`csgbench`, the command line of the harness. Each command is a few lines over a module."""

from __future__ import annotations

import inspect
import re
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness import RESULTS, STORE, UserError, outputs
from harness.outputs import err, out

if TYPE_CHECKING:
    from harness.study import Configuration

app = typer.Typer(
    help="""Measure acceleration schemes for ray tracing CSG solids.

    \b
    csgbench doctor               is everything installed?
    csgbench schemes              what can be measured, and its parameters
    csgbench trace ngk -o ngk.png
    csgbench sweep                measure the paper's study and report it
    csgbench sweep grid           the same for d 1 to 9 by h 1 to 30
    csgbench sweep bench          our schemes beside POV-Ray and Embree
    csgbench reference            compare the pictures with POV-Ray's
    csgbench tables               report again what has been measured
    csgbench plots
    csgbench accuracy             speed for accuracy, one knob at a time
    csgbench stability            numerical stability at the extremes
    csgbench scale                growth with the model, to a million halfspaces
    csgbench micro                kernels, structures and schemes one by one
    csgbench oracle ball --pixel 200,310
    """,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

MISUSE = typer.BadParameter.__base__  # of the command line; typer has no public name for it

StudyName = Annotated[
    str,
    typer.Argument(
        help="A name in harness/sweeps (paper, grid, bench) or the path of a .toml file."
    ),
]
Results = Annotated[
    Path, typer.Option(help="Where measurements are kept and reports go.", show_default="results")
]
Publish = Annotated[
    bool,
    typer.Option("--publish", help="Copy what is written to results/published/ and the README."),
]
Model = Annotated[str, typer.Argument(help="A scene name, or the path of a .scad or .csg file.")]
More = Annotated[list[str] | None, typer.Argument(hidden=True, metavar="name=value")]
Settings = Annotated[list[str] | None, typer.Option("--set", help="Parameters: --set d=5 h=10.")]
Size = Annotated[str, typer.Option(help="Width and height of the picture, in pixels.")]


def _command(function: Callable) -> Callable:
    """Its docstring is its help, wrapped where the terminal ends and not where the source does; a
    paragraph that begins with \\b keeps its lines."""
    paragraphs = inspect.cleandoc(function.__doc__).split("\n\n")
    unwrapped = [p if p.startswith("\b") else p.replace("\n", " ") for p in paragraphs]
    return app.command(help="\n\n".join(unwrapped))(function)


@contextmanager
def _one_line_errors() -> Iterator[None]:
    """What the user can put right is one line on stderr and exit code 2, never a traceback."""
    import tracers

    try:
        yield
    except (UserError, tracers.ModelError, OSError) as error:
        err.print(" ".join(str(error).split()), style="red", markup=False)
        raise typer.Exit(2) from None
    except KeyboardInterrupt:
        err.print("stopped; what was measured is kept, and the same command goes on from here")
        raise typer.Exit(130) from None


@_command
def sweep(
    study: StudyName = "paper",
    seed: Annotated[int, typer.Option(help="Of the random order of the trials.")] = 0,
    retry: Annotated[bool, typer.Option("--retry", help="Run failed trials once more.")] = False,
    bare: Annotated[bool, typer.Option("--bare", help="Measure only; no report.")] = False,
    results: Results = RESULTS,
) -> None:
    """Measure everything in a study that has no row yet, then check the pictures and report.

    It can be stopped at any moment; the same command goes on from there. A trial that fails leaves
    a row with the reason, and the others go on; the exit code is then 1.

    \b
    csgbench sweep             Figures 8 and 9 and the baselines
    csgbench sweep grid        the optimum of d and h
    csgbench sweep bench       our schemes beside POV-Ray and Embree, on one thread and on all
    csgbench sweep mine.toml   a study of your own, written like paper.toml
    """
    with _one_line_errors():
        from harness.report import load_study

        failed = _measure(study, seed, retry, results)
        if not bare:
            _check(results, load_study(study).pictures, missing_only=True)
            if study == "bench":
                outputs.bench(results, measure_errors=True)
            else:
                outputs.tables(study, results)
                outputs.plots(study, results)
        if failed:
            raise typer.Exit(1)


@_command
def trace(
    model: Model,
    more: More = None,
    scheme: Annotated[str, typer.Option(help="See `csgbench schemes`.")] = "hybrid_sdsm",
    settings: Settings = None,
    size: Size = "512x512",
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="A .png to look at, or an .exr.")
    ] = None,
    threads: Annotated[
        int, typer.Option(min=0, max=1024, help="Threads that trace; 0: one a core.")
    ] = 1,
) -> None:
    """Trace one picture and say what it took.

    An .exr has channels for colour, depth, normal, leaf, light and cost (primitives tested for the
    pixel).

    \b
    csgbench trace ball
    csgbench trace ngk --scheme sdsm --set d=6 h=7 -o ngk.png
    csgbench trace part.scad --scheme embree_cells --size 1024x768 -o part.exr
    """
    with _one_line_errors():
        from harness import trace as traces
        from harness.schemes import model_and_settings

        model, settings = model_and_settings([model, *(more or [])], settings or [])
        traces.trace(out, err, model, scheme, settings, size, output, threads)


@_command
def schemes() -> None:
    """List the schemes, with the type, default and meaning of their parameters."""
    with _one_line_errors():
        from harness.schemes import catalogue, describe

        out.print(describe(catalogue()))


@_command
def doctor() -> None:
    """Say what is installed, and try one scheme on the smallest scene. Exit code 1 if it is ill."""
    with _one_line_errors():
        from harness.doctor import examine

        if not examine(out):
            raise typer.Exit(1)


@_command
def reference(
    models: Annotated[list[str] | None, typer.Argument(help="Scenes; all without any.")] = None,
    size: Size = "512x512",
    results: Results = RESULTS,
) -> None:
    """Render each model with POV-Ray and compare our picture with it. Exit code 1 if one failed.

    The verdict is kept: a model whose picture failed is not tabled.
    """
    with _one_line_errors():
        from harness.scenes import load_scenes
        from harness.trace import parse_size

        pictures = [(model, *parse_size(size)) for model in models or load_scenes()]
        if not _check(results, pictures):
            raise typer.Exit(1)


@_command
def tables(
    study: StudyName = "paper", publish: Publish = False, results: Results = RESULTS
) -> None:
    """Write Figures 7 to 9 beside the paper's, the claims judged, and all schemes compared.

    Markdown, CSV and LaTeX go to results/tables/, what paper.tex cites to paper/generated/. A
    picture that is wrong, or failed against POV-Ray, is left out and named in red.
    """
    with _one_line_errors():
        outputs.tables(study, results)
        outputs.accuracy(results)
        outputs.bench(results)
        outputs.scale(results)
        outputs.micro(results)
        outputs.publish(publish, results)


@_command
def plots(study: StudyName = "paper", publish: Publish = False, results: Results = RESULTS) -> None:
    """Draw what has been measured: times over d:h, heat maps, schemes compared, cost pictures.

    SVG and PNG go to results/plots/.
    """
    with _one_line_errors():
        outputs.plots(study, results)
        outputs.publish(publish, results)


@_command
def oracle(
    model: Model,
    more: More = None,
    pixel: Annotated[
        str | None, typer.Option(help="x,y from the top left; the middle without any.")
    ] = None,
    scheme: Annotated[
        str | None, typer.Option(help="Whose answer is judged; every exact scheme's without.")
    ] = None,
    settings: Settings = None,
    size: Size = "512x512",
) -> None:
    """Explain one ray in exact arithmetic: every crossing, the solid between them, and what each
    exact scheme answered.

    A verdict is "agree"; "excused" where rounding may decide (gap: two crossings closer than the
    tie band; grazing: the ray within 4 E of tangent; tie, edge, thin, neighbour, start, end: see
    harness/oracle/judge.py); "flip", a hit instead of a miss or on a wrong boundary; or "wrong
    leaf".

    \b
    csgbench oracle ball --pixel 200,310
    csgbench oracle part.scad --pixel 10,10 --size 64x64
    csgbench oracle ngk --scheme sdsm --set d=5 precision=float32
    """
    with _one_line_errors():
        from harness.oracle.explain import explain
        from harness.schemes import model_and_settings

        match = re.fullmatch(r"(\d+),(\d+)", pixel or "0,0")
        if not match:
            raise UserError(f"pixel '{pixel}' is not of the form x,y, such as 200,310")
        model, settings = model_and_settings([model, *(more or [])], settings or [])
        at = (int(match[1]), int(match[2])) if pixel else None
        explain(out, err, model, at, size=size, scheme=scheme, settings=settings)


@_command
def accuracy(
    seed: Annotated[int, typer.Option(help="Of the random order of the trials.")] = 0,
    publish: Publish = False,
    results: Results = RESULTS,
) -> None:
    """Measure the trade of speed for accuracy: one knob at a time, against the exact scheme and the
    oracle; then its tables and plots, to results/accuracy/.

    The settings are those of harness/sweeps/accuracy.toml: precision, torus solver, tie band,
    shadow rule, segments of a mesh, tolerance of sphere tracing, size of the picture. About 30
    minutes on two cores. What is measured already is kept.

    \b
    csgbench accuracy
    csgbench oracle ngk --pixel 200,310      one ray in exact arithmetic
    """
    with _one_line_errors():
        from harness.accuracy import settings
        from harness.report import load_study
        from harness.store import Store

        failed = _measure(settings.NAME, seed, False, results)
        planned, store = load_study(settings.NAME), Store(results / STORE)
        settings.measure_missing(out, planned, store)
        outputs.accuracy(results)
        outputs.publish(publish, results)
        if failed:
            raise typer.Exit(1)


@_command
def stability(
    names: Annotated[list[str] | None, typer.Argument(help="Rows: X1 X7 povray.")] = None,
    rays: Annotated[
        int,
        typer.Option(
            min=0,
            help="For each row; but never fewer than in the tests, as some rows need many, nor "
            "more than the row's full number.",
        ),
    ] = 1_000_000,
    publish: Publish = False,
    results: Results = RESULTS,
) -> None:
    """Test numerical stability at the extremes: rows X1 to X18, each with its bar.

    X18 plants twenty bugs and asks whether the other rows notice; it compiles for each. Rows named
    are run; without any, those that this code has not been through yet, which takes about an hour.
    `povray` asks POV-Ray the same. A bar that is not met is red, with its cause, and makes the exit
    code 1.

    \b
    csgbench stability
    csgbench stability X3 X7 --rays 10000000
    """
    with _one_line_errors():
        from harness.stability import report

        report.run(out, names or [], rays, results)
        outcome = report.load(results)
        out.print(f"stability: {report.write(outcome, results)}")
        for line in outcome.red:
            err.print(f"red: {line}", style="red", markup=False)
        outputs.publish(publish, results)
        if outcome.red:
            raise typer.Exit(1)


@_command
def scale(
    seed: Annotated[int, typer.Option(help="Of the random order of the trials.")] = 0,
    publish: Publish = False,
    results: Results = RESULTS,
) -> None:
    """Measure how build, memory and rays grow with the model, from 10³ to 10⁶ halfspaces; and what
    a lazy octree saves. Then its tables and plots, to results/scale/.

    Every scheme is measured on both families, ball and ngk, at each size for as long as it
    finishes: one that took too long or ran out of memory is not tried on a larger model, and the
    tables say why. Models are made by `python -m generators` the first time, which takes some
    minutes; then about half an hour on two cores. It can be stopped at any moment; the same
    command goes on from there.

    \b
    csgbench scale
    csgbench trace ball@100000 --scheme sdsm --set d=20 h=20 build=lazy -o balls.png
    """
    with _one_line_errors():
        from harness.scale import lazy, plan
        from harness.store import Store

        told = lambda line: out.print(line, highlight=False)  # noqa: E731
        plan.make_models(told)
        for step in range(len(plan.SIZES) * len(plan.FAMILIES)):
            configurations = plan.step(step, Store(results / STORE))
            _measure_all(plan.NAME, configurations, seed, False, results)
        lazy.measure_missing(results, told)
        outputs.scale(results)
        outputs.publish(publish, results)


@_command
def micro(publish: Publish = False, results: Results = RESULTS) -> None:
    """Time kernels, structures and schemes one by one; `make bench-micro` builds and runs it.

    Tables go to results/tables/micro.md and micro.csv. About two minutes.
    """
    with _one_line_errors():
        from harness import micro as micros

        micros.run(out, results)
        outputs.micro(results)
        outputs.publish(publish, results)


def _measure(study: str, seed: int, retry: bool, folder: Path) -> bool:
    """Every trial of a study that has no row yet. Whether any failed."""
    from harness.report import load_study

    planned = load_study(study)
    return _measure_all(planned.name, planned.configurations, seed, retry, folder)


def _measure_all(
    study: str, configurations: Sequence[Configuration], seed: int, retry: bool, folder: Path
) -> bool:
    from harness import machine, progress, trials
    from harness import sweep as sweeps
    from harness.store import Store

    store = Store(folder / STORE)
    with store.alone(), progress.Report(out) as shown:
        session = machine.session(study, seed)
        store.add_session(session)
        sweeps.sweep(
            configurations, trials.first, store, session.session, shown,
            seed=seed, retry=retry,
        )  # fmt: skip
    counts = ", ".join(f"{n} {status}" for status, n in shown.statuses.items())
    out.print(f"{study}: {counts or 'nothing was left to run'}")
    return bool(shown.statuses.keys() - {"ok", "unsupported"})


def _check(folder: Path, pictures: list[tuple[str, int, int]], **options: bool) -> bool:
    from harness.reference import check
    from harness.store import Store

    return check(out, Store(folder / STORE), pictures, **options)


def main() -> None:
    if sys.argv[1:2] == ["trace"]:  # C++ does not look for Ctrl-C, and there is nothing to keep
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        sys.exit(app(prog_name="csgbench", standalone_mode=False))
    except MISUSE as error:
        where = error.ctx.command_path if error.ctx else "csgbench"
        message = error.format_message().rstrip(".")
        if message:  # else there was no command, and its help was shown
            err.print(f"{where}: {message} (see {where} --help)", style="red", markup=False)
        sys.exit(2)
    except OSError as error:  # help that cannot be written
        err.print(f"csgbench: {error}", style="red", markup=False)
        sys.exit(2)


if __name__ == "__main__":
    main()
