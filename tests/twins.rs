//! Every shader against its twin, number by number, on random input; on a CPU device bit by bit.
//!
//! `ASHFALL_DEVICE` names another device; where it is no CPU, bounds with their reasons take the
//! place of equal bits.

mod common;
mod random;
mod truth;

#[path = "twins/attenuation.rs"]
mod attenuation;
#[path = "twins/cast.rs"]
mod cast;
#[path = "twins/marching.rs"]
mod marching;
#[path = "twins/probing.rs"]
mod probing;
#[path = "twins/rays.rs"]
mod rays;
#[path = "twins/scene.rs"]
mod scene;
#[path = "twins/spans.rs"]
mod spans;
#[path = "twins/texels.rs"]
mod texels;
#[path = "twins/uploads.rs"]
mod uploads;
#[path = "twins/views.rs"]
mod views;
