"""What a diagnosis hands over: candidate machine files, judged on motions that they were not fitted to."""
