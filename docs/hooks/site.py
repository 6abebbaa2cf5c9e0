"""What the documentation site adds to the pages: the generated reference, and formulas as MathML.

`reference/commands.md` comes from the command line, `reference/keys.md` from the tables of the
robot file, `reference/python.md` from `steelyard.__all__`, `tutorials/notebook.md` from the
notebook. CONTRIBUTING, the changelog and the robot files of `examples/` become pages and files of
the site, so links to them work from disk.
"""

import inspect
import json
import re
from collections.abc import Iterator
from html import unescape
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import notebook
import typer.main
from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from pydantic.fields import FieldInfo

import steelyard
from steelyard.cli.app import app
from steelyard.robot.file.sections import RobotFile
from steelyard.robot.file.toml_schema import Section, meanings_of

ROOT = Path(__file__).parents[2]
NOTEBOOK = ROOT / "docs/tutorials/notebook.ipynb"
PAGES = {"contributing.md": "CONTRIBUTING.md", "changelog.md": "CHANGELOG.md"}
EDGES = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add what is not in `docs/`."""
    pages = {target: (ROOT / source).read_text("utf-8") for target, source in PAGES.items()}
    pages |= {
        "reference/commands.md": commands_page(),
        "reference/keys.md": keys_page(),
        "reference/python.md": python_page(),
        "tutorials/notebook.md": notebook.page(json.loads(NOTEBOOK.read_text("utf-8"))),
    }
    for uri, text in pages.items():
        files.append(File.generated(config, uri, content=text))
    for example in sorted((ROOT / "examples").glob("*.toml")):
        uri = f"examples/{example.name}"
        files.append(File.generated(config, uri, abs_src_path=str(example)))
    return files


def on_page_markdown(markdown: str, page: Any, **_: object) -> str:
    """Links out of `docs/` lead to the pages of the same content."""
    if page.file.src_uri in PAGES:
        return re.sub(
            r"\]\(docs/", "](", re.sub(r"\]\((README.md|examples/?)\)", "](index.md)", markdown)
        )
    for target, source in PAGES.items():
        markdown = markdown.replace(f"](../{source})", f"]({target})")
    return markdown.replace("](../examples/", "](examples/")


def on_page_content(html: str, **_: object) -> str:
    """Formulas as MathML: browsers need no script for them."""

    def drawn(found: re.Match[str]) -> str:
        tex = unescape(found[3])
        return convert(tex, display="block" if found[1] == "div" else "inline")

    pattern = r'<(div|span) class="arithmatex">\\(\(|\[)(.*?)\\[)\]]</\1>'
    return re.sub(pattern, drawn, html, flags=re.S)


def commands_page() -> str:
    """Every command with its arguments and options."""
    lines = ["# Commands", "", "`steelyard COMMAND --help` prints the same.", ""]
    for path, command in _commands("steelyard", typer.main.get_command(app)):
        lines += [f"## {path}", "", *_prose(command.help or "")]
        lines += ["| argument or option | value | meaning | default |", "|---|---|---|---|"]
        lines += [_option(one) for one in command.params if not getattr(one, "hidden", False)]
        lines.append("")
    return "\n".join(lines)


def _commands(path: str, group: Any) -> Iterator[tuple[str, Any]]:
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from _commands(f"{path} {name}", command)
        else:
            yield f"{path} {name}", command


def _prose(text: str) -> list[str]:
    """A command's help; its example is code."""
    shown = []
    for paragraph in inspect.cleandoc(text).split("\n\n"):
        if paragraph.startswith("Example: "):
            example = " ".join(paragraph.removeprefix("Example: ").split())
            shown += ["```sh", example, "```", ""]
        else:
            shown += [_escaped(paragraph), ""]
    return shown


def _option(one: Any) -> str:
    names = ", ".join(f"`{name}`" for name in (*one.opts, *one.secondary_opts))
    names = f"`{one.metavar}`" if one.metavar and not one.opts[0].startswith("-") else names
    flag = getattr(one, "is_flag", False)
    annotation = one.type_descriptor.annotation
    kind = "" if flag else one.metavar or getattr(annotation, "__name__", str(annotation))
    default = (
        "required" if one.required else "" if flag or one.default is None else str(one.default)
    )
    return f"| {names} | {_cell(kind)} | {_cell(one.help or '')} | {_cell(default)} |"


