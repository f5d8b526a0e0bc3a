"""Picture of a report's first screen: ``make pictures`` writes docs/report.png from the demo, where Chromium is."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
REPORT = ROOT / "demo/calibration/r01/report.html"
OUT = ROOT / "docs/report.png"
SCREEN = "1180,650"
"""Width and height of what is shown, px."""
PROGRAMS = ("chromium", "chromium-browser", "google-chrome")


def main() -> int:
    """Write the picture; returns the exit status."""
    chromium = next((path for name in PROGRAMS if (path := shutil.which(name))), None)
    if chromium is None:
        sys.stderr.write("docs/report.png stays as it is: no Chromium here (apt-get install chromium)\n")
        return 0
    words = [chromium, "--headless", "--hide-scrollbars", "--force-device-scale-factor=1", f"--window-size={SCREEN}"]
    if hasattr(os, "geteuid") and os.geteuid() == 0:  # its sandbox refuses to run as root
        words.append("--no-sandbox")
    OUT.unlink(missing_ok=True)
    subprocess.run([*words, f"--screenshot={OUT}", REPORT.as_uri()], check=True, capture_output=True, timeout=120)
    return 0 if OUT.exists() else 1


if __name__ == "__main__":
    sys.exit(main())
