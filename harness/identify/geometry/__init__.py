"""Calibration: joints and leg offsets from leg lengths and poses."""
