"""Pictures that used to go wrong, each with its truth; see shared/cases/README.md."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from aligned_views import TARGET, width_px

from boxcal.detect.alignment.detector import detect_tags


@pytest.fixture(scope="module")
def pictures(shared_data: Path) -> Path:
    return shared_data.parent / "cases" / "pictures"


def _seen(folder: Path, name: str):
    """Return what is found, recall of tags wider than 10 px that the truth has, and their normalised errors."""
    truth = json.loads((folder / f"{name}.truth.json").read_text())
    picture = next(p for p in folder.glob(f"{name}.*") if p.suffix in {".png", ".jpg"})
    uv = {int(tag): np.array(corners) for tag, corners in truth.items()}
    wanted = [tag for tag, corners in uv.items() if width_px(corners[None])[0] >= 10]
    tags = detect_tags(cv2.imread(str(picture), cv2.IMREAD_GRAYSCALE), TARGET)
    known = np.isin(tags.ids, wanted)
    errors = tags.corners_px[known] - np.array([uv[int(tag)] for tag in tags.ids[known]])
    normalised = np.linalg.solve(np.linalg.cholesky(tags.cov_px2[known]), errors[..., None])
    return tags, known.sum() / len(wanted), float(normalised.std())


@pytest.mark.parametrize(
    ("name", "least", "most"),
    [
        ("shadow", 1.0, 1.3),
        ("glare", 0.95, 1.3),
        ("wrinkled", 1.0, 1.3),
        ("pixel_aspect_095", 1.0, 1.3),
        ("sheared", 1.0, 1.3),
        ("poster_same_layout", 1.0, 1.35),
        ("motion_3px", 1.0, 1.6),
    ],
)
def test_hard_picture_is_read_as_well_as_by_the_best_peer_and_its_sigmas_hold(pictures, name, least, most):
    _, recall, sigma = _seen(pictures, name)
    assert recall >= least
    assert 0.8 < sigma < most


def test_prints_on_a_wall_are_said_and_the_box_is_taken(pictures):
    tags, _, _ = _seen(pictures, "poster_same_layout")
    assert set(TARGET.tag_faces[tags.ids]) == {1}
    assert tags.contradicting_faces == (0, 2)


def test_faces_that_contradict_each_other_are_not_named_where_there_is_one_box(pictures):
    for name in ("shadow", "wrinkled", "glare"):
        assert _seen(pictures, name)[0].contradicting_faces == ()
