"""Helpers of robots."""


def ensure_safe_goal_position(pairs: dict[str, tuple[float, float]], limits: dict[str, float]) -> dict[str, float]:
    """Limit the distance of goals from present positions, given pairs of goal and present position."""
    assert set(pairs) == set(limits)
    cut = {}
    for name, (goal, present) in pairs.items():
        cut[name] = present + min(max(goal - present, -limits[name]), limits[name])
    return cut
