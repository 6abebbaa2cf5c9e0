"""What the results depend on: quality of the logs, notes, settings, inputs, version."""

from typing import Any, ClassVar

from steelyard.check.findings_page import findings_of
from steelyard.check.findings_text import diagnosis_dict
from steelyard.identify.page.content import ReportContent
from steelyard.report.page import Numbers, Section, fill


class SettingsSection(Section):
    """What was assumed, and everything that is needed to make the same results again."""

    name: ClassVar[str] = "settings"
    title: ClassVar[str] = "Notes and settings"
    folded: ClassVar[bool] = True

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Notes, settings, runs, and hashes of the files."""
        identified, notes = content.identified, notes_of(content)
        if identified is None and not content.settings and not notes:
            return None
        origin = None if identified is None else identified.provenance
        return {"settings": content.settings, "origin": origin, "notes": notes}

    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""
        return fill("settings.html", numbers)


def notes_of(content: ReportContent) -> tuple[str, ...]:
    """What was decided and assumed, each note once; what a motion does not cover is its verdict."""
    notes = (*content.notes, *content.details)
    if content.identified is not None:
        notes += content.identified.provenance.notes
    if (designed := content.design) is not None:
        notes += tuple(
            note for note in designed.notes if note not in designed.certificate.uncovered
        )
    return tuple(dict.fromkeys(notes))


LETTERS_OF_LONG_VALUE = 80
"""Letters from which on a value stands below its run, over the whole width."""


class QualitySection(Section):
    """Rows, rates, gaps and dropped samples of every run."""

    name: ClassVar[str] = "quality"
    title: ClassVar[str] = "Data quality"
    folded: ClassVar[bool] = True

    def numbers(self, content: ReportContent) -> Numbers | None:
        """One column per label, one row per run; what is long stands below its run.

        Runs may have different labels.
        """
        if not content.qualities:
            return None
        values = [value for _, found in content.qualities for value in found]
        long = dict.fromkeys(label for label, value in values if len(value) > LETTERS_OF_LONG_VALUE)
        labels = [
            label for label in dict.fromkeys(label for label, _ in values) if label not in long
        ]
        return {
            "labels": labels,
            "runs": [
                (
                    run,
                    [dict(found).get(label, "") for label in labels],
                    [(label, value) for label, value in found if label in long],
                )
                for run, found in content.qualities
            ],
        }

    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""
        return fill("quality.html", numbers)


FEW = 40_000
"""Most points of all pictures of the evidence together."""


class CheckSection(Section):
    """The verdict on the logs, and every finding; what is not ok with its picture."""

    name: ClassVar[str] = "check"
    title: ClassVar[str] = "Check of the logs"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """The findings, if the logs were checked."""
        if content.diagnosis is None:
            return None
        return findings_of(content.diagnosis, FEW, fine=False)

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """The findings."""
        return {"check": None if content.diagnosis is None else diagnosis_dict(content.diagnosis)}

    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""
        return fill("findings.html", numbers)
