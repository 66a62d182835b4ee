"""What a candidate model leaves of the records: filter, innovations, slopes, fit."""
