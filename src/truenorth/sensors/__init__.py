"""Error models of gyro, compass, tilt meter, IMU, turntable accelerometer and odometer.

The simulator draws from these descriptions, and an estimator builds its noise model from the same ones.
"""
