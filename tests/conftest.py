"""For all tests: hypothesis draws the same examples each time and has no clock."""

from hypothesis import HealthCheck, settings

settings.register_profile(
    "palpate", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("palpate")
