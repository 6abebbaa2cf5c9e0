"""Steps on a workspace of a simulated arm: what they propose, change, lock and open."""

import json
from base64 import b64decode
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

from app.guided import Finished
from steelyard.app.step import clicked
from steelyard.app.step_check import STEP as CHECK
from steelyard.app.step_check import _name, check_work, passed, reason_of
from steelyard.app.step_identify import STEP as IDENTIFY
from steelyard.app.step_logs import STEP as LOGS
from steelyard.app.step_logs import columns_work, preview_work, roles
from steelyard.app.step_robot import scene_of
from steelyard.app.work_check import _edits, picture_of
from steelyard.app.work_process import finish
from steelyard.base.errors import DataError, SteelyardError
from steelyard.base.progress import silent
from steelyard.check.finding import ComparedHypothesis, Edit, Finding, Fix, Severity
from steelyard.cli.app import app
from steelyard.robot.file.toml_schema import tomllib

pytestmark = pytest.mark.slow

OUT = Path("out.json")  # in the current folder, which is the workspace
EVIL = "<script>document.body.dataset.errors='ran'</script>"


def signals(desk: Finished) -> dict[str, Any]:
    found: dict[str, Any] = tomllib.loads(desk.workspace.robot_text or "")["signals"]
    return found


def table(desk: Finished, **changes: str) -> dict[str, str]:
    """The fields of the table of columns, as its page sends them."""
    rows = LOGS.numbers(desk)["table"]
    form = {"time": rows["time"], "time_unit": rows["time_unit"], "kind": rows["kind"]}
    for k, row in enumerate(rows["rows"]):
        for name in ("position", "unit", "sign", "effort", "effort_unit"):
            form[f"{name}-{k}"] = str(row[name])
    return {**form, **{name.replace("__", "-"): value for name, value in changes.items()}}


def test_the_robot_file_is_that_of_the_command(ready: Finished) -> None:
    done = CliRunner().invoke(
        app,
        ["init", "robot/arm.urdf", "logs/a.csv", "logs/b.csv", "-o", "other.toml", "--no-input"],
    )
    assert done.exit_code == 0, done.output
    assert Path("other.toml").read_text() == ready.workspace.robot_text


def test_a_proposal_that_another_one_followed_is_not_written(ready: Finished) -> None:
    ready.workspace.choose(init=["logs/a.csv"])
    before = ready.workspace.robot_text
    finish("steelyard.app.work_robot:init", {"model": "robot/arm.urdf", "logs": []}, OUT, silent)
    assert "result" in json.loads(OUT.read_text())
    assert ready.workspace.robot_text == before and ready.workspace.untouched
    ready.workspace.write_robot("[robot]\n")
    assert not ready.workspace.untouched


def test_the_scene_has_every_body_with_its_mass(ready: Finished) -> None:
    found = scene_of(ready)
    assert found is not None
    bodies = found.result["bodies"]
    assert [body["parent"] for body in bodies] == [-1, 0, 1]
    assert all(body["mass"] > 0.0 and min(body["ellipsoid"]["half"]) > 0.0 for body in bodies)
    axes = np.array(bodies[0]["ellipsoid"]["axes"]).reshape(3, 3)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert {solid["body"] for solid in found.result["solids"]} == {-1, 0, 1, 2}


def test_a_table_of_denavit_and_hartenberg_is_a_robot(desk: Finished) -> None:
    rows = "0 90 0.1 0\n0.4, 0, 0, 0"
    desk.act("robot", "table", name='a "b"', convention="standard", rows=rows)
    found = scene_of(desk)
    assert found is not None and found.result["name"] == 'a "b"'
    assert len(found.result["joints"]) == 2
    for bad in ("", "1 2 3", "a b c d", "0 0 0 0\n" * 41):
        with pytest.raises(DataError):
            desk.act("robot", "table", name="x", convention="standard", rows=bad)


def test_a_column_a_unit_and_a_sign_are_lines_of_the_robot_file(ready: Finished) -> None:
    before = signals(ready)
    ready.act("logs", "set", **table(ready))
    assert signals(ready) == before, "nothing is written where nothing differs"
    ready.act("logs", "set", **table(ready, position__0="q2", position__1="q1"))
    assert signals(ready)["position"] == ["q2", "q1", "q3"]
    (added,) = (line for line in ready.workspace.last_change if line.startswith("+"))
    assert added.split("#")[0].strip() == '+position = ["q2", "q1", "q3"]'
    ready.act("logs", "set", **table(ready, sign__2="-1"))
    assert signals(ready)["position_sign"] == [1, 1, -1]
    ready.act("logs", "set", **table(ready, unit__1="deg"))
    assert signals(ready)["position_unit"] == ["rad", "deg", "rad"]
    ready.act("logs", "set", **table(ready, sign__2="1"))
    assert "position_sign" not in signals(ready)
    for _ in range(4):
        ready.workspace.undo()
    assert signals(ready) == before


