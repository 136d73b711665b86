"""Reliability: tests for blunders, minimal detectable blunders, and what they would do to the attitude."""

from .adaptation import Adaptation, Outcome, adapt_model
from .array_adaptation import AttitudeAdaptation, adapt_attitude
from .array_reliability import AttitudeReliability, attitude_reliability, filter_reliability
from .events import adaptation_events, phase_events, protection_events, reliability_events
from .linear import FaultShape, LinearModel, filter_model, least_squares_model
from .phase_reliability import PhaseReliability, phase_model, phase_reliability
from .protection import ProtectionState, multiple_fault_risk, protection_level
from .settings import ReliabilitySettings
from .significance import b_method_limit, b_method_significance, detectable_shift, local_limit

__all__ = [
    "Adaptation",
    "AttitudeAdaptation",
    "AttitudeReliability",
    "FaultShape",
    "LinearModel",
    "Outcome",
    "PhaseReliability",
    "ProtectionState",
    "ReliabilitySettings",
    "adapt_attitude",
    "adapt_model",
    "adaptation_events",
    "attitude_reliability",
    "b_method_limit",
    "b_method_significance",
    "detectable_shift",
    "filter_model",
    "filter_reliability",
    "least_squares_model",
    "local_limit",
    "multiple_fault_risk",
    "phase_events",
    "phase_model",
    "phase_reliability",
    "protection_events",
    "protection_level",
    "reliability_events",
]
