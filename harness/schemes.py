"""The schemes that `tracers` declares, and the reading of their parameters."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from typing import Any

from rich.table import Table

from harness import UserError

Params = dict[str, int | str]
Catalogue = Mapping[str, Any]  # name -> tracers.Scheme
# Other programs, measured beside the schemes: each parameter with its values, the default first.
PEERS = {"povray": {"bounds": ("operators", "none")}}


def catalogue() -> Catalogue:
    """Every scheme that is built in, by name, in the order of schemes.def."""
    import tracers

    return {scheme.name: scheme for scheme in tracers.schemes()}


def canonical(params: Params) -> str:
    """The one spelling of a set of parameters: JSON with sorted keys and no blanks."""
    return json.dumps(params, sort_keys=True, separators=(",", ":"))


def complete(scheme: str, given: Params) -> Params:
    """`given` checked against what the scheme or peer declares, and filled up with its defaults."""
    if scheme in PEERS:
        return _complete_peer(scheme, given)
    import tracers

    for name, value in given.items():  # True would pass as 1, and C++ has no greater numbers
        if type(value) is not str and (type(value) is not int or abs(value) >= 1 << 63):
            raise UserError(f"{scheme}: parameter '{name}' is {value}, not a whole number or word")
    try:
        return tracers.complete(scheme, given)
    except ValueError as error:
        raise UserError(str(error)) from None


def _complete_peer(peer: str, given: Params) -> Params:
    declared = PEERS[peer]
    for name, value in given.items():
        if value not in declared.get(name, ()):
            known = "; ".join(f"{name}: {', '.join(values)}" for name, values in declared.items())
            raise UserError(f"{peer}: no parameter '{name}' with value {value!r}; known: {known}")
    return {name: values[0] for name, values in declared.items()} | given


def precision(params: Params) -> str:
    """Of the kernels: float64 unless the parameters say otherwise."""
    return str(params.get("precision", "float64"))


def is_exact(scheme: str, params: Params) -> bool:
    """Whether the scheme, so set, promises naive's bits in the same precision: not if one of the
    knobs is turned that are there to measure what the right setting is worth; and no peer does."""
    turned = params.keys() & {"torus", "tie_band", "shadow"}
    return scheme not in PEERS and catalogue()[scheme].exact and not turned


def model_and_settings(words: list[str], settings: list[str]) -> tuple[str, list[str]]:
    """The model among the words of a command line, and all settings: of `--set d=6 h=7 ball` only
    d=6 comes as one."""
    model = next((word for word in words if "=" not in word), words[0])
    at = words.index(model)
    return model, [*settings, *words[:at], *words[at + 1 :]]


def parse_settings(scheme: str, settings: list[str]) -> Params:
    """`["d=5", "h=10"]`, as typed on a command line, to parameters of the scheme."""
    import tracers

    declared = [*catalogue()[scheme].parameters] if scheme in catalogue() else []
    declared += tracers.numerics_parameters()
    words = {p.name for p in declared if p.choices}
    numbers = {p.name for p in declared} - words
    given: Params = {}
    for setting in settings:
        name, equals, text = setting.partition("=")
        if not equals:
            raise UserError(f"'{setting}' is not of the form name=value, such as d=5")
        if name in given:
            raise UserError(f"parameter '{name}' is set twice")
        is_number = name not in words and re.fullmatch(r"[+-]?[0-9]+", text)
        if name in numbers and not is_number:
            hint = "; settings are separated by spaces" if "," in text else ""
            wanted = f"wants a whole number, not '{text}'{hint}"
            raise UserError(f"{scheme}: parameter '{name}' {wanted}")
        given[name] = int(text) if is_number else text
    return complete(scheme, given)


def describe(known: Catalogue) -> Table:
    """For people: every scheme, and under it its parameters."""
    import tracers

    table = Table(box=None, pad_edge=False)
    for heading in ("scheme", "parameter", "values", "default", "meaning"):
        table.add_column(heading, overflow="fold")
    for scheme in known.values():
        label = scheme.title if scheme.exact else f"{scheme.title} [red](inexact)[/red]"
        table.add_row(f"[bold]{scheme.name}[/bold]", "", "", "", label)
        _add_parameters(table, scheme.parameters)
    table.add_row("[bold]and[/bold]", "", "", "", "Common to all exact schemes")
    _add_parameters(table, tracers.numerics_parameters())
    return table


def _add_parameters(table: Table, parameters: Iterable[Any]) -> None:
    for parameter in parameters:
        values = " ".join(parameter.choices) or f"{parameter.minimum}..{parameter.maximum}"
        table.add_row("", parameter.name, values, str(parameter.default), parameter.meaning)
