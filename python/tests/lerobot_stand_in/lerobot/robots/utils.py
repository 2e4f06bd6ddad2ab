"""Helpers of robots."""


def ensure_safe_goal_position(pairs: dict[str, tuple[float, float]], limits: dict[str, float]) -> dict[str, float]:
    """Goals no farther from the present positions than these limits, from pairs of goal and present."""
    assert set(pairs) == set(limits)
    cut = {}
    for name, (goal, present) in pairs.items():
        cut[name] = present + min(max(goal - present, -limits[name]), limits[name])
    return cut
