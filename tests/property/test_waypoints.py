"""Any route through any waypoints keeps its limits and has no gaps."""

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from truenorth.errors import ConfigError
from truenorth.simulation.motion import Stop, WaypointMotion, build_trajectory

POINT = st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))


@given(
    st.lists(POINT, min_size=3, max_size=9),
    st.floats(0.7, 3.5),
    st.floats(0.3, 100.0),
    st.floats(0.5, 3.0),
    st.booleans(),
)
def test_limits_hold_on_any_route(points, log_scale, radius_m, acceleration, closed):
    scale = 10.0**log_scale
    try:
        section = WaypointMotion(
            points_m=tuple((scale * east, scale * north) for east, north in points),
            speed_mps=np.sqrt(scale),
            acceleration_mps2=acceleration,
            corner_radius_m=radius_m,
            stops=(Stop(waypoint=1, duration_s=4.0),),
            closed=closed,
        )
    except ConfigError:
        assume(False)
    moving = build_trajectory(
        section, latitude_rad=0.8, longitude_rad=0.2, height_m=100.0, duration_s=200.0, seed=1
    )
    step = 0.05
    time_s = np.arange(-2.0, 202.0, step)
    motion = moving.at(time_s)
    speed = np.linalg.norm(motion.velocity_ecef_mps, axis=1)
    along, across, _ = np.einsum("nji,nj->in", motion.rot_ecef_from_body, motion.acceleration_ecef_mps2)
    assert np.max(speed) < section.speed_mps * 1.0001
    # The planned law keeps the limit along exactly; across the plan leaves a tenth for what smoothing does.
    assert np.max(np.abs(along)) < acceleration * 1.005
    assert np.max(np.abs(across)) < section.lateral_acceleration_mps2 * 1.05
    way = moving.distance_m(time_s)
    travelled = np.concatenate([[0.0], np.cumsum(0.5 * step * (speed[1:] + speed[:-1]))])
    # The trapezoid's own error is the step squared over 12 times the change of the acceleration.
    assert np.max(np.abs(way - way[0] - travelled)) < 1e-3 * acceleration + 1e-5 * way[-1]
    # A step in the path or in the law would show as a rate that belongs to no curvature.
    assert np.all(np.isfinite(motion.rate_body_radps))
    leap = np.linalg.norm(np.diff(motion.position_ecef_m, axis=0), axis=1)
    assert np.max(leap) < section.speed_mps * step * 1.001
