//! The truth: the picture's defining integral in f64 on the CPU, to a stated tolerance.
//!
//! A ray is cut at every place where the integrand is not smooth: the planes of voxel centres and
//! the faces of the voxel boxes, of every volume, and within a cell where a channel's value crosses
//! a point of its transfer function. Between two cuts every value is a cubic in the ray parameter,
//! so the optical depth is integrated exactly, as a polynomial, and the colour by Gauss-Legendre
//! rules with adaptive halving.
//!
//! It stands apart so that it shares no clever part with a shader or a twin: it knows no step, no
//! brick, no early stop and no texture.
//!
//! # Invariants
//! A pixel depends on nothing but view, volumes and tolerance: not on threads or other pixels.
//!
//! A ray that runs exactly within a face between two cells belongs to the cell above it, one that
//! runs within a face of the box to the box when the face is the lower one (voxels are half open).

mod cell;
mod classify;
mod cubic;
mod quadrature;
mod ray;

use std::sync::atomic::{AtomicUsize, Ordering};

use glam::DVec3;

use crate::reference::cell::Grid;
use crate::reference::classify::Classifier;
use crate::reference::ray::{Channel, Ray, Scratch, Volume};
use crate::scene::{self, Part, RayFrame, View};
use crate::volume::VolumeVoxels;

/// How precisely and how fast.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Greatest absolute error of a pixel's components, short of f64 rounding.
    pub tolerance: f64,
    /// Threads that share the rows of the picture, at least 1.
    pub threads: usize,
}

impl Default for Settings {
    /// A tolerance of 1e-9 and as many threads as the machine has.
    fn default() -> Settings {
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        Settings { tolerance: 1e-9, threads }
    }
}

/// A picture in f64.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Linear rgb, the background included, and alpha = 1 - T(end); row 0 on top.
    pub rgba: Vec<[f64; 4]>,
}

/// One level of a volume, integrated as if it were all there is.
#[derive(Clone, Copy)]
pub struct VolumeLevel<'a> {
    /// What the scene says of the volume.
    pub volume: &'a scene::Volume,
    /// Voxels of the level in the scene's order of channels, and their transform.
    pub voxels: &'a VolumeVoxels,
    /// Where the volume ends, in voxels of this level: level 0's size over the level's scale.
    pub extent_voxel: [f64; 3],
}

/// The integral of every pixel of one view, ready to be asked for.
pub struct Truth<'a> {
    pixels: Part,
    background: [f64; 3],
    frame_world: RayFrame,
    frames_voxel: Vec<RayFrame>,
    volumes: Vec<Volume<'a>>,
    tolerance: f64,
}

