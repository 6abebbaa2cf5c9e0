"""What the results depend on: notes, settings, inputs, version."""

from typing import ClassVar

from steelyard.report.content import ReportContent
from steelyard.report.html import fill
from steelyard.report.sections.section import Numbers, Section


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
