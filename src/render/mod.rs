//! The plan, the frame, statistics: how a scene becomes pictures on a device.
//!
//! [`Plan`] lists every object, pass, variant and byte; [`Renderer`] builds exactly that and draws
//! views; `frame` tells one tile's frame as a story.

mod frame;
mod image_layout;
mod macrocells;
pub mod paging;
mod plan;
mod plan_images;
mod plan_objects;
mod plan_text;
mod planned_layout;
mod renderer;
mod sample_rates;
mod scene_change;
mod scene_data;
mod settings;
mod srgb;
mod statistics;
mod stereo;
mod submit_bound;
mod tracing;
mod transfer_segments;
mod upload;
mod view_pixels;
mod volume_data;
mod wall_picture;

pub use image_layout::{Layout, LayoutChoice, TexelLayout};
pub use plan::{Plan, PlannedBuffer, PlannedImage, PlannedPass};
pub use planned_layout::{LayoutCost, LayoutMeter, LayoutPrices, PlannedLayout, QUADS_PRICE_MAX};
pub use renderer::{Picture, Renderer};
pub use scene_change::{NextScene, SceneChange};
pub use scene_data::SceneData;
pub use settings::{Addressing, Settings};
pub use srgb::{srgb_byte, srgb_bytes};
pub use statistics::{PassTime, Statistics, Unfinished, peak_rss_bytes};
pub use stereo::StereoLayout;
pub use transfer_segments::{classify_constant, open_both_ends, transfer_segments};
pub use upload::upload;
pub use volume_data::{VolumeData, check_memory};
