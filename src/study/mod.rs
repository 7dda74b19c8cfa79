//! Error against run time: what the benches and the compare command measure with.

pub mod error_metrics;
