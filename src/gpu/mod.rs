//! The ground floor: instance, device, roles, time points, memory, shader variants, barriers.
//!
//! Knows no volumes. The only room with `unsafe`; each block says why it is sound.
//!
//! # Invariants
//! - A buffer or image dropped while the GPU still uses it is kept until that use has ended: every
//!   submit stamps what it touches with its time point, and dropping retires by time point.
//! - Host reads and writes of mapped memory wait for the time points stamped on it; a [`Ring`]'s writes
//!   for those of the bytes they overwrite.
//! - Every barrier is made by [`Recorder`] from declared accesses; nobody else records one.
//! - Images live in the layout GENERAL: an atlas is written by one role while the other reads it, so
//!   there is no moment at which a layout could change.
#![allow(unsafe_code)]

mod access;
mod calibration;
mod census;
mod copies;
mod device;
mod device_facts;
mod dispatch;
mod features;
mod instance;
mod memory;
mod misuse;
mod pipeline;
mod record;
mod recorder;
mod reflection;
mod resources;
mod retirement;
mod ring;
mod roles;
mod shader;
mod staging;
mod timestamps;
mod topology;
mod turns;
pub mod two_queues;
#[cfg(feature = "viewer")]
mod window;
#[cfg(feature = "viewer")]
mod window_picture;
#[cfg(feature = "viewer")]
mod windows;
mod write_commands;

pub use access::{Access, Barrier, Tracker};
pub use calibration::{Calibration, DeviceClock};
pub use census::{Census, ObjectKind};
pub use copies::{BufferRegion, ImageRegion};
pub use device::{DeviceRequest, Gpu};
pub use device_facts::{DeviceFacts, QueueFacts};
pub use dispatch::Dispatch;
pub use instance::{Instance, Message, Validation};
pub use memory::{Ledger, LedgerEntry, MemoryHome};
pub use pipeline::{ComputePipeline, ObjectsOfPipeline};
pub use record::{HostEvent, Record, SlotEvent, StepKind, StepRecord, Submitted};
pub use recorder::Recorder;
pub use reflection::{Binding, BindingKind, Member, Reflection};
pub use resources::{Buffer, BufferSpec, Image, ImageFormat, ImageSpec, Sampler, SamplerFilter};
pub use ring::Ring;
pub use roles::{RoleKind, TimePoint};
pub use shader::{Shader, ShaderCompiler, ShaderSources, Variant};
pub use staging::{Place, Staging};
pub use timestamps::{StepTicks, SubmitTimes, Timestamps};
pub use topology::QueueTopology;
pub use turns::Turn;
#[cfg(feature = "viewer")]
pub use window::WindowSurface;
#[cfg(feature = "viewer")]
pub use windows::{EguiAllocator, Windows};
