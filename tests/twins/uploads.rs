//! Whole small renders of every voxel format against twins::cast: what upload makes of voxels and
//! what the plan makes of their scaling, by the layout's own numbers and by stored values alone.

use ashfall::gpu::Gpu;
use ashfall::render::{
    Layout, LayoutChoice, Picture, Plan, Renderer, SceneData, Settings, TexelLayout,
    transfer_segments,
};
use ashfall::scene::{Overrides, Projection, Scene, View};
use ashfall::twins;
use ashfall::twins::filter::Texels;
use ashfall::twins::ray_march::Channel;
use ashfall::volume::{ChannelVoxels, Size3, VolumeVoxels, Voxels, WorldFromVoxel, sanitized};
use glam::DVec3;

use crate::common::device::{Device, device};
use crate::common::drawing::dense;
use crate::random::Random;
use crate::texels::{Conversion, Raw};
use crate::views::{Placed, unit_vector};

const SIZE: [u32; 3] = [7, 5, 6];
const PICTURE: [u32; 2] = [24, 20];
const BACKGROUND: [f32; 3] = [0.25, 0.0, 1.0];

struct Case {
    what: &'static str,
    voxels: Voxels,
    /// Slope and intercept of the file.
    scaling: (f64, f64),
    window: [f64; 2],
    /// Shift of stored values, and whether they are scaled, as the layout should have it.
    layout: (f64, f64),
}

fn cases() -> Vec<Case> {
    let mut random = Random(40);
    let count = SIZE.iter().product::<u32>();
    let mut units = || -> Vec<f64> { (0..count).map(|_| random.unit()).collect() };
    let f32s = |units: Vec<f64>, least: f64, most: f64| -> Vec<f32> {
        units.into_iter().map(|unit| (least + (most - least) * unit) as f32).collect()
    };
    let case =
        |what, voxels, scaling, window, layout| Case { what, voxels, scaling, window, layout };
    let i16s = units().into_iter().map(|unit| (unit * 65536.0 - 32768.0) as i16).collect();
    let dark = units().into_iter().map(|unit| (unit * -2000.0) as i16 - 1000).collect();
    let u16s = units().into_iter().map(|unit| (unit * 65536.0) as u16).collect();
    let u8s = units().into_iter().map(|unit| (unit * 256.0) as u8).collect();
    let mut huge = f32s(units(), 0.0, f64::from(f32::MAX));
    huge[17] = f32::INFINITY;
    let mut holes = f32s(units(), -1.0, 3.0);
    holes[100] = f32::NAN;
    let max = f64::from(f32::MAX);
    let narrow = f32s(units(), 1000.0, 1001.0);
    let least = f64::from(narrow.iter().copied().fold(f32::MAX, f32::min));
    vec![
        case("u8", Voxels::U8(u8s), (1.0, 0.0), [20.0, 230.0], (255.0, 0.0)),
        case("u16, scaled", Voxels::U16(u16s), (0.5, -100.0), [0.0, 3e4], (65535.0, 0.0)),
        case("i16", Voxels::I16(i16s), (1.0, 0.0), [-2e4, 3e4], (65535.0, -32768.0)),
        case("i16, scaled", Voxels::I16(dark), (-2.0, 50.0), [2e3, 6e3], (65535.0, -32768.0)),
        case("f32", Voxels::F32(f32s(units(), -1.0, 3.0)), (1.0, 0.0), [-1.0, 3.0], (1.0, 0.0)),
        case("f32, narrow", Voxels::F32(narrow), (1.0, 0.0), [1000.0, 1001.0], (1.0, least)),
        case("f32, huge", Voxels::F32(huge), (1.0, 0.0), [0.0, max], (16.0, 0.0)),
        case("f32, NaN", Voxels::F32(holes), (3.0, 1.0), [-2.0, 10.0], (1.0, 0.0)),
    ]
}

