"""Numbers at an end of their range."""

import numpy as np

from inverse.diagnosis.limits import at_limit


def test_only_what_a_better_fit_lies_beyond_is_at_its_limit():
    lower, upper = np.array([0.0, 0.0, 0.0, -1.0, -1.0, 0.0]), np.array([np.inf, 1.0, 1.0, 1.0, 1.0, 1e-2])
    value = np.array([1e-4, 1e-4, 0.9995, 0.9995, 0.5, 5e-4])
    gradient = np.array([1.0, -1.0, -1.0, 1.0, -1.0, 1.0])
    # The last one is a twentieth of its range away from its end.
    np.testing.assert_array_equal(at_limit(value, lower, upper, gradient), [True, False, True, False, False, False])
