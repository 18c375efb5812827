"""Measures of error and of probability: functions of arrays, and of a calibration."""