def test_the_curves_are_in_the_declared_reading(ready: Finished) -> None:
    first = ready.done(preview_work(ready, "logs/a.csv")).result
    ready.act("logs", "set", **table(ready, sign__0="-1"))
    turned = ready.done(preview_work(ready, "logs/a.csv")).result
    q, other = (
        np.frombuffer(b64decode(one["motion"]["q"]["bdata"]), "<f4").reshape(-1, 3)
        for one in (first, turned)
    )
    assert np.array_equal(other, q * [-1.0, 1.0, 1.0])
    log = pl.read_csv("logs/a.csv")
    assert first["rows"] == len(log)
    assert q[0] == pytest.approx(log.row(0)[1:4], abs=1e-6)


def test_a_long_log_is_thinned(ready: Finished) -> None:
    count = 90_000
    t = np.arange(count) * 0.001
    columns = {f"q{k}": np.sin(t + k) for k in (1, 2, 3)} | {
        f"tau{k}_Nm": np.cos(t) for k in (1, 2, 3)
    }
    pl.DataFrame({"time_s": t, **columns}).write_csv("logs/long.csv")
    found = ready.done(preview_work(ready, "logs/long.csv")).result
    assert found["rows"] == count
    assert found["duration"] == pytest.approx(t[-1], abs=0.02)
    assert sum(len(figure) for figure in found["figures"]) < 200_000


def test_the_next_step_opens_when_nothing_wrong_is_left(ready: Finished) -> None:
    assert IDENTIFY.locked(ready) and not passed(ready)
    ready.act("logs", "set", **table(ready, position__0="q2", position__1="q1"))
    ready.act("check", "run")
    found = ready.look(check_work(ready)).result
    wrong = [one for one in found["findings"] if one["severity"] == 2]
    assert wrong and all(one["picture"] for one in wrong)
    assert not passed(ready)
    ready.act("check", "accept", finding=_name(wrong[0]))
    assert signals(ready)["position"] == ["q1", "q2", "q3"]
    assert passed(ready) and not IDENTIFY.locked(ready)
    page = ready.page("check")
    assert "Put right by the last fix" in page and "Before: " in page


def test_a_reason_to_go_on_is_kept_in_the_model_and_its_report(ready: Finished) -> None:
    ready.act("logs", "set", **table(ready, position__0="q2", position__1="q1"))
    ready.act("check", "run")
    with pytest.raises(DataError, match="a reason is needed"):
        ready.act("check", "go-on", reason="  no ")
    reason = f"the bench says so {EVIL}"
    ready.act("check", "go-on", reason=reason)
    assert reason_of(ready) == reason and passed(ready)
    ready.act("identify", "run")
    folder = ready.workspace.folder / "models" / "model-1"
    assert reason in json.dumps(json.loads((folder / "model.json").read_text()))
    report = (folder / "report.html").read_text(encoding="utf-8")
    assert "the bench says so &lt;script&gt;" in report and EVIL not in report
    ready.workspace.undo()
    assert not passed(ready), "the reason was for the robot file as it was"


