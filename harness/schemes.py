"""The schemes that `tracers` declares, and the reading of parameters against their declarations."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from rich.table import Table

from harness import UserError

Params = dict[str, int | str]
Catalogue = Mapping[str, Any]  # name -> tracers.Scheme


def catalogue() -> Catalogue:
    """Every scheme that is built in, by name, in the order of schemes.def."""
    import tracers

    return {scheme.name: scheme for scheme in tracers.schemes()}


def canonical(params: Params) -> str:
    """The one spelling of a set of parameters: JSON with sorted keys and no blanks."""
    return json.dumps(params, sort_keys=True, separators=(",", ":"))


def complete(known: Catalogue, scheme: str, given: Params) -> Params:
    """`given` checked against what the scheme declares, and filled up with its defaults."""
    if scheme not in known:
        raise UserError(f"unknown scheme '{scheme}'; known: {', '.join(known)}")
    parameters = {parameter.name: parameter for parameter in known[scheme].parameters}
    for name, value in given.items():
        if name not in parameters:
            names = ", ".join(parameters) or "none"
            raise UserError(f"scheme '{scheme}' has no parameter '{name}'; known: {names}")
        _check(scheme, parameters[name], value)
    return {name: given.get(name, parameter.default) for name, parameter in parameters.items()}


def parse_settings(known: Catalogue, scheme: str, settings: list[str]) -> Params:
    """`["d=5", "h=10"]`, as typed on a command line, to parameters of the scheme."""
    given: Params = {}
    for setting in settings:
        name, equals, text = setting.partition("=")
        if not equals:
            raise UserError(f"'{setting}' is not of the form name=value, such as d=5")
        given[name] = int(text) if text.lstrip("-").isdecimal() else text
    return complete(known, scheme, given)


def _check(scheme: str, parameter: Any, value: int | str) -> None:
    where = f"parameter '{parameter.name}' of scheme '{scheme}'"
    if parameter.type == "choice":
        if value not in parameter.choices:
            raise UserError(f"{where} is one of {', '.join(parameter.choices)}, not '{value}'")
    elif not isinstance(value, int) or isinstance(value, bool):
        raise UserError(f"{where} is a whole number, not '{value}'")
    elif not parameter.minimum <= value <= parameter.maximum:
        raise UserError(f"{where} is from {parameter.minimum} to {parameter.maximum}, not {value}")


def describe(known: Catalogue) -> Table:
    """For people: every scheme, and under it its parameters."""
    table = Table(box=None, pad_edge=False)
    for heading in ("scheme", "parameter", "values", "default", "meaning"):
        table.add_column(heading, overflow="fold")
    for scheme in known.values():
        label = scheme.title if scheme.exact else f"{scheme.title} [red](inexact)[/red]"
        table.add_row(f"[bold]{scheme.name}[/bold]", "", "", "", label)
        for parameter in scheme.parameters:
            values = " ".join(parameter.choices) or f"{parameter.minimum}..{parameter.maximum}"
            table.add_row("", parameter.name, values, str(parameter.default), parameter.meaning)
    return table
