"""The step of use: what a model tells of logs, as the commands do, and its exports."""

from pathlib import Path
from typing import Any, get_args

import pytest
from typer.testing import CliRunner

from app.guided import Finished
from steelyard.app import work_use
from steelyard.app.step_use import FORMATS, USES
from steelyard.app.steps import named
from steelyard.base.errors import DataError, SteelyardError
from steelyard.cli.app import app
from steelyard.export.code.export_code import CodeFormat

pytestmark = pytest.mark.slow


@pytest.fixture
def model(ready: Finished) -> Finished:
    """A desk on a workspace with a model, and a log that it was not identified from."""
    ready.act("check", "run")
    ready.act("identify", "run")
    log = ready.workspace.folder / "used-logs" / "shift.csv"
    log.parent.mkdir()
    log.write_bytes((ready.workspace.folder / "logs" / "b.csv").read_bytes())
    ready.act("use", "added")
    return ready


def form(**changes: str) -> dict[str, str]:
    """The fields of a use, as its page sends them; the dropped log is the first."""
    usual = {"what": "contact", "model": "models/model-1", "frame": ""}
    return {**usual, "log-0": "used-logs/shift.csv", **changes}


def command(*words: str) -> None:
    done = CliRunner().invoke(app, [*words])
    assert done.exit_code == 0, done.output


def numbers(desk: Finished) -> Any:
    return named("use").numbers(desk)


def test_uses_and_formats_are_those_that_are_done() -> None:
    assert USES.keys() == work_use.USES.keys()
    assert {*FORMATS} == {"urdf", "mjcf", *get_args(CodeFormat)}


def test_it_is_locked_without_a_model(ready: Finished) -> None:
    assert named("use").locked(ready)
    for action in ("use", "export"):
        with pytest.raises(SteelyardError):
            ready.act("use", action, **form(to="c", original=""))


def test_every_use_writes_what_its_command_writes(model: Finished) -> None:
    assert numbers(model)["ticked"] == ["used-logs/shift.csv"]
    assert "used-logs/shift.csv" not in model.workspace.logs, "no fit takes it"
    log = "used-logs/shift.csv"
    for what, words in (
        ("payload", ("payload",)),
        ("payload-events", ("payload", "--when")),
        ("contact", ("contact",)),
        ("wrench", ("wrench",)),
        ("health", ("health",)),
    ):
        model.act("use", "use", **form(what=what))
        found = numbers(model)["used"]
        assert found.error is None and found.result["text"], what
        command(words[0], "models/model-1", log, *words[1:], "-o", f"same-{what}")
        names = {path.name for path in Path(f"same-{what}").iterdir()}
        assert names == {path.name for path in Path(f"reports/{what}-1").iterdir()}
        for name in names:
            same, own = Path(f"same-{what}", name), Path(f"reports/{what}-1", name)
            assert own.read_bytes() == same.read_bytes(), own
        shown = model.page("use")
        assert (f'src="/report/reports/{what}-1/report.html"' in shown) == ("report.html" in names)
        assert f'href="/download/reports/{what}-1/{min(names)}"' in shown
    assert len(numbers(model)["earlier"]) == len(USES)


def test_every_export_writes_what_its_command_writes(model: Finished) -> None:
    for to, (_, ending) in FORMATS.items():
        model.act("use", "export", model="models/model-1", to=to, original="")
        assert numbers(model)["written"].error is None, to
        own, same = Path(f"exports/model-1{ending}"), Path(f"same{ending}")
        command("export", "models/model-1", "--to", to, "-o", str(same))
        if to != "fmu":  # it is built by a compiler
            files = [own] if own.is_file() else sorted(p for p in own.rglob("*") if p.is_file())
            for file in files:
                other = same if own.is_file() else same / file.relative_to(own)
                assert file.read_bytes() == other.read_bytes(), file
    again = {"model": "models/model-1", "to": "urdf"}
    model.act("use", "export", **again, original="robot/arm.urdf")
    assert numbers(model)["written"].result["path"] == "exports/model-1-1.urdf"
    assert "small arm" in Path("exports/model-1-1.urdf").read_text()
    page = model.page("use")
    assert 'href="/download/exports/model-1-c"' in page
    assert 'value="robot/arm.urdf" selected' in page, "what was exported stays chosen"


def test_what_a_use_does_not_take_is_refused(model: Finished) -> None:
    two = {"log-1": "logs/a.csv"}
    for given in (
        form(**two),
        form(what="wrench", **two),
        form(what="payload", **{"log-0": ""}),
        form(what="health", **{"free-1": "logs/a.csv"}),
        form(what="contact", frame="link3"),
        form(what="weld"),
        form(model="../model"),
    ):
        with pytest.raises(DataError):
            model.act("use", "use", **given)
    with pytest.raises(DataError, match="a copy of a URDF"):
        model.act("use", "export", model="models/model-1", to="c", original="robot/arm.urdf")
    assert not list(Path("reports").glob("contact-*")) and not Path("exports").exists()
    model.act("use", "use", **form(what="wrench", frame="<script>"))
    assert numbers(model)["used"].error is not None
    assert "<script>" not in model.page("use")
