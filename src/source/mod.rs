//! Volumes that no file holds.