fn data(case: &Case, volume: &Placed, view_seed: u64) -> SceneData {
    let text = format!(
        r#"format = 1
[picture]
size = {PICTURE:?}
background = {BACKGROUND:?}
[quality]
early_stop = 0.0
step = 0.5
filter = "exact"
[[volume]]
source = {{ computed = "constant", size = [1, 1, 1] }}
[[volume.channel]]
window = [{:e}, {:e}]
transfer = [
  {{ at = 0.0, color = [1.0, 0.2, 0.0], extinction = 0.02 }},
  {{ at = 0.5, color = [0.1, 0.9, 0.3], extinction = 0.4 }},
  {{ at = 1.0, color = [0.0, 0.5, 1.0], extinction = 0.1 }},
]
[[view]]
eye = [0.0, 0.0, 5.0]
target = [0.0, 0.0, 0.0]
up = [0.0, 1.0, 0.0]
height = 1.0
"#,
        case.window[0], case.window[1]
    );
    let mut scene = Scene::from_toml(&text, "test".as_ref(), &Overrides::default()).expect("good");
    let target = volume.point(DVec3::splat(0.5));
    let eye = target + unit_vector(&mut Random(view_seed)) * volume.diagonal_world();
    let projection = Projection::Perspective { fov_degrees: 35.0 };
    let up = unit_vector(&mut Random(view_seed + 1));
    let view = View::looking_at("view".to_owned(), eye, target, up, projection);
    scene.views = vec![view.expect("a good view")];
    scene.volumes[0].world_from_voxel = Some(volume.world_from_voxel);
    let (slope, intercept) = case.scaling;
    let voxels = VolumeVoxels {
        size: Size3::from_array(volume.size),
        world_from_voxel: volume.world_from_voxel,
        channels: vec![ChannelVoxels { voxels: case.voxels.clone(), slope, intercept }],
    };
    SceneData::new(scene, vec![dense(voxels)]).expect("drawable")
}

fn drawn(device: &Device, data: &SceneData, settings: Settings) -> (Picture, u64, Option<f64>) {
    let gpu: &std::sync::Arc<Gpu> = &device.gpu;
    let plan = Plan::new(gpu, &device.compiler, data, &settings).expect("planned");
    let step_world = plan.step_world;
    let mut renderer = Renderer::new(gpu, plan, data).expect("built");
    let (picture, statistics) = renderer.draw(0, &mut |_| {}).expect("drawn");
    (picture, statistics.samples, step_world)
}

/// Values of all voxels with the edge repeated around them.
fn with_apron(values: &[f32]) -> Vec<f32> {
    let apron = SIZE.map(|edge| edge + 2);
    let at = |c: u32, axis: usize| (c.max(1) - 1).min(SIZE[axis] - 1);
    let mut out = Vec::new();
    for z in 0..apron[2] {
        for y in 0..apron[1] {
            for x in 0..apron[0] {
                let (x, y, z) = (at(x, 0), at(y, 1), at(z, 2));
                out.push(values[((z * SIZE[1] + y) * SIZE[0] + x) as usize]);
            }
        }
    }
    out
}

/// twins::cast over one channel of these values.
fn twin(
    data: &SceneData,
    volume: &Placed,
    step_world: f64,
    values: &[f32],
    scale_offset: (f64, f64),
    scaling: (f64, f64),
) -> (Vec<[f32; 4]>, u64) {
    let segments = transfer_segments(&data.scene.volumes[0].channels[0], scaling, scale_offset);
    let texels = with_apron(values);
    let channel = Channel::Scalar {
        texels: Texels { size: SIZE.map(|edge| edge + 2), texels: &texels },
        segments: &segments,
    };
    let push = twins::cast::Push {
        rays: twins::rays::Push {
            tile_origin_pixel: [0, 0],
            tile_size_pixel: PICTURE,
            volume_size: SIZE,
            view: 0,
            step_world,
        },
        blocks_max: 1000,
        early_stop: 0.0,
        background: BACKGROUND,
        unused_0: 0,
    };
    let settings = twins::ray_march::Settings {
        blocks_max: 1000,
        early_stop: None,
        preintegrated: false,
        macrocells: None,
        sample_every: &[],
    };
    let views = [volume.rays(&data.scene.views[0], PICTURE)];
    twins::cast::cast(&views, &[channel], &settings, &push)
}

