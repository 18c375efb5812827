"""scene4d beside what else there is: ``make bench``, or ``python -m benchmarks``."""
