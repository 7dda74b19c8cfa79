//! Error against run time: how far a picture is from the truth, and what it cost; and the shared code
//! of benches.

pub mod bench_scenes;
pub mod chart;
pub mod clock;
pub mod error_metrics;
pub mod error_time;
pub mod feature_price;
pub mod figures;
pub mod front;
pub mod journal;
pub mod ladder;
pub mod layout_price;
pub mod overhead;
pub mod perceptual;
pub mod reload;
pub mod repeated;
pub mod resident_frames;
pub mod sample_price;
pub mod sampler_precision;
pub mod ssim;
pub mod stability;
pub mod study_chart;
pub mod study_table;
pub mod sweep;
pub mod truth_file;
pub mod upload_price;
