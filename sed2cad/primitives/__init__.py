"""Parametric surfaces: signed distance, normal, projection, chart, fit."""
