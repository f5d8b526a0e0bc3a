"""A fleet says nothing of where its box stands and how large it is, and what it says of its shape is whole."""

import numpy as np
from robots import TARGET, fleet, hand_made_box, shape_of_box

from boxcal.calib.joint_box.gauge import gauge_free
from boxcal.calib.joint_box.posterior import posterior
from boxcal.calib.joint_box.shape_prior import shape_prior
from boxcal.calib.joint_box.sharpness import landmark_jacobian, ruler, similarities
from boxcal.calib.likelihood import EstimateOptions


def test_what_is_left_of_moves_of_a_shape_is_neither_motion_nor_growth() -> None:
    prior = shape_prior(EstimateOptions(target=TARGET))
    shape = shape_of_box(hand_made_box(0), prior.names)
    free = gauge_free(prior, shape)
    assert round(np.trace(free)) == len(prior.names) - 7
    np.testing.assert_allclose(free @ free, free, rtol=0, atol=1e-9 * np.abs(free).max())
    target = prior.refined(shape, np.zeros((len(shape),) * 2), (), 1)
    left = landmark_jacobian(target, prior.names) @ free
    moves = similarities(target)
    np.testing.assert_allclose(moves.T @ left, 0, atol=1e-7 * np.linalg.norm(moves) * np.linalg.norm(left))


def test_many_robots_do_not_shrink_the_box() -> None:
    """Held noise levels make every robot say that a smaller box fits better; 300 of them would take 0.09 % off."""
    team = fleet([hand_made_box(0)])
    prior = team.prior
    blocks = team.ask(team.first[0].about) * 300
    found = posterior(blocks, prior, prior.usual, estimate_components=False)
    growth = ruler(TARGET, prior.names).growth
    alone = posterior(blocks[:1], prior, prior.usual, estimate_components=False)
    assert abs(growth @ (found.shape - alone.shape)) < 1e-4
    freed = team.first * 300
    assert abs(growth @ (posterior(freed, prior, prior.usual, estimate_components=False).shape - alone.shape)) > 5e-4
