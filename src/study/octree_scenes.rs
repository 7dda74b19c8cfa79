//! Scenes of `bench octree`: volumes of residency-octree-2023's table 1 and others like its, each seen in
//! one turn of the camera.
//!
//! As there, several channels of a volume of one are the same voxels under other transfer functions:
//! adjacent windows, so that each channel shows another material. Sixteen channels are such windows of
//! several volumes that were shifted and smoothed, since the paper's of as many channels is not to be had.
//!
//! # Source
//! residency-octree-2023 section 8.

use std::sync::Arc;

use glam::{DQuat, DVec3};
use rayon::prelude::*;

use crate::error::{Error, Exit, Result};
use crate::import::DenseVolume;
use crate::render::{Layout, LayoutChoice, SceneData, VolumeData};
use crate::scene::{Channel, Overrides, Scene, TransferFunction, TransferPoint, View};
use crate::source::BrickSource;
use crate::study::bench_scenes;
use crate::volume::{ChannelVoxels, Size3, VolumeVoxels, Voxels};

/// Opens a scene file by its name.
pub type Load<'a> = &'a dyn Fn(&str) -> Result<SceneData>;

/// A scene by its name in tables, and what it must reach.
#[derive(Clone, Copy, Debug)]
pub struct Case {
    /// In tables and flags.
    pub name: &'static str,
    /// Whether it is made of scene files.
    pub of_files: bool,
    /// Goals of the residency octree against the paper's page table.
    pub goals: Goals,
    make: Make,
}

/// Ratios that are to be reached, where one is set.
#[derive(Clone, Copy, Debug, Default)]
pub struct Goals {
    /// Time of a frame.
    pub time: Option<f64>,
    /// Bricks needed.
    pub bricks: Option<f64>,
    /// What the paper's table 1 says of time.
    pub paper_time: Option<f64>,
    /// What it says of bricks.
    pub paper_bricks: Option<f64>,
    /// Voxels along each axis from which on the goals hold.
    pub edge_min: u32,
}

