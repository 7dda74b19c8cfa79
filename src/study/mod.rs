//! Error against run time: how far a picture is from the truth, and what it cost; and the shared code
//! of benches.

pub mod bench_scenes;
pub mod chart;
pub mod clock;
pub mod error_metrics;
pub mod overhead;
pub mod reload;
pub mod repeated;
pub mod sample_price;
pub mod sampler_precision;
pub mod stability;
pub mod upload_price;
