"""The floor plan to tape: a PDF with the drawing, the stops' distances from the box's corners, and what to drive."""

import io
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import escape

from boxcal.calib.plan_drive.drawing import plan_drawing
from boxcal.calib.plan_drive.instructions import CORNERS, taped_stops
from boxcal.calib.planning.next_stops import said
from boxcal.calib.planning.plan import DrivePlan

if TYPE_CHECKING:
    from reportlab.platypus import Flowable, Table

FLOOR_PLAN = "floor-plan.pdf"
_HOW = (
    "Stand the box on the floor. Its corners are named from above, counterclockwise: A between faces 0 and 1, then B, "
    "C and D. For each stop pull two tapes from two corners of the base and mark where their lengths meet, on the side "
    "that the drawing shows; a third is given to check. Tape an arrow there: its angle is counted from the direction "
    "out of face 0, to the left. The robot's point is the floor below the middle of its axle, its front goes with the "
    "arrow. A few centimetres and degrees off do no harm. Stand still for two seconds at every stop."
)


def floor_plan_bytes(plan: DrivePlan) -> bytes:
    """Return the floor plan as a PDF on A4 sheets; the same bytes for the same plan."""
    from reportlab.lib.pagesizes import A4  # noqa: PLC0415 - a command's --help must not wait for it
    from reportlab.lib.styles import getSampleStyleSheet  # noqa: PLC0415
    from reportlab.lib.units import mm  # noqa: PLC0415
    from reportlab.platypus import Paragraph, SimpleDocTemplate, Spacer  # noqa: PLC0415

    buffer, styles = io.BytesIO(), getSampleStyleSheet()
    document = SimpleDocTemplate(
        buffer,
        pagesize=A4,
        leftMargin=18 * mm,
        rightMargin=18 * mm,
        topMargin=15 * mm,
        bottomMargin=15 * mm,
        title=f"Drive plan for {plan.robot.name}",
        author="plan-drive",
        invariant=1,
    )
    space: Any = document.width
    drawing = plan_drawing(plan, space, 0.95 * space)
    promised = "; ".join(f"{bar.label.lower()} {said(bar)}" for bar in plan.bars)
    story: list[Flowable] = [
        Paragraph(f"Drive plan for {escape(plan.robot.name)}", styles["Title"]),
        Paragraph(
            f"{len(plan.stops)} stops, {plan.length:.1f} m, about {plan.seconds / 60:.1f} minutes. With "
            f"{plan.assumptions.said} it promises, one standard deviation: {promised}.",
            styles["BodyText"],
        ),
        drawing,
        Spacer(1, 2 * mm),
        Paragraph(_HOW, styles["BodyText"]),
        Spacer(1, 3 * mm),
        _table(plan, space),
    ]
    document.build(story)
    return buffer.getvalue()


def _table(plan: DrivePlan, width: float) -> "Table":
    from reportlab.lib.colors import HexColor  # noqa: PLC0415
    from reportlab.lib.styles import getSampleStyleSheet  # noqa: PLC0415
    from reportlab.platypus import Paragraph, Table  # noqa: PLC0415

    body = getSampleStyleSheet()["BodyText"]
    head = ["stop", *(f"from {name}" for name in CORNERS), "arrow", "drive"]
    rows: list[list[Any]] = [head]
    for stop in taped_stops(plan):
        off = dict(stop.from_corners)
        cells = [f"{off[name]:.2f} m" if name in off else "" for name in CORNERS]
        rows.append([str(stop.number), *cells, f"{stop.heading_deg:.0f}\N{DEGREE SIGN}", Paragraph(stop.drive, body)])
    fractions = (0.07, 0.1, 0.1, 0.1, 0.1, 0.09, 0.44)
    table = Table(rows, colWidths=[width * s for s in fractions], repeatRows=1)
    table.setStyle(
        [
            ("FONTNAME", (0, 0), (-1, 0), "Helvetica-Bold"),
            ("FONTSIZE", (0, 0), (-1, -1), 9),
            ("VALIGN", (0, 0), (-1, -1), "MIDDLE"),
            ("LINEBELOW", (0, 0), (-1, -1), 0.4, HexColor("#bbbbbb")),
        ]
    )
    return table