fn worst(a: &[[f32; 4]], b: &[[f32; 4]]) -> f32 {
    assert_eq!(a.len(), b.len());
    let pairs = a.as_flattened().iter().zip(b.as_flattened());
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
fn renders_of_every_format_equal_the_twin() {
    let Some(device) = device() else { return };
    let conversion = Conversion::measured(&device);
    for (index, case) in cases().iter().enumerate() {
        let what = case.what;
        let world_from_voxel = WorldFromVoxel::from_spacing([1.0, 0.8, 1.3]).expect("regular");
        let volume = Placed { size: SIZE, world_from_voxel };
        let data = data(case, &volume, 60 + index as u64);
        let only = |layout| Settings { layout: LayoutChoice::Only(layout), ..Settings::default() };
        let (plain, samples, step_world) = drawn(&device, &data, only(Layout::Plain));
        let step_world = step_world.expect("not homogeneous");
        let (quads, _, _) = drawn(&device, &data, only(Layout::Quads));
        let small = Settings { tile: [9, 7], steps_per_dispatch: 32, ..only(Layout::Quads) };
        let (tiles, _, _) = drawn(&device, &data, small.checked().expect("good settings"));
        let covered = plain.pixels.iter().filter(|pixel| pixel[3] > 0.1).count();
        assert!(covered > 50, "{what}: {covered} pixels show something");

        // By the layout's own numbers: texels as the device returns them.
        let (scale, offset) = case.layout;
        let range = case.voxels.range();
        let greatest = range.greatest.min(f32::MAX);
        let range = ashfall::volume::ValueRange { greatest, ..range };
        let layout = TexelLayout::of(case.voxels.format(), range, Layout::Plain);
        assert_eq!((layout.scale, layout.offset), (scale, offset), "{what}");
        let texels: Vec<f32> = match &case.voxels {
            Voxels::U8(v) => conversion.scalars(&Raw::U8(v.clone())),
            Voxels::U16(v) => conversion.scalars(&Raw::U16(v.clone())),
            Voxels::I16(v) => {
                let shifted = v.iter().map(|value| (i32::from(*value) + 32768) as u16);
                conversion.scalars(&Raw::U16(shifted.collect()))
            }
            Voxels::F32(v) => {
                let texel = |value| (f64::from(sanitized(value)) - offset) / scale;
                v.iter().map(|value| texel(*value) as f32).collect()
            }
            Voxels::Rgba8(_) => unreachable!("no such case"),
        };
        let (wanted, taken) = twin(&data, &volume, step_world, &texels, case.layout, case.scaling);
        if device.same_bits() {
            let bits = |pixels: &[[f32; 4]]| bytemuck::cast_slice::<_, u32>(pixels).to_vec();
            assert_eq!(bits(&plain.pixels), bits(&wanted), "{what}");
            assert_eq!(bits(&quads.pixels), bits(&wanted), "{what}, quads");
            assert_eq!(bits(&tiles.pixels), bits(&wanted), "{what}, tiles and stages");
            assert_eq!(samples, taken, "{what}");
        }
        // Joined operations; a ray that grazes the box with one sample more or less changes little.
        for picture in [&plain, &quads, &tiles] {
            let error = worst(&picture.pixels, &wanted);
            assert!(error < 1e-3, "{what}: {error:e}");
        }
        // By stored values alone, whatever the layout: f32 holds 1000 to 1001 to 6e-5 of the window,
        // and this transfer function changes by at most 6 over it.
        let stored: Vec<f32> =
            (0..case.voxels.len()).map(|at| sanitized(case.voxels.value(at))).collect();
        let (wanted, _) = twin(&data, &volume, step_world, &stored, (1.0, 0.0), case.scaling);
        let error = worst(&plain.pixels, &wanted);
        eprintln!("{what}: {error:e} from stored values");
        assert!(error < 1e-3, "{what}: {error:e} from stored values");
    }
}
