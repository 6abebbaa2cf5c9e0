"""What the results depend on: settings, inputs, version."""

from typing import ClassVar

from steelyard.report.content import ReportContent
from steelyard.report.html import fill
from steelyard.report.sections.section import Numbers, Section


class SettingsSection(Section):
    """Everything that is needed to make the same results again."""

    name: ClassVar[str] = "settings"
    title: ClassVar[str] = "Settings and origin"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Settings, runs, and hashes of the files."""
        identified = content.identified
        if identified is None:
            if not content.settings:
                return None
            return {"settings": content.settings, "origin": None, "notes": ()}
        origin = identified.provenance
        notes = [note for note in origin.notes if note not in content.notes]
        return {"settings": content.settings, "origin": origin, "notes": notes}

    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""
        return fill("settings.html", numbers)
