"""What is tried on a data set: calibrations of its footage, and searches for its activities."""
