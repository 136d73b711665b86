"""Reliability: tests for blunders, minimal detectable blunders, and what they would do to the attitude."""

from .adaptation import Adaptation, Outcome, adapt_model
from .array_adaptation import AttitudeAdaptation, adapt_attitude
from .array_reliability import AttitudeReliability, attitude_reliability, filter_reliability
from .linear import FaultShape, LinearModel, filter_model, least_squares_model
from .settings import ReliabilitySettings
from .significance import b_method_limit, b_method_significance, detectable_shift, local_limit

__all__ = [
    "Adaptation",
    "AttitudeAdaptation",
    "AttitudeReliability",
    "FaultShape",
    "LinearModel",
    "Outcome",
    "ReliabilitySettings",
    "adapt_attitude",
    "adapt_model",
    "attitude_reliability",
    "b_method_limit",
    "b_method_significance",
    "detectable_shift",
    "filter_model",
    "filter_reliability",
    "least_squares_model",
    "local_limit",
]
