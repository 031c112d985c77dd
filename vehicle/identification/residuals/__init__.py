"""Whitened residuals of logs against a model: innovations, weights and the noise floor."""
