//! Error against run time: how far a picture is from the truth, and what it cost; and the shared code
//! of benches.

pub mod clock;
pub mod error_metrics;
pub mod sample_price;
pub mod sampler_precision;
