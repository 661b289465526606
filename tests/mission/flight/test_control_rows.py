"""What a firmware tells of its control, put together by its own time stamps."""

import numpy as np

from mission.flight.pilot.control_rows import ATTITUDE, MOTION, ControlRows

MS = 1_000_000
LEVEL, STILL = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)


def test_a_row_has_the_setpoints_in_force_in_whichever_order_they_come() -> None:
    rows = ControlRows()
    for k in range(4):
        rows.attitude(20 * k * MS, LEVEL, STILL, (0.1, 0.2, 0.3, 0.4))
        rows.setpoint(ATTITUDE, 20 * k * MS, [0.0] * 7 + [0.1 * k])
    rows.setpoint(MOTION, 35 * MS, list(range(11)))
    found = rows.take(40 * MS)
    assert found is not None
    np.testing.assert_array_equal(found[:, 0], [0, 20 * MS, 40 * MS])
    np.testing.assert_allclose(found[:, 15], [0.0, 0.1, 0.2])
    np.testing.assert_array_equal(found[:, 16:20], [(0.1, 0.2, 0.3, 0.4)] * 3)
    assert np.isnan(found[:2, 20:]).all()
    np.testing.assert_array_equal(found[2, 20:], range(11))
    later = rows.take(60 * MS)
    assert later is not None
    np.testing.assert_allclose(later[:, 15], [0.3])
    assert rows.take(1000 * MS) is None


def test_a_setpoint_that_is_told_no_more_is_in_force_no_more() -> None:
    rows = ControlRows()
    rows.setpoint(ATTITUDE, 0, [0.0] * 7 + [0.5])
    for t_ms in (100, 101):
        rows.attitude(t_ms * MS, LEVEL, STILL, (0.0,) * 4)
    found = rows.take(200 * MS)
    assert found is not None
    np.testing.assert_array_equal(found[:, 15], [0.5, np.nan])
