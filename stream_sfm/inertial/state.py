"""The state that inertia adds to a pose, and the place of each part."""

GRAVITY_M_S2 = 9.81  # anywhere on Earth, within 0.03
# Velocity and gravity in axes of the camera, biases of gyroscope and accelerometer, scale (metres = (1 + scale) of the
# images' lengths), turn of the unit, and time offset.
VELOCITY, GRAVITY, GYRO_BIAS, ACCEL_BIAS = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)
SCALE, AXES, CLOCK = slice(12, 13), slice(13, 16), slice(16, 17)
BIASES, FIXED = slice(6, 12), slice(12, 17)  # fixed errors may be exactly zero
STATE = CLOCK.stop
