"""Calibration of the Re 460's loss chains to published figures."""
