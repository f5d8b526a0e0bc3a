"""One drive in progress: what was heard, what is estimated, and what follows for the driver."""

from boxcal.calib.guide.drive.live_drive import LiveDrive
from boxcal.calib.guide.estimate.advice import Place, reached
from boxcal.calib.guide.estimate.full_solution import FullSolution
from boxcal.calib.guide.estimate.running import RunningEstimate
from boxcal.calib.guide.estimate.solver import Solver
from boxcal.calib.guide.outlook import GuideOptions, Outlook
from boxcal.target.camera.camera_model import CameraModel


class Progress:
    """One drive in progress.

    Attributes
    ----------
    options
        What was asked for.
    drive, running, outlook
        What was heard, what is estimated, what to report.
    full
        The full calibration, with its verdict.
    problems
        Sentences about what could not be done, by what it was; empty where it could.
    wants
        Which work is to be done as soon as there is time.
    """

    def __init__(self, options: GuideOptions, solver: Solver) -> None:
        self.options = options
        self.drive = LiveDrive(options.robot, options.target, options.settings)
        self.running = RunningEstimate(options.target)
        self.outlook = Outlook()
        self.full = FullSolution(solver)
        self.problems = dict.fromkeys(("recording", "messages", "stop", "estimate", "plan", "copy"), "")
        self.wants = {"advise": True, "solve": False, "judge": False, "calibrate": False}

    @property
    def camera(self) -> CameraModel | None:
        """The camera as known so far: solved for, or with the focal length that the detector found."""
        if self.running.estimate is not None:
            return self.running.estimate.camera
        known, size = self.drive.taken.camera, self.drive.taken.image_size
        if known is None or size is None:
            return None
        f = known.prior.focal_px
        return CameraModel(fu=f, fv=f, cu=(size[0] - 1) / 2, cv=(size[1] - 1) / 2, kr=0.0)

    @property
    def enough(self) -> bool:
        """Whether all goals are reached and the last full calibration of these stops is good."""
        verdict = self.full.verdict
        return (
            reached(self.outlook.bars)
            and verdict.get("level") == "good"
            and verdict.get("stops") == self.drive.stops_taken
            and not self._judging
        )

    @property
    def is_checking(self) -> bool:
        """Whether all goals are reached, and the full calibration of these stops has still to say what it is.

        The driver waits for it then: where it takes longer than to drive to the next stop, it would never be that of
        all stops otherwise.
        """
        return reached(self.outlook.bars) and self._judging

    @property
    def _judging(self) -> bool:
        """Whether the drive as it is has not been judged yet; a nudge changes it at one number of stops."""
        return self.wants["judge"] or not self.full.idle

    @property
    def places(self) -> tuple[Place, ...]:
        """Next stops to drive to; empty while they are not known for the stops so far, or may not be needed."""
        known = self.outlook.placed_after == self.drive.stops_taken
        return self.outlook.places if known and not (self.enough or self.is_checking) else ()
