"""Reliability: tests for blunders, minimal detectable blunders, and what they would do to the attitude."""

from .array_reliability import AttitudeReliability, attitude_reliability, filter_reliability
from .linear import FaultShape, LinearModel, filter_model, least_squares_model
from .settings import ReliabilitySettings
from .significance import b_method_limit, b_method_significance, detectable_shift, local_limit

__all__ = [
    "AttitudeReliability",
    "FaultShape",
    "LinearModel",
    "ReliabilitySettings",
    "attitude_reliability",
    "b_method_limit",
    "b_method_significance",
    "detectable_shift",
    "filter_model",
    "filter_reliability",
    "least_squares_model",
    "local_limit",
]
