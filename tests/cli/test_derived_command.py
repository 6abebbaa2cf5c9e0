"""Commands made from functions: arguments, options, defaults, bounds and help."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner, Result

from steelyard.base.checked_arguments import checked
from steelyard.base.progress import Progress, silent
from steelyard.cli.app import app
from steelyard.cli.commands_from_functions import DerivedCommand, from_function


@checked(mass=0.0)
def weighed(
    model: str | Path,
    logs: str | Path | Iterable[str | Path],
    *,
    mass: float | None = None,
    names: Sequence[str] = (),
    check: bool = True,
    fast: bool = False,
    progress: Progress = silent,
) -> None:
    """Weigh.

    Args:
        model: The model.
        logs: The logs.
        mass: Known mass [kg]; unknown if `None`, see `fast`.
        names: Names
            of `parts`.
        check: Check before.
        fast: Less exact.
        progress: Receives events.
    """


CALLS: list[tuple[dict[str, object], bool]] = []


@from_function(f"{__name__}:weighed", names={"name": "--name"})
def weigh(call: "partial[None]", as_json: bool = False) -> None:
    """Weigh something.

    Example: weigh model log
    """
    CALLS.append((call.keywords, as_json))


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Result]:
    monkeypatch.setenv("COLUMNS", "120")
    alone = typer.Typer()
    alone.command(cls=DerivedCommand)(weigh)
    return lambda *words: CliRunner().invoke(alone, words)


def test_arguments_and_defaults_are_those_of_the_function(run: Callable[..., Result]) -> None:
    CALLS.clear()
    assert run("arm", "a.csv", "b.csv").exit_code == 0
    rest = {"mass": None, "check": True, "fast": False}
    assert CALLS == [({"model": "arm", "logs": ["a.csv", "b.csv"], **rest}, False)]
    run("arm", "a.csv", "--mass", "2", "--no-check", "--fast", "--name", "x", "--json")
    given, as_json = CALLS[1]
    assert as_json and given["names"] == ["x"] and given["mass"] == 2.0
    assert given["fast"] is True and given["check"] is False


def test_bounds_and_help_are_those_of_the_function(run: Callable[..., Result]) -> None:
    wrong = run("arm", "a.csv", "--mass", "-1")
    assert wrong.exit_code == 2 and "--mass" in wrong.output
    text = " ".join(run("--help").output.split())
    assert "Known mass in kg; unknown if unset, see --fast." in text and "KG" in text
    assert "Names of parts." in text and "Example: weigh model log" in text
    assert "--check" not in text and "--no-fast" not in text and "--progress" not in text


@pytest.mark.slow
def test_help_has_no_words_of_python() -> None:
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    derived = [one for one in commands.values() if isinstance(one, DerivedCommand)]
    texts = {f"{one.name} {p.name}": p.help for one in derived for p in one.params}
    assert len(derived) >= 14 and all(texts.values())
    assert [name for name, text in texts.items() if "None" in text or "[" in text] == []