def keys_page() -> str:
    """Every key of every table of the robot file, with type and default."""
    lines = [
        "# Keys of the robot file",
        "",
        "All tables and keys; [The robot file](../robot-file.md)",
    ]
    lines += ["explains them with examples.", ""]
    for path, sections in _tables(RobotFile):
        for section in sections:
            about = inspect.getdoc(section) or ""
            kind = section.model_fields.get("kind")
            chosen = f", kind = {_type(kind.annotation)}" if kind and len(sections) > 1 else ""
            lines += [f"## {path}{chosen}", "", _escaped(about.split("\n\nAttributes:")[0]), ""]
            lines += ["| key | value | default | meaning |", "|---|---|---|---|"]
            meanings = meanings_of(section)
            for name, field in section.model_fields.items():
                cells = (_value(field), _default(field), _cell(meanings[name]))
                lines.append(f"| `{name}` | " + " | ".join(cells) + " |")
            lines.append("")
    return "\n".join(lines)


def _tables(section: type[Section], path: str = "") -> Iterator[tuple[str, list[type[Section]]]]:
    """All tables below a section, with the name that stands in brackets."""
    if path:
        yield f"[{path}]", [section]
    for name, field in section.model_fields.items():
        below, many, named = _sections(field.annotation)
        if not below:
            continue
        inner = f"{path}.{name}".lstrip(".") + (".NAME" if named else "")
        if len(below) > 1:
            yield f"[{inner}]", below
        else:
            first, *rest = _tables(below[0], inner)
            yield (f"[[{inner}]]" if many else first[0]), first[1]
            yield from rest


def _sections(annotation: Any) -> tuple[list[type[Section]], bool, bool]:
    """Tables in a type; whether it is a list of them, and whether a table with names of them."""
    if isinstance(annotation, type) and issubclass(annotation, Section):
        return [annotation], False, False
    origin, found, many, named = get_origin(annotation), [], False, False
    arguments = get_args(annotation)
    for part in arguments[:1] if origin is Annotated else arguments:
        below, inner, also = _sections(part)
        found, many, named = [*found, *below], many or inner, named or also
    return (
        found,
        many or (origin is tuple and bool(found)),
        named or (origin is dict and bool(found)),
    )


def _value(field: FieldInfo) -> str:
    below, many, named = _sections(field.annotation)
    if below:
        return "tables" if many or named else "table"
    edges = [
        f"{sign} {getattr(m, key):g}"
        for m in field.metadata
        for key, sign in EDGES.items()
        if hasattr(m, key)
    ]
    return _cell(", ".join([_type(field.annotation), *edges]))


def _type(annotation: Any) -> str:
    """A type in the words of TOML."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        edges = [
            f"{sign} {getattr(m, key):g}"
            for part in arguments[1:]
            for m in (part, *getattr(part, "metadata", ()))
            for key, sign in EDGES.items()
            if hasattr(m, key)
        ]
        return " ".join([_type(arguments[0]), *dict.fromkeys(edges)])
    if origin is Literal:
        return ", ".join(f'"{a}"' if isinstance(a, str) else str(a) for a in arguments)
    if origin in (Union, UnionType):
        return " or ".join(dict.fromkeys(_type(a) for a in arguments if a is not NoneType))
    if origin is tuple:
        inner = [a for a in arguments if a is not Ellipsis]
        if Ellipsis in arguments:
            return f"list of {_type(inner[0])}"
        return f"{len(inner)} × {_type(inner[0])}"
    if origin is dict:
        return f"table of {_type(arguments[1])} by name"
    return {str: "text", float: "number", int: "whole number", bool: "true or false"}.get(
        annotation, "any"
    )


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    value = field.default
    if value is None or value in ((), {}) or isinstance(value, Section):
        return ""
    shown = (
        str(value).lower()
        if isinstance(value, bool)
        else f'"{value}"'
        if isinstance(value, str)
        else str(value)
    )
    return f"`{shown}`"


def python_page() -> str:
    """Every name of `steelyard`, by mkdocstrings."""
    lines = [
        "# Python interface",
        "",
        "Names of the package `steelyard`; [From Python](../python.md) shows them in use.",
        "",
    ]
    for name in sorted(steelyard.__all__, key=lambda n: (n[0].isupper(), n)):
        thing = getattr(steelyard, name)
        where = f"{thing.__module__}.{thing.__qualname__}" if hasattr(thing, "__qualname__") else ""
        lines += [f"::: {where or f'steelyard.{name}'}", "    options:"]
        lines += [f"      heading: steelyard.{name}", f"      toc_label: {name}", ""]
    return "\n".join(lines)


def _escaped(text: str) -> str:
    return re.sub(r"([<>\[\]])", r"\\\1", text)


def _cell(text: str) -> str:
    return _escaped(" ".join(text.split())).replace("|", "\\|")
