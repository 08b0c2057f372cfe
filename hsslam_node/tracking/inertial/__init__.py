"""An IMU predicts rotations of the camera and measures gravity; tracked rotations calibrate its gyroscope."""
