"""What cannot be known: hidden by structure, or not shown by these data."""

from typing import ClassVar

from steelyard.report.content import ReportContent
from steelyard.report.html import fill
from steelyard.report.sections.section import Numbers, Section
from steelyard.robot.inertia import INERTIAL_NAMES


class UnseenSection(Section):
    """Parameters that no motion shows, and those that these motions do not show."""

    name: ClassVar[str] = "unseen"
    title: ClassVar[str] = "Parameters that are not identifiable"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Names, and what each is tied to."""
        if content.identified is None:
            return None
        base, robot = content.identified.base, content.identified.model.robot
        frames = [f"{n}.{b.name}" for n in INERTIAL_NAMES for b in robot.bodies if b.massless]
        return {
            "hidden": [n for k in base.unseen if (n := base.names[k]) not in frames],
            "grouped": [base.names[k] for k in base.dependent],
            "standard": len([name for name in base.names if name not in frames]),
            "base": len(base),
            "blind": content.identified.estimate.blind,
        }

    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""
        return fill("unseen.html", numbers)
