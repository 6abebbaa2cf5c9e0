"""What was written, and how to run it: slowly first."""

from __future__ import annotations

from typing import ClassVar

from steelyard.report.content import ReportContent
from steelyard.report.html import fill
from steelyard.report.sections.section import Numbers, Section


class DesignRunSection(Section):
    """Files and commands."""

    name: ClassVar[str] = "design-run"
    title: ClassVar[str] = "Run it"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Files, and whether the motion may be run."""
        designed = content.design
        if designed is None:
            return None
        return {
            "safe": designed.certificate.holds,
            "files": content.files,
            "seconds": f"{designed.trajectory.duration:.4g} s",
            "slow": f"{5.0 * designed.trajectory.duration:.4g} s",
        }

    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""
        return fill("design_run.html", numbers)