impl<'a> Truth<'a> {
    /// Prepares the pixels of a picture of `size` pixels. Channel k of a scene volume is drawn with
    /// the voxels of channel k of the [`VolumeVoxels`] beside it, which also bring the transform.
    ///
    /// # Panics
    /// When voxels do not fit the scene or their own size: our own bug, checked on input.
    pub fn new(
        view: &View,
        size: [u32; 2],
        background: [f32; 3],
        volumes: &[(&'a scene::Volume, &'a VolumeVoxels)],
        tolerance: f64,
    ) -> Truth<'a> {
        let level_0 = |&(volume, voxels): &(&'a scene::Volume, &'a VolumeVoxels)| VolumeLevel {
            volume,
            voxels,
            extent_voxel: voxels.size.to_array().map(f64::from),
        };
        let levels: Vec<_> = volumes.iter().map(level_0).collect();
        Truth::of_levels(view, size, background, &levels, tolerance)
    }

    /// As [`Truth::new`], for one level of each volume: what a picture of that level alone
    /// approximates, so that the error of its integration stands apart from that of its level.
    ///
    /// # Panics
    /// As [`Truth::new`].
    pub fn of_levels(
        view: &View,
        size: [u32; 2],
        background: [f32; 3],
        levels: &[VolumeLevel<'a>],
        tolerance: f64,
    ) -> Truth<'a> {
        let frame_world = view.ray_frame_world(size);
        Truth {
            pixels: view.pixels(size),
            background: background.map(f64::from),
            frames_voxel: levels.iter().map(|l| frame_voxel(&frame_world, l.voxels)).collect(),
            frame_world,
            volumes: levels.iter().map(prepared).collect(),
            tolerance: tolerance.max(1e-15),
        }
    }

    /// The pixel at `column` from the left and `row` from the top.
    pub fn pixel(&self, column: u32, row: u32) -> [f64; 4] {
        self.pixel_with(&mut Scratch::default(), column, row)
    }

    /// All pixels. `progress` hears the finished fraction, 0 to 1, from any of the threads.
    pub fn picture(&self, threads: usize, progress: &(dyn Fn(f64) + Sync)) -> Picture {
        let [width, height] = self.pixels.size.map(|edge| edge as usize);
        let (next, done) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let rows_of_one_thread = || {
            let mut scratch = Scratch::default();
            let mut rows = Vec::new();
            loop {
                let row = next.fetch_add(1, Ordering::Relaxed);
                if row >= height {
                    return rows;
                }
                let pixels: Vec<[f64; 4]> = (0..width)
                    .map(|column| self.pixel_with(&mut scratch, column as u32, row as u32))
                    .collect();
                rows.push((row, pixels));
                progress((done.fetch_add(1, Ordering::Relaxed) + 1) as f64 / height as f64);
            }
        };
        let mut rgba = vec![[0.0; 4]; width * height];
        std::thread::scope(|scope| {
            let threads: Vec<_> = (0..threads.clamp(1, height.max(1)))
                .map(|_| scope.spawn(rows_of_one_thread))
                .collect();
            for thread in threads {
                let rows = thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
                for (row, pixels) in rows {
                    rgba[row * width..][..width].copy_from_slice(&pixels);
                }
            }
        });
        Picture { size: self.pixels.size, rgba }
    }

    fn pixel_with(&self, scratch: &mut Scratch, column: u32, row: u32) -> [f64; 4] {
        let [column, row] = [self.pixels.first[0] + column, self.pixels.first[1] + row];
        let (_, direction_world) = self.frame_world.ray(column, row);
        let ray = Ray {
            volumes: &self.volumes,
            length_world: direction_world.length(),
            background_max: self.background.iter().fold(1.0, |most: f64, b| most.max(*b)),
            tolerance: self.tolerance,
        };
        let in_voxels = self.frames_voxel.iter().map(|frame| frame.ray(column, row));
        let (color, depth) = ray.integrate(in_voxels, scratch);
        let transmitted = (-depth).exp();
        let [r, g, b] = std::array::from_fn(|c| color[c] + transmitted * self.background[c]);
        [r, g, b, -(-depth).exp_m1()]
    }
}

/// Renders one view of `size` pixels: see [`Truth::new`] and [`Truth::picture`].
///
/// # Panics
/// As [`Truth::new`].
pub fn render(
    view: &View,
    size: [u32; 2],
    background: [f32; 3],
    volumes: &[(&scene::Volume, &VolumeVoxels)],
    settings: &Settings,
    progress: &(dyn Fn(f64) + Sync),
) -> Picture {
    Truth::new(view, size, background, volumes, settings.tolerance)
        .picture(settings.threads, progress)
}

/// The rays in voxels. The eye is taken relative to the volume's origin before it is rotated and
/// scaled, so that a volume far from the world's origin loses no digits.
fn frame_voxel(frame_world: &RayFrame, voxels: &VolumeVoxels) -> RayFrame {
    let corner_world = voxels.world_from_voxel.point(DVec3::ZERO);
    let mut linear = voxels.world_from_voxel.voxel_from_world();
    linear.translation = DVec3::ZERO;
    RayFrame { origin: frame_world.origin - corner_world, ..*frame_world }.mapped(&linear)
}

fn prepared<'a>(level: &VolumeLevel<'a>) -> Volume<'a> {
    let VolumeLevel { volume: scene, voxels, extent_voxel } = *level;
    assert_eq!(scene.channels.len(), voxels.channels.len(), "voxels for each channel of the scene");
    let channels = scene.channels.iter().zip(&voxels.channels).map(|(channel, values)| {
        let count = voxels.size.voxel_count();
        assert_eq!(values.voxels.len() as u128, count, "voxels that fill the volume");
        Channel {
            voxels: &values.voxels,
            classifier: Classifier::new(channel, values.slope, values.intercept),
        }
    });
    Volume { grid: Grid::new(voxels.size, extent_voxel), channels: channels.collect() }
}
