"""The default estimator: all motions of a sliding window together, with a joint camera-centred prior."""
