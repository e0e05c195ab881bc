//! Nothing: its manifest has the features.
