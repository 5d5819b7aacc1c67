"""Commands that run jobs: fit, batch and its results, demo."""
