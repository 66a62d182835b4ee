"""Tests of the study gap_diagnosis."""
