"""Learned baselines of the paper: codecs, a pose regressor, and a converter of data sets."""
