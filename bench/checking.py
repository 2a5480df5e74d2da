"""Plain data against a checked section: all problems at once, each with line, value, and what is allowed."""

import difflib
import types
from collections.abc import Sequence
from typing import TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from bench.errors import InputError, Problem
from bench.toml_file import line_of

SectionT = TypeVar("SectionT", bound=BaseModel)


def check(data: object, kind: type[SectionT], *, file: str, text: str = "") -> SectionT:
    """``data`` as a checked section; InputError lists every problem with its line in ``text``."""
    try:
        return kind.model_validate(data)
    except ValidationError as error:
        raise InputError([_problem(item, kind, file, text) for item in error.errors()]) from None


def _problem(item: ErrorDetails, kind: type[BaseModel], file: str, text: str) -> Problem:
    path = [str(part) for part in item["loc"]]
    owner = _section_at(kind, path[:-1]) or kind
    value = item["input"]
    if item["type"] == "extra_forbidden":
        allowed = _unknown_key(path[-1], list(owner.model_fields))
    elif item["type"] == "missing":
        allowed, value = f"is missing; {_describe(owner, path[-1])}", None
    else:
        about = _describe(owner, path[-1]) if path else ""
        allowed = item["msg"].removeprefix("Value error, ") + (f" ({about})" if about else "")
    if isinstance(value, dict):
        value = None
    return Problem(
        file=file, field=".".join(path) or "file", value=value, allowed=allowed, line=line_of(text, path)
    )


def _unknown_key(key: str, known: Sequence[str]) -> str:
    near = difflib.get_close_matches(key, known, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]}? " if near else ""
    return f"unknown key; {hint}Known here: {', '.join(known)}"


def _describe(owner: type[BaseModel], name: str) -> str:
    field = owner.model_fields.get(name)
    return (field.description or "a table of its own") if field else ""


def _section_at(kind: type[BaseModel], path: Sequence[str]) -> type[BaseModel] | None:
    """The section that ``path`` leads to, through lists and optional values."""
    here: type[BaseModel] | None = kind
    for part in path:
        if here is None:
            return None
        if part in here.model_fields:
            here = _section_in(here.model_fields[part].annotation)
    return here


def _section_in(annotation: object) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    if get_origin(annotation) in (Union, types.UnionType, list):
        return next((found for arg in get_args(annotation) if (found := _section_in(arg))), None)
    return None
