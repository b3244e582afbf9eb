"""A study: a TOML file that says what to measure, read strictly into configurations.

    title = "A line for the reader"
    repeats = 5                 # these defaults can stand at the top or in any run:
    width = 512                 #   width, height, repeats, budget_s, timeout_s, shape, threads

    [[runs]]
    models = ["ball"]           # names in models/scenes.toml
    schemes = "hybrid_sdsm"     # one name or several; "others": all that no other run names
    params = [{ d = 5, h = [10, 15], bound = ["root", "all"] }]   # a list means every value

Every model is combined with every scheme and every set of parameters; what a scheme declares
and the study leaves out takes its default. `threads` is a number, "all" the machine has, or a list.

    [[ablations]]               # one configuration, and it with one thing changed at a time
    models = ["ball"]
    scheme = "hybrid_sdsm"
    params = { d = 5, h = 10 }
    [ablations.without]         # what is then missing: the parameters, or the scheme, without it
    "bounds at every node" = { bound = "root" }
    "S-bounds" = { scheme = "sdsm", d = 5, h = 10 }
"""

from __future__ import annotations

import itertools
import os
import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from harness import ROOT, UserError
from harness.schemes import Params, canonical, catalogue, complete

FOLDER = ROOT / "harness" / "sweeps"
SHAPES = ("as_written", "balanced")
OTHERS = "others"
ALL = "all"
# What tells one configuration from another.
KEY = ("model", "scheme", "params", "width", "height", "shape", "threads")


@dataclass(frozen=True)
class Configuration:
    """One thing to measure, `repeats` times."""

    model: str
    scheme: str
    params: str  # canonical JSON
    width: int
    height: int
    shape: str  # how an operator with n children becomes binary
    threads: int
    repeats: int
    budget_s: float  # no further repeat once build and trace times would add up to more
    timeout_s: float  # a single trial is killed after this

    def label(self) -> str:
        """What is shown while it runs: `ngk hybrid_sdsm bound=root d=5 h=10 on 2 threads`."""
        settings = re.sub(r'[{}"]', "", self.params).replace(":", "=").replace(",", " ")
        threads = f"on {self.threads} threads" if self.threads > 1 else ""
        return " ".join(filter(None, (self.model, self.scheme, settings, threads)))


@dataclass(frozen=True)
class Ablation:
    """What each part of a configuration is worth: it, and it without one of them at a time."""

    base: Configuration
    without: dict[str, Configuration]  # by what is missing


@dataclass(frozen=True)
class Study:
    name: str
    title: str
    configurations: tuple[Configuration, ...]
    runs: tuple[Configuration, ...] = ()  # those of [[runs]]; the others are of ablations alone
    ablations: tuple[Ablation, ...] = ()

    @property
    def models(self) -> list[str]:
        return list(dict.fromkeys(c.model for c in self.configurations))

    @property
    def pictures(self) -> list[tuple[str, int, int]]:
        """What is drawn: model, width, height."""
        return list(dict.fromkeys((c.model, c.width, c.height) for c in self.configurations))


# Key, type, default. What bounds time has a default too, so that no study can hang.
_SETTINGS: dict[str, tuple[type, Any]] = {
    "width": (int, 512),
    "height": (int, 512),
    "shape": (str, "as_written"),
    "repeats": (int, 5),
    "budget_s": (float, 60.0),
    "timeout_s": (float, 300.0),
}


def find(name: str) -> Path:
    """The file of a study: a path, or the name of one in harness/sweeps."""
    path = Path(name) if name.endswith(".toml") else FOLDER / f"{name}.toml"
    if not path.is_file():
        known = ", ".join(sorted(file.stem for file in FOLDER.glob("*.toml")))
        raise UserError(f"no study '{name}'; known: {known}, or the path of a .toml file")
    return path


def load(path: Path) -> Study:
    """Read a study; anything wrong is a UserError with the file and the key."""
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except UnicodeDecodeError:
        raise UserError(f"{path}: not a UTF-8 text file") from None
    except tomllib.TOMLDecodeError as error:
        raise UserError(_with_position(path, str(error))) from None

    _only(path, "", document, {"title", "runs", "ablations", "threads", *_SETTINGS})
    defaults = {key: default for key, (_, default) in _SETTINGS.items()}
    defaults |= _settings(path, "", document)
    threads = _threads(path, "", document, [1])
    runs = _tables(path, document, "runs")
    if not runs:
        raise UserError(f"{path}: needs at least one [[runs]]")
    found = _Configurations(path)
    for index, run in enumerate(runs, start=1):
        where = f"runs {index}: "
        _only(path, where, run, {"models", "schemes", "params", "threads", *_SETTINGS})
        settings = defaults | _settings(path, where, run)
        models, schemes = _names(path, where, run, "models"), _names(path, where, run, "schemes")
        if schemes == [OTHERS]:
            named = {name for other in runs for name in _names(path, where, other, "schemes")}
            schemes = [name for name in catalogue() if name not in named]
        for model, scheme, params, count in itertools.product(
            models,
            schemes,
            _parameter_sets(path, where, run),
            _threads(path, where, run, threads),
        ):
            found.add(where, model, scheme, params, settings | {"threads": count})
    listed = found.all()
    ablations = tuple(
        ablation
        for index, table in enumerate(_tables(path, document, "ablations"), start=1)
        for ablation in _ablations(path, f"ablations {index}: ", table, defaults, found)
    )
    return Study(path.stem, str(document.get("title", path.stem)), found.all(), listed, ablations)


