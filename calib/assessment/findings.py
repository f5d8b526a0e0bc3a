"""Named causes as reasons: what was solved for is a note, what was only named keeps a result from being good."""

from boxcal.calib.assessment.limits import sentence
from boxcal.calib.likelihood.finding import Finding
from boxcal.calib.results.verdict import Kind, Level, Reason


def finding_reason(finding: Finding) -> Reason:
    """Return what a finding means for the use of a result.

    One that was solved for, or that the standard deviations allow for, is a note. One that forbids use (``blocks``) is
    redo. Any other is in the data and not in the model: never good.
    """
    text = sentence(finding.text)
    if finding.allowed_for and not finding.adopted and not finding.blocks:
        return Reason(rule=finding.cause, level=Level.GOOD, text=text, kind=Kind.NOTE)
    if finding.adopted and not finding.blocks:
        text = text if "taken into account" in text else sentence(f"{text.rstrip('.')}; taken into account")
        return Reason(rule=finding.cause, level=Level.GOOD, text=text, kind=Kind.NOTE)
    level = Level.REDO if finding.blocks else Level.USABLE
    return Reason(rule=finding.cause, level=level, text=text, advice=sentence(finding.advice))
