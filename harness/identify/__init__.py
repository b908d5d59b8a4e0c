"""Identification: parameters of a platform from logs, with their uncertainty."""
