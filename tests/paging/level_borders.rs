//! Where a level meets a coarser one at a brick's border: the derivative of a smooth field stays within the
//! reference's.

use std::path::Path;
use std::sync::Arc;

use ashfall::error::{Error, Result};
use ashfall::gpu::ShaderCompiler;
use ashfall::passes::SOURCES;
use ashfall::reference::Truth;
use ashfall::render::paging::Traversal;
use ashfall::render::{SceneData, VolumeData};
use ashfall::scene::{Overrides, Scene};
use ashfall::source::BrickSource;
use ashfall::source::faulty::{Fault, Faulty};
use ashfall::volume::{BrickId, VoxelFormat};

use crate::common::drawing::Device;
use crate::faults::Dense;
use crate::worlds::{at_level_0, bricks, channel, paged, volume};

const EDGE: u32 = 64;
const PAYLOAD: u32 = 16;
/// Pixels across: one shows nearly a voxel of the coarser level, whose footprint it is.
const ACROSS: u32 = 40;
const DOWN: u32 = 8;

/// Bricks of level 0 in the far half along x cannot be read: coarser ones stand in.
struct NearHalf;

impl Fault for NearHalf {
    fn before(&self, _: u64, id: BrickId) -> Result<()> {
        match id.level == 0 && id.x >= EDGE / PAYLOAD / 2 {
            true => Err(Error::input(format!("{id}: of the far half"))),
            false => Ok(()),
        }
    }
}

/// Rays along z, so that pixels across are places along x.
fn data(source: Arc<dyn BrickSource>, integrator: &str) -> SceneData {
    let text = "format = 1\n[[volume]]\nname = \"smooth\"\nsource = \"smooth.bricks\"\n\
        [[volume.channel]]\nwindow = [0.0, 1.0]\ntransfer = [\n\
        { at = 0.0, color = [1.0, 0.5, 0.2], extinction = 0.0 },\n\
        { at = 1.0, color = [0.2, 0.5, 1.0], extinction = 2.0 },\n]\n\
        [[view]]\neye = [0.5, 0.5, -2.0]\ntarget = [0.5, 0.5, 0.5]\nup = [0.0, 1.0, 0.0]\nheight = 0.2\n";
    let overrides = Overrides {
        size: Some([ACROSS, DOWN]),
        step: Some(0.125),
        early_stop: Some(0.0),
        refine: Some("substitute".to_owned()),
        integrator: Some(integrator.to_owned()),
        ..at_level_0()
    };
    let scene = Scene::from_toml(text, Path::new("smooth.toml"), &overrides)
        .unwrap_or_else(|why| panic!("{why}"));
    SceneData::new(scene, vec![VolumeData::new(source, vec![0])]).expect("drawable")
}

/// Alpha along the middle row, and how it changes from pixel to pixel.
fn changes(pixels: impl Iterator<Item = f64>) -> Vec<f64> {
    let alphas: Vec<f64> =
        pixels.skip((DOWN / 2 * ACROSS) as usize).take(ACROSS as usize).collect();
    alphas.windows(2).map(|pair| pair[1] - pair[0]).collect()
}

/// How far the picture's change from pixel to pixel leaves what the reference has within two coarse voxels
/// around, at most, as a part of the reference's greatest change.
fn beyond(device: &Device, traversal: Traversal, integrator: &str) -> f64 {
    let size = [EDGE; 3];
    let smooth: crate::worlds::Field =
        |[x, y, z]| 0.45 + 0.3 * (1.2 * x + 0.3).sin() * (0.8 * y).cos() + 0.1 * z.sin() * x;
    let dense = bricks(volume(size, vec![channel(size, VoxelFormat::F32, smooth)]), PAYLOAD);
    let source: Arc<dyn BrickSource> = Arc::new(Faulty::new(Dense(dense.clone()), NearHalf));
    let settings = paged(|paging| paging.traversal = traversal);
    let drawn = device.draw_with(&data(source, integrator), 0, &settings);
    assert!(drawn.statistics.bricks_failed > 10, "{:?}", drawn.statistics);
    let by_level = &drawn.statistics.bricks_uploaded_by_level;
    assert!(by_level[0] > 10 && by_level[1] > 1, "{by_level:?}");
    let whole = data(dense.clone(), integrator);
    let (scene, voxels) = (&whole.scene, dense.voxels().clone());
    let volumes = [(&scene.volumes[0], &*voxels)];
    let picture = &scene.picture;
    let truth = Truth::new(&scene.views[0], picture.size, picture.background, &volumes, 1e-7);
    let wanted = changes(truth.picture(2, &|_| {}).rgba.iter().map(|pixel| pixel[3]));
    let got = changes(drawn.picture.pixels.iter().map(|pixel| f64::from(pixel[3])));
    // The height shown is 0.2 of the cube, so the width is its whole.
    let pixels_of_voxel = f64::from(ACROSS) / f64::from(EDGE);
    let around = (2.0 * 2.0 * pixels_of_voxel).ceil() as usize;
    let most = wanted.iter().fold(0.0f64, |most, change| most.max(change.abs()));
    let leaves = |at: usize| {
        let near = &wanted[at - around..at + around];
        let low = near.iter().copied().fold(f64::INFINITY, f64::min);
        let high = near.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        (low - got[at]).max(got[at] - high).max(0.0) / most
    };
    // At the volume's faces there is one side alone.
    (around..got.len() - around).map(leaves).fold(0.0, f64::max)
}

/// Of the greatest derivative: what f32 and the step leave.
const BEYOND_MAX: f64 = 0.01;

#[test]
fn across_a_change_of_level_the_derivative_stays_within_the_references() {
    let Some(device) = Device::open() else { return };
    for traversal in [Traversal::PageTable, Traversal::ResidencyOctree] {
        for integrator in ["riemann", "preintegrated"] {
            let beyond = beyond(&device, traversal, integrator);
            println!("{traversal:?}, {integrator}: {beyond:.4} beyond");
            assert!(beyond < BEYOND_MAX, "{traversal:?}, {integrator}: {beyond}");
        }
    }
    device.finish();
}

/// Coarse samples a quarter of a voxel from their place, and bricks looked up beside theirs.
#[test]
fn a_step_at_the_border_is_noticed() {
    let Some(mut device) = Device::open() else { return };
    for (from, to) in [
        ("vec3(ivec3(1) << shift) - 0.5;", "vec3(ivec3(1) << shift) - 0.25;"),
        ("((rest + 0.5) + position)", "(rest + position)"),
    ] {
        let mut sources = SOURCES.to_vec();
        let of_march = |source: &&mut (&str, &str)| source.0 == "common/brick_march.glsl";
        let source = sources.iter_mut().find(of_march).expect("a shader");
        assert_eq!(source.1.matches(from).count(), 1, "{from}");
        source.1 = source.1.replace(from, to).leak();
        device.compiler = ShaderCompiler::new(sources.leak(), None);
        let beyond = beyond(&device, Traversal::PageTable, "riemann");
        println!("{to}: {beyond:.4} beyond");
        assert!(beyond > 2.0 * BEYOND_MAX, "{to}: {beyond}");
    }
    device.finish();
}
