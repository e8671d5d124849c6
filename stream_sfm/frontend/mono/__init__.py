"""One camera: motion and depths without a right image."""
