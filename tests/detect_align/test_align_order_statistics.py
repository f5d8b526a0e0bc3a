"""Order statistics of few figures are numpy's."""

import numpy as np
import pytest

from boxcal.detect.image.order_statistics import median, quantile


@pytest.mark.parametrize("count", [1, 2, 5, 34])
def test_quantiles_are_those_of_numpy(count):
    values = np.random.default_rng(count).normal(size=count)
    assert median(values) == pytest.approx(np.median(values), rel=1e-12)
    for share in (0.0, 0.25, 0.9, 1.0):
        assert quantile(values, share) == pytest.approx(np.quantile(values, share), rel=1e-12)


def test_the_median_of_figures_that_are_not_all_known_is_not_known():
    assert np.isnan(median(np.array([1.0, np.nan, 2.0])))