class _Configurations:
    """What has been read so far, each configuration once."""

    def __init__(self, path: Path) -> None:
        self._path, self._by_key = path, {}

    def add(self, where: str, model: str, scheme: str, params: Params, settings: dict) -> None:
        configuration = self._made(where, model, scheme, params, settings)
        if self._by_key.setdefault(_key(configuration), configuration) is not configuration:
            raise UserError(f"{self._path}: {where}'{configuration.label()}' is listed twice")

    def find_or_add(self, *of: Any) -> Configuration:
        configuration = self._made(*of)
        return self._by_key.setdefault(_key(configuration), configuration)

    def all(self) -> tuple[Configuration, ...]:
        return tuple(self._by_key.values())

    def _made(
        self, where: str, model: str, scheme: str, params: Params, settings: dict
    ) -> Configuration:
        try:
            return Configuration(model, scheme, canonical(complete(scheme, params)), **settings)
        except UserError as error:
            raise UserError(f"{self._path}: {where}{error}") from None


def _key(configuration: Configuration) -> tuple:
    return tuple(getattr(configuration, name) for name in KEY)


def _ablations(
    path: Path, where: str, table: dict, defaults: dict, found: _Configurations
) -> Iterator[Ablation]:
    """One a model. Another scheme comes with all its parameters; else those that differ do."""
    _only(path, where, table, {"models", "scheme", "params", "without", *_SETTINGS})
    settings = defaults | _settings(path, where, table) | {"threads": 1}
    scheme, params, without = (table.get(key, {}) for key in ("scheme", "params", "without"))
    changes = [*without.values()] if isinstance(without, dict) else [None]
    if type(scheme) is not str or not all(isinstance(given, dict) for given in (params, *changes)):
        raise UserError(
            f"{path}: {where}'scheme' is a name, 'params' a table, 'without' a table of tables"
        )
    for model in _names(path, where, table, "models"):
        base = found.find_or_add(where, model, scheme, params, settings)
        less = {}
        for what, change in without.items():
            other = {key: value for key, value in change.items() if key != "scheme"}
            given = (change["scheme"], other) if "scheme" in change else (scheme, params | other)
            less[what] = found.find_or_add(where, model, *given, settings)
        yield Ablation(base, less)


def _with_position(path: Path, message: str) -> str:
    """tomllib ends its messages with '(at line 3, column 5)'; editors want path:3:5."""
    match = re.fullmatch(r"(.*) \(at line (\d+), column (\d+)\)", message)
    return f"{path}:{match[2]}:{match[3]}: {match[1]}" if match else f"{path}: {message}"


def _tables(path: Path, document: dict, key: str) -> list[dict]:
    tables = document.get(key, [])
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise UserError(f"{path}: '{key}' is written as [[{key}]], at least one")
    return tables


def _only(path: Path, where: str, table: dict, known: set[str]) -> None:
    for key in table:
        if key not in known:
            names = ", ".join(sorted(known))
            raise UserError(f"{path}: {where}unknown key '{key}'; known: {names}")


def _settings(path: Path, where: str, table: dict) -> dict[str, Any]:
    settings = {}
    for key in _SETTINGS.keys() & table.keys():
        value, (kind, _) = table[key], _SETTINGS[key]
        if kind is float and type(value) is int:
            value = float(value)
        if type(value) is not kind or (kind is not str and not value > 0):
            wanted = "a positive number" if kind is not str else "a string"
            raise UserError(f"{path}: {where}'{key}' is {wanted}, not {value!r}")
        settings[key] = value
    if settings.get("shape", SHAPES[0]) not in SHAPES:
        raise UserError(f"{path}: {where}'shape' is one of {', '.join(SHAPES)}")
    return settings


def _threads(path: Path, where: str, table: dict, default: list[int]) -> list[int]:
    """The numbers of threads, each once; on a machine with one core "all" is no other than 1."""
    given = table.get("threads", default)
    counts = [
        os.cpu_count() if n == ALL else n for n in (given if type(given) is list else [given])
    ]
    if not counts or any(type(n) is not int or n < 1 for n in counts):
        raise UserError(f"{path}: {where}'threads' is a positive number, \"{ALL}\", or a list")
    return list(dict.fromkeys(counts))


def _names(path: Path, where: str, run: dict, key: str) -> list[str]:
    value = run.get(key)
    names = [value] if isinstance(value, str) else value
    if not isinstance(names, list) or not names or not all(isinstance(n, str) for n in names):
        raise UserError(f"{path}: {where}'{key}' is a name or a list of names")
    return names


def _parameter_sets(path: Path, where: str, run: dict) -> list[Params]:
    """Each table of `params` stands for the product of its lists."""
    tables = run.get("params", {})
    tables = [tables] if isinstance(tables, dict) else tables
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise UserError(f"{path}: {where}'params' is a table or a list of tables")
    sets: list[Params] = []
    for table in tables:
        axes = [value if isinstance(value, list) else [value] for value in table.values()]
        sets += [dict(zip(table, values, strict=True)) for values in itertools.product(*axes)]
    return sets
