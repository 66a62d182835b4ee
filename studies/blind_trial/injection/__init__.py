"""Known laws put into real records, so that the motion stays as it was measured: exactly what the axis would have
logged if the law had acted on it, as far as its force can be held over a sample."""
