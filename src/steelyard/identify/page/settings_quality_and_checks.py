"""Sections of the report on settings, on the quality of the logs, and on findings of the checks."""

from typing import Any

from steelyard.check.findings_text_and_page import diagnosis_dict, findings_of
from steelyard.identify.page.report_content import ReportContent
from steelyard.report.page import Numbers, PageContent, Section


class SettingsSection(
    Section, name="settings", title="Notes and settings", folded=True, template="settings.html"
):
    """What was assumed, and everything that is needed to make the same results again."""

    def numbers(self, content: PageContent) -> Numbers | None:
        """Notes, settings, runs, and hashes of the files."""
        notes = (*content.notes, *content.details)
        origin = content.identified.provenance if isinstance(content, ReportContent) else None
        if origin is not None:
            notes += origin.notes
        elif not content.settings and not notes:
            return None
        shown = tuple(dict.fromkeys(notes))
        return {"settings": content.settings, "origin": origin, "notes": shown}


LETTERS_OF_LONG_VALUE = 80  # from which on it stands below its run


class QualitySection(
    Section, name="quality", title="Data quality", folded=True, template="quality.html"
):
    """Rows, rates, gaps and dropped samples of every run."""

    def numbers(self, content: PageContent) -> Numbers | None:
        """One column per label, one row per run; long values stand below their run."""
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


FEW = 40_000  # most points of all pictures of the evidence together


class CheckSection(Section, name="check", title="Check of the logs", template="findings.html"):
    """The verdict on the logs, and every finding; what is not ok with its picture."""

    def numbers(self, content: ReportContent) -> Numbers | None:
        """The findings, if the logs were checked."""
        if content.diagnosis is None:
            return None
        return findings_of(content.diagnosis, FEW, fine=False)

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """The findings."""
        return {"check": None if content.diagnosis is None else diagnosis_dict(content.diagnosis)}
