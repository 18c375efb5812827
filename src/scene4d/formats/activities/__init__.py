"""Labelled activities: KPF (MEVA) in, the ActEV JSON that NIST's scorer reads out."""

from scene4d.formats.activities._actev import ActevInstance, actev_json
from scene4d.formats.activities._kpf import LabelledActivity, read_activities

__all__ = ["ActevInstance", "LabelledActivity", "actev_json", "read_activities"]