def test_a_model_is_that_of_the_command(ready: Finished) -> None:
    ready.act("check", "run")
    ready.act("identify", "run")
    words = ["identify", "robot.toml", "logs/a.csv", "--validate", "logs/b.csv", "-o", "other"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    for name in ("model.json", "parameters.csv", "report.html"):
        assert Path("other", name).read_bytes() == Path("models/model-1", name).read_bytes()


def test_a_fit_of_which_nothing_is_kept_says_so(ready: Finished) -> None:
    ready.act("check", "run")
    ready.workspace.choose(fit={"folder": "models/model-1", "key": 24 * "0"})
    assert "nothing of it is kept" in ready.page("identify")
    ready.act("identify", "run")
    assert "nothing of it is kept" not in ready.page("identify")
    with Path("logs/a.csv").open("a") as file:
        file.write("\n")
    page = ready.page("identify")
    assert "nothing of it is kept" not in page and "verdict " in page, "it is of the files before"


def test_a_role_goes_with_its_log(ready: Finished) -> None:
    ready.act("logs", "role", log="logs/b.csv", role="out")
    ready.act("logs", "remove", log="logs/b.csv")
    Path("logs/b.csv").write_bytes(Path("logs/a.csv").read_bytes())
    assert roles(ready) == {"logs/a.csv": "fit", "logs/b.csv": "validate"}
    ready.act("logs", "role", log="logs/b.csv", role="validate")
    Path("logs/b.csv").rename("logs/c.csv")
    assert roles(ready) == {"logs/a.csv": "fit", "logs/c.csv": "validate"}


def test_each_log_has_its_role(ready: Finished, arm: Path) -> None:
    names = [f"logs/{letter}.csv" for letter in "abcd"]
    log = pl.read_csv(arm / "b.csv")
    half = len(log) // 2
    for name, start in zip(names[2:], (0, half), strict=True):
        log.slice(start, half).write_csv(name)
    assert [*roles(ready).values()] == ["fit", "fit", "fit", "validate"]
    for name, role in zip(names, ("validate", "out", "loaded", "fit"), strict=True):
        ready.act("logs", "role", log=name, role=role)
    assert check_work(ready).given["logs"] == [names[0], names[3]]
    assert "Mass that the loaded logs carry" in ready.page("logs")
    ready.act("logs", "payload", mass="2.5")
    for mass in ("-1", "nan", "much", "inf"):
        with pytest.raises(DataError, match="positive number"):
            ready.act("logs", "payload", mass=mass)
    ready.act("check", "run")
    ready.act("identify", "run")
    page = ready.page("identify")
    assert "no drive gain is to be identified" in page, "as the command says of these two"
    assert "--loaded" not in page and "“carries a known mass”, step 2" in page
    work = ready.jobs.begun[-1]  # type: ignore[attr-defined]
    assert work.given["logs"] == [names[3]] and work.given["validate"] == [names[0]]
    assert work.given["loaded"] == [names[2]] and work.given["payload_mass"] == 2.5
    ready.act("logs", "role", log=names[2], role="fit")
    ready.act("check", "run")
    ready.act("identify", "run")
    known = json.loads(Path("models/model-1/model.json").read_text())["provenance"]
    assert known["runs"] == ["c", "d"]
    for name in (names[2], names[3]):
        ready.act("logs", "role", log=name, role="out")
    assert "choose a log that fits" in CHECK.locked(ready) and not passed(ready)


def test_a_check_compares_with_a_model(ready: Finished) -> None:
    ready.act("check", "run")
    ready.act("identify", "run")
    ready.act("check", "model", model="models/model-1")
    assert not passed(ready), "it is another check"
    ready.act("check", "run")
    assert passed(ready)
    done = CliRunner().invoke(app, ["check", "robot.toml", "logs/a.csv", "logs/b.csv", "--json",
                                    "--model", "models/model-1"])  # fmt: skip
    told = json.loads(Path("reports/check.json").read_text())
    assert json.loads(done.output) == {**told, "output": None}


def test_options_of_commands_are_named_by_what_to_click() -> None:
    assert clicked("give --model (or --loaded)") == (
        "give “compared with”, step 3 (or “carries a known mass”, step 2)"
    )
    assert clicked("run `steelyard check --model M`") == "run `steelyard check --model M`"


def test_models_are_compared_on_the_log_that_validates(ready: Finished) -> None:
    ready.act("check", "run")
    ready.act("identify", "run")
    ready.act("identify", "run")
    ready.act("identify", "compare", first="models/model-1", second="models/model-2")
    assert Path("reports/compare-model-1-model-2/models.html").exists()
    with pytest.raises(DataError, match="one model"):
        ready.act("identify", "compare", first="models/model-1", second="models/model-1")


def test_names_of_strangers_are_escaped_on_every_page(desk: Finished, arm: Path) -> None:
    folder = desk.workspace.folder
    urdf = (arm / "arm.urdf").read_text()
    escaped = EVIL.replace("<", "&lt;").replace(">", "&gt;").replace("'", "&apos;")
    (folder / "robot" / "arm.urdf").write_text(urdf.replace('"joint1"', f'"{escaped}"'))
    assert escaped in (folder / "robot" / "arm.urdf").read_text()
    log = pl.read_csv(arm / "a.csv")
    log.with_columns(pl.col("q1").alias(EVIL)).write_csv(folder / "logs" / "a.csv")
    desk.act("robot", "added")
    for step in ("robot", "logs", "check"):
        page = desk.page(step)
        assert EVIL not in page
    assert "&lt;script&gt;" in desk.page("robot") and "&lt;script&gt;" in desk.page("logs")


@pytest.mark.parametrize("text", ["not toml [", "[robot]\nurdf = 3\n", "[signals]\nposition = 1\n"])
def test_a_robot_file_that_cannot_be_read_says_so(ready: Finished, text: str) -> None:
    Path("robot.toml").write_text(text)
    for step in ("robot", "logs", "check", "identify"):
        try:
            ready.page(step)
        except SteelyardError as error:
            assert error.fix
    assert "verdict poor" in ready.page("robot")


def test_forms_that_lack_fields_are_refused(ready: Finished) -> None:
    for step, action in (("robot", "choose"), ("robot", "table"), ("logs", "show"), ("logs", "set"),
                         ("logs", "remove"), ("logs", "role"), ("logs", "payload"),
                         ("check", "accept"), ("check", "model"),
                         ("check", "go-on"),
                         ("identify", "show"), ("identify", "compare")):  # fmt: skip
        for form in ({}, {"log": 3}, {"log": "../x", "model": "x", "finding": "x", "first": []}):
            with pytest.raises(SteelyardError):
                ready.act(step, action, **form)


def test_lines_that_were_tried_together_are_written_together() -> None:
    one, other, apart = (Edit(("signals", name), 1) for name in ("a", "b", "c"))

    def found(log: str, edit: Edit, jointly: bool) -> Finding:
        return Finding("check", log, Severity.WRONG, "says", fix=Fix("do", (edit,), jointly))

    every = [found("x", one, True), found("x", other, True), found("x", apart, False)]
    every.append(found("y", apart, True))
    assert _edits(every[0], every) == (one, other)
    assert _edits(every[2], every) == (apart,)
    assert _edits(Finding("check", "x", Severity.OK, "says"), every) == ()


def test_findings_with_the_same_lines_are_accepted_once_and_open_checks_listed(
    ready: Finished,
) -> None:
    ready.act("logs", "set", **table(ready, position__0="q2", position__1="q1"))
    ready.act("check", "run")
    path = ready.workspace.derived(check_work(ready).key(ready.workspace))
    known = json.loads(path.read_text())
    wrong = next(one for one in known["result"]["findings"] if one["edits"])
    told = {"severity": 1, "word": "doubtful", "picture": None}
    no_lines = told | {"edits": [], "lines": "", "fix": "look", "log": "a"}
    known["result"]["findings"] = [
        wrong | {"check": "one", "log": "a"},
        wrong | told | {"check": "other", "log": "b"},
        *(wrong | no_lines | {"check": name} for name in ("third", "fourth")),
        wrong | no_lines | {"check": "fifth", "severity": 0, "word": "open", "says": "cannot tell"},
    ]
    path.write_text(json.dumps(known))
    page = ready.page("check")
    assert page.count("Accept: write") == 1
    assert page.count('aria-label="Lines for the robot file"') == 1
    assert page.count("<b>What to do:</b> look") == 2, "no lines are no same change"
    assert "The same change for the 2 findings above" in page
    assert page.count("Leave as it is") == 4
    assert "1 check left open" in page and "without fault" not in page
    ready.act("check", "leave", finding=_name(wrong | {"check": "other", "log": "b"}))
    page = ready.page("check")
    assert page.count("Accept: write") == 2 and "The same change" not in page


def test_a_finding_without_a_picture_shows_its_hypotheses() -> None:
    rivals = (
        ComparedHypothesis("as declared", 12.0, -30.0, True),
        ComparedHypothesis("b", 4.0, 0.0),
    )
    shown = picture_of(Finding("order", "x", Severity.WRONG, "says", hypotheses=rivals))
    assert shown is not None
    assert [trace.y.tolist() for trace in shown.traces] == [[12.0], [4.0]]
    assert picture_of(Finding("order", "x", Severity.WRONG, "says")) is None


def test_of_very_many_or_very_long_columns_some_are_offered(ready: Finished) -> None:
    Path("logs/wide.csv").write_text(
        ",".join(["x" * 500, *(f"c{k}" for k in range(3000))]) + "\n1\n"
    )
    found = ready.done(columns_work("logs/wide.csv")).result
    assert found["columns"][0] == "c0" and len(found["columns"]) + found["more"] == 3001
    assert len(found["columns"]) <= 1000
