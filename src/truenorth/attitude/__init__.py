"""From baselines to the attitude of the platform."""