#[derive(Clone, Copy, Debug)]
enum Make {
    File(&'static str),
    Windows(&'static str),
    SixteenOfFiles,
    FourComputed,
    SixteenComputed,
    Sparse,
    Dense,
}

const NONE: Goals =
    Goals { time: None, bricks: None, paper_time: None, paper_bricks: None, edge_min: 0 };
/// Kingsnake of table 1, with one channel, is what `sparse` stands for.
const SPARSE: Goals = Goals {
    time: Some(0.34),
    bricks: None,
    paper_time: Some(5.1 / 15.0),
    paper_bricks: Some(0.13 / 0.66),
    edge_min: 1024,
};
/// CyCIF Small.
const SIXTEEN: Goals = Goals {
    time: Some(0.75),
    bricks: None,
    paper_time: Some(25.7 / 34.0),
    paper_bricks: Some(0.29 / 0.95),
    edge_min: 0,
};

const fn of_paper(time: f64, bricks: f64) -> Goals {
    Goals { paper_time: Some(time), paper_bricks: Some(bricks), ..NONE }
}

/// Every scene, in the order of the table.
pub const CASES: [Case; 10] = [
    Case {
        name: "aneurism",
        of_files: true,
        goals: of_paper(4.8 / 5.1, 5.7 / 9.3),
        make: Make::File("aneurism"),
    },
    Case {
        name: "aneurism-x4",
        of_files: true,
        goals: of_paper(12.3 / 15.0, 19.9 / 37.3),
        make: Make::Windows("aneurism"),
    },
    Case {
        name: "bonsai",
        of_files: true,
        goals: of_paper(4.6 / 4.7, 7.5 / 14.3),
        make: Make::File("bonsai"),
    },
    Case {
        name: "bonsai-x4",
        of_files: true,
        goals: Goals { time: Some(0.55), bricks: Some(0.27), ..of_paper(6.5 / 11.9, 16.5 / 54.8) },
        make: Make::Windows("bonsai"),
    },
    Case { name: "dna", of_files: true, goals: NONE, make: Make::File("dna_2_channels") },
    Case { name: "files-x16", of_files: true, goals: SIXTEEN, make: Make::SixteenOfFiles },
    Case { name: "computed-x4", of_files: false, goals: NONE, make: Make::FourComputed },
    Case { name: "computed-x16", of_files: false, goals: NONE, make: Make::SixteenComputed },
    Case { name: "sparse", of_files: false, goals: SPARSE, make: Make::Sparse },
    Case {
        name: "dense",
        of_files: false,
        goals: Goals { time: Some(1.03), ..NONE },
        make: Make::Dense,
    },
];

/// How large scenes are.
#[derive(Clone, Copy, Debug)]
pub struct Extent {
    /// Voxels along each axis of what is made in memory; of several channels, a quarter.
    pub edge: u32,
    /// Voxels of a brick along each axis.
    pub payload: u32,
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Views of the turn.
    pub views: u32,
}

/// A scene of which any number of renderers are made.
pub struct TurningScene {
    scene: Scene,
    source: Arc<dyn BrickSource>,
    whole: Arc<VolumeVoxels>,
    payload: u32,
}

/// Scene files that 16 channels are made of, and their materials' bounds.
const FILES: [&str; 3] = ["bonsai", "aneurism", "engine"];
/// More channels are made of the same windows, elsewhere.
const SIXTEEN_CHANNELS: usize = 16;
/// Of scenes of several channels that are made in memory: as many voxels, in all, as a channel of 1024
/// along each axis has in 16 channels.
const CHANNELS_EDGE_SHARE: u32 = 4;

/// Stored values between which materials lie: air beneath the first. Those of files follow the bends of
/// their scenes' transfer functions.
fn bounds(name: &str) -> [f64; 5] {
    match name {
        "bonsai" => [40.0, 76.0, 115.0, 166.0, 255.0],
        "aneurism" => [51.0, 90.0, 140.0, 190.0, 255.0],
        "engine" => [64.0, 110.0, 148.0, 168.0, 255.0],
        _ => [64.0, 112.0, 160.0, 208.0, 255.0],
    }
}

impl Case {
    /// Whether it is drawn with files and without.
    pub fn is_always(&self) -> bool {
        matches!(self.make, Make::Sparse | Make::Dense)
    }

    /// Makes the scene; `load` opens a scene file by its name.
    ///
    /// # Errors
    /// Those of `load`, and when this machine has no memory for it.
    pub fn make(&self, extent: &Extent, load: Load) -> Result<TurningScene> {
        let Extent { edge, payload, size, .. } = *extent;
        let overrides = Overrides { size: Some(size), ..Overrides::default() };
        let part = (edge / CHANNELS_EDGE_SHARE).max(16);
        let computed = || bench_scenes::four_channels(part, payload, &overrides);
        let data = match self.make {
            Make::File(name) => load(name)?,
            Make::Sparse => bench_scenes::sparse(edge, payload, &overrides)?,
            Make::Dense => bench_scenes::dense(edge, payload, &overrides)?,
            Make::FourComputed => computed()?,
            Make::Windows(name) => {
                let data = load(name)?;
                let voxels = data.whole(0)?;
                let bands = (0..4).map(|band| (band, bounds(name)));
                let VolumeVoxels { size, world_from_voxel, .. } = *voxels;
                let channels = vec![voxels.channels[0].clone(); 4];
                let voxels = VolumeVoxels { size, world_from_voxel, channels };
                return TurningScene::windowed(data.scene, voxels, bands, extent);
            }
            Make::SixteenOfFiles => {
                // The third is not everywhere, and as many channels come of two.
                let loaded: Vec<_> = FILES.iter().map(|name| (*name, load(name))).collect();
                let mut volumes = Vec::new();
                for (name, data) in loaded {
                    match data {
                        Err(_) if volumes.len() == 2 => {}
                        data => volumes.push((data?, name)),
                    }
                }
                return sixteen(volumes, extent);
            }
            Make::SixteenComputed => return sixteen(vec![(computed()?, "")], extent),
        };
        TurningScene::new(data.scene.clone(), &data, extent)
    }
}

impl TurningScene {
    fn new(scene: Scene, data: &SceneData, extent: &Extent) -> Result<TurningScene> {
        let whole = data.whole(0)?;
        let volume = &data.volumes[0];
        let description = volume.source.description();
        let all: Vec<u16> = (0..whole.channels.len() as u16).collect();
        let fits = description.payload == Size3::cube(extent.payload)
            && description.channels.len() == all.len()
            && volume.channels == all;
        let source = match fits {
            true => volume.source.clone(),
            false => cut(&scene, &whole, extent.payload),
        };
        Ok(TurningScene { scene, source, whole, payload: extent.payload }.turned(extent))
    }

    /// Every channel through its window of `bands`: which, and the bounds of all.
    fn windowed(
        mut scene: Scene,
        voxels: VolumeVoxels,
        bands: impl Iterator<Item = (usize, [f64; 5])>,
        extent: &Extent,
    ) -> Result<TurningScene> {
        let edge_world = voxels.world_from_voxel.smallest_edge();
        let channel = |(number, (band, bounds))| window_of(number, band, bounds, edge_world);
        scene.volumes[0].channels = bands.enumerate().map(channel).collect::<Result<_>>()?;
        let whole = Arc::new(voxels);
        let source = cut(&scene, &whole, extent.payload);
        Ok(TurningScene { scene, source, whole, payload: extent.payload }.turned(extent))
    }

    fn turned(mut self, extent: &Extent) -> TurningScene {
        let size = self.whole.size.to_array().map(f64::from);
        let centre = self.whole.world_from_voxel.point(DVec3::from_array(size) * 0.5);
        let first = self.scene.views[0].clone();
        self.scene.views =
            (0..extent.views).map(|n| turn(&first, centre, n, extent.views)).collect();
        self.scene.picture.size = extent.size;
        self
    }

    /// The first channels alone.
    pub fn first_channels(&self, count: usize) -> TurningScene {
        let mut scene = self.scene.clone();
        scene.volumes[0].channels.truncate(count);
        let VolumeVoxels { size, world_from_voxel, .. } = *self.whole;
        let channels = self.whole.channels.iter().take(count).cloned().collect();
        let whole = Arc::new(VolumeVoxels { size, world_from_voxel, channels });
        let source = cut(&scene, &whole, self.payload);
        TurningScene { scene, source, whole, payload: self.payload }
    }

    /// Channels shown.
    pub fn channels(&self) -> usize {
        self.scene.volumes[0].channels.len()
    }

    /// Voxels along each axis.
    pub fn size(&self) -> [u32; 3] {
        self.whole.size.to_array()
    }

    /// For one renderer: with memory for all bricks, and for leaves of 4 voxels.
    ///
    /// # Errors
    /// When the scene cannot be drawn.
    pub fn data(&self) -> Result<SceneData> {
        let mut scene = self.scene.clone();
        scene.memory.atlas_mib = ATLAS_MIB;
        // Half of it is an octree's at most: of each node of any tree two words a channel, and two.
        let nodes = self.whole.size.voxel_count() as u64 / 64 * 4 / 3;
        let node_bytes = 8 * (self.channels() as u64 + 1);
        scene.memory.ram_mib = ((2 * nodes * node_bytes) >> 20) + CACHE_MIB;
        let volume = VolumeData::of_whole(self.source.clone(), self.whole.clone());
        SceneData::new(scene, vec![volume])
    }

    /// A layout in which so many renderers may have all bricks on the device at once: quads take four
    /// times as much.
    pub fn layout(&self, renderers: usize) -> LayoutChoice {
        let description = self.source.description();
        let bricks: u128 = (0..description.levels.count() as u8)
            .filter_map(|level| description.grid(level))
            .map(|grid| grid.bricks().voxel_count())
            .sum();
        let slot_bytes = description.brick_bytes(description.brick_largest()) as u128;
        let bytes = 4 * bricks * slot_bytes * self.channels() as u128 * renderers as u128;
        match bytes >> 20 > u128::from(QUADS_MIB) {
            true => LayoutChoice::Only(Layout::Plain),
            false => LayoutChoice::Auto,
        }
    }
}

/// Nothing is given up.
const ATLAS_MIB: u64 = 8192;
/// Of the host's memory, beside octrees.
const CACHE_MIB: u64 = 256;
/// Of all atlases of all renderers together, at most.
const QUADS_MIB: u64 = 6144;

fn cut(scene: &Scene, whole: &Arc<VolumeVoxels>, payload: u32) -> Arc<dyn BrickSource> {
    Arc::new(DenseVolume::new(&scene.volumes[0].name, whole.clone(), Size3::cube(payload)))
}

/// The view, turned by a part of a circle around the axis of the world that points most upwards in it.
fn turn(first: &View, centre: DVec3, number: u32, views: u32) -> View {
    let up = first.up.abs();
    let axis = match up.max_element() {
        most if most == up.x => DVec3::X,
        most if most == up.y => DVec3::Y,
        _ => DVec3::Z,
    };
    let angle = std::f64::consts::TAU * f64::from(number) / f64::from(views);
    let turn = DQuat::from_axis_angle(axis, angle);
    View {
        name: format!("turn {number} of {views}"),
        eye: centre + turn * (first.eye - centre),
        forward: turn * first.forward,
        right: turn * first.right,
        up: turn * first.up,
        projection: first.projection,
        part: None,
    }
}

/// A channel that shows stored values between two bounds, most of all the middle; the last window stays
/// open above.
fn window_of(number: usize, band: usize, bounds: [f64; 5], edge_world: f64) -> Result<Channel> {
    let band = band % (bounds.len() - 1);
    let last = band + 2 == bounds.len();
    // Leaves a third of the light after some ten voxels of the densest material.
    let extinction = [0.03, 0.06, 0.1, 0.15][band] / edge_world;
    let hue = number as f64 / SIXTEEN_CHANNELS as f64 * std::f64::consts::TAU;
    let color = [0.0, 1.0, 2.0]
        .map(|third: f64| 0.5 + 0.45 * (hue + third * std::f64::consts::TAU / 3.0).cos());
    let point = |at, extinction| TransferPoint { at, color, extinction };
    let points = vec![
        point(0.0, 0.0),
        point(0.5, extinction),
        point(1.0, if last { extinction } else { 0.0 }),
    ];
    let transfer = TransferFunction::new(points)
        .map_err(|(_, why)| Error { exit: Exit::Bug, message: why })?;
    let window = [bounds[band], bounds[band + 1]];
    Ok(Channel {
        index: number as u32,
        window,
        transfer,
        level_min: 0,
        level_max: None,
        sample_every: 1,
    })
}

/// Sixteen channels of volumes, each in turn, in the first one's grid: each channel's material, place and
/// smoothness are its own.
fn sixteen(volumes: Vec<(SceneData, &'static str)>, extent: &Extent) -> Result<TurningScene> {
    let mut sources = Vec::new();
    for (data, name) in &volumes {
        let whole = data.whole(0)?;
        sources.extend((0..whole.channels.len()).map(|c| (whole.clone(), c, bounds(name))));
    }
    let Some((first, ..)) = sources.first() else { return Err(Error::input("no volume to shift")) };
    let (size, world_from_voxel) = (first.size, first.world_from_voxel);
    let shift_most = i64::from(size.to_array().into_iter().min().unwrap_or(1) / 4);
    let mut channels = Vec::new();
    let mut bands = Vec::new();
    for number in 0..SIXTEEN_CHANNELS {
        let (whole, channel, bounds) = &sources[number % sources.len()];
        // Steps that share no divisor with most spans, so that no two channels lie alike.
        let shift = [37, 53, 29]
            .map(|step| (number as i64 * step).rem_euclid(2 * shift_most + 1) - shift_most);
        let mut voxels = shifted(&whole.channels[*channel].voxels, whole.size, size, shift);
        for axis in 0..3 {
            voxels = smoothed(&voxels, size, axis, number % 3);
        }
        channels.push(ChannelVoxels { voxels: Voxels::U8(voxels), slope: 1.0, intercept: 0.0 });
        bands.push((number / sources.len(), *bounds));
    }
    let voxels = VolumeVoxels { size, world_from_voxel, channels };
    TurningScene::windowed(volumes[0].0.scene.clone(), voxels, bands.into_iter(), extent)
}

/// In bytes, the middle of one volume on the middle of another's grid, moved by `shift`; 0 beyond.
fn shifted(voxels: &Voxels, of: Size3, size: Size3, shift: [i64; 3]) -> Vec<u8> {
    let [edges, of_edges] = [size, of].map(Size3::to_array);
    let place = |axis: usize, at: u32| {
        let middle = (i64::from(of_edges[axis]) - i64::from(edges[axis])) / 2;
        let place = i64::from(at) + middle - shift[axis];
        u32::try_from(place).ok().filter(|place| *place < of_edges[axis])
    };
    let row = |y: u32, z: u32| {
        (0..edges[0]).map(move |x| match (place(0, x), place(1, y), place(2, z)) {
            (Some(x), Some(y), Some(z)) => {
                voxels.value(of.index(x, y, z)).clamp(0.0, 255.0).round() as u8
            }
            _ => 0,
        })
    };
    let slice = |z: u32| (0..edges[1]).flat_map(move |y| row(y, z)).collect::<Vec<u8>>();
    (0..edges[2]).into_par_iter().flat_map_iter(slice).collect()
}

/// Along one axis, the mean over `radius` voxels on both sides; the outermost voxels go on.
fn smoothed(voxels: &[u8], size: Size3, axis: usize, radius: usize) -> Vec<u8> {
    if radius == 0 {
        return voxels.to_vec();
    }
    let edges = size.to_array().map(|edge| edge as usize);
    let stride = [1, edges[0], edges[0] * edges[1]][axis];
    let wide = 2 * radius + 1;
    let mean = |index: usize| {
        let at = index / stride % edges[axis];
        let line = index - at * stride;
        let of = |k: usize| {
            let at = (at + k).saturating_sub(radius).min(edges[axis] - 1);
            usize::from(voxels[line + at * stride])
        };
        ((0..wide).map(of).sum::<usize>() / wide) as u8
    };
    (0..voxels.len()).into_par_iter().map(mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shift_moves_and_smoothing_keeps_sums_inside() {
        let size = Size3::cube(5);
        let mut voxels = vec![0u8; 125];
        voxels[size.index(2, 2, 2)] = 90;
        let moved = shifted(&Voxels::U8(voxels.clone()), size, size, [1, -1, 2]);
        assert_eq!(moved[size.index(3, 1, 4)], 90);
        assert_eq!(moved.iter().filter(|value| **value > 0).count(), 1);
        let smooth = smoothed(&voxels, size, 1, 1);
        let line: Vec<u8> = (0..5).map(|y| smooth[size.index(2, y, 2)]).collect();
        assert_eq!(line, [0, 30, 30, 30, 0]);
        // A smaller volume lies in the middle.
        let small = shifted(&Voxels::U8(vec![7]), Size3::cube(1), size, [0; 3]);
        assert_eq!(small.iter().position(|value| *value == 7), Some(size.index(2, 2, 2)));
    }

    #[test]
    fn a_turn_keeps_its_distance_and_comes_round() {
        let projection = crate::scene::Projection::Orthographic { height: 1.0 };
        let (eye, up) = (DVec3::new(3.0, 1.0, 0.5), DVec3::Z);
        let first = View::looking_at(String::new(), eye, DVec3::ZERO, up, projection);
        let first = first.unwrap_or_else(|why| unreachable!("{why:?}"));
        let views: Vec<View> = (0..4).map(|n| turn(&first, DVec3::ZERO, n, 4)).collect();
        for view in &views {
            assert!((view.eye.length() - eye.length()).abs() < 1e-12);
            assert!((view.forward + view.eye.normalize()).length() < 1e-12);
            assert_eq!(view.eye.z, eye.z);
        }
        assert!((views[2].eye - DVec3::new(-3.0, -1.0, 0.5)).length() < 1e-12);
    }

    #[test]
    fn windows_are_adjacent_and_shut() {
        let channels: Vec<Channel> = (0..4)
            .map(|band| {
                window_of(band, band, bounds("bonsai"), 1.0).unwrap_or_else(|_| unreachable!())
            })
            .collect();
        for pair in channels.windows(2) {
            assert_eq!(pair[0].window[1], pair[1].window[0]);
            assert_eq!(pair[0].transfer.points()[2].extinction, 0.0);
        }
        assert!(channels[3].transfer.points()[2].extinction > 0.0, "the brightest are seen");
    }
}
