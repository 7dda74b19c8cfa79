//! cast.comp against twins::cast, and against rays, march and resolve on the same device.

use ashfall::passes::march_shape::FilterShape;
use ashfall::passes::{cast, march, rays, resolve};
use ashfall::twins;
use ashfall::twins::limits::BLOCK_SAMPLES;
use ashfall::twins::ray::{RayGeometry, RayState};
use ashfall::twins::ray_march::Settings;
use ashfall::twins::ray_setup::ViewRays;

use crate::common::device::{Device, device};
use crate::random::Random;
use crate::scene::{Kind, Medium, OnDevice, TAME, cast_pipeline};
use crate::texels::Conversion;
use crate::views::placed;

const PICTURE: [u32; 2] = [40, 30];
/// Just below 2^32, so that every case's samples carry.
const BEFORE: [u32; 2] = [u32::MAX - 5, 7];

fn by_cast(
    device: &Device,
    medium: &Medium,
    filter: FilterShape,
    early_stop: bool,
    views: &[ViewRays],
    push: &twins::cast::Push,
) -> (Vec<[f32; 4]>, Vec<u32>) {
    let pipeline = cast_pipeline(device, &medium.shape(filter, early_stop));
    let scene = medium.on(device, filter);
    let views = device.filled("views", views);
    let [width, height] = push.rays.tile_size_pixel;
    let picture = device.room::<[f32; 4]>("picture", (width * height) as usize);
    let counters = device.filled("counters", &BEFORE);
    device.run(|recorder| {
        let (views, picture, counters) = (&views, &picture, &counters);
        let resources = cast::Resources { views, picture, counters, scene: scene.resources() };
        cast::record(recorder, &pipeline, &resources, push);
    });
    (device.written(&picture), device.values(&counters))
}

/// The same through ray states, two blocks a dispatch.
fn by_stages(
    device: &Device,
    medium: &Medium,
    filter: FilterShape,
    early_stop: bool,
    views: &[ViewRays],
    push: &twins::cast::Push,
) -> (Vec<[f32; 4]>, Vec<u32>) {
    let shape = medium.shape(filter, early_stop);
    let set_up = device.pipeline(&rays::variant(1));
    let move_on = device.pipeline(&shape.variant("march"));
    let finish = device.pipeline(&resolve::variant());
    let scene: OnDevice = medium.on(device, filter);
    let views = device.filled("views", views);
    let tile_size_pixel = push.rays.tile_size_pixel;
    let count = (tile_size_pixel[0] * tile_size_pixel[1]) as usize;
    let ray_geometry = device.room::<RayGeometry>("ray_geometry", count);
    let ray_state = device.room::<RayState>("ray_state", count);
    let picture = device.room::<[f32; 4]>("picture", count);
    let counters = device.filled("counters", &BEFORE);
    device.run(|recorder| {
        let (views, picture, counters) = (&views, &picture, &counters);
        let (ray_geometry, ray_state) = (&ray_geometry, &ray_state);
        let resources = rays::Resources { views, ray_geometry, ray_state };
        rays::record(recorder, &set_up, &resources, &push.rays);
        for _ in 0..push.blocks_max.div_ceil(2) {
            let resources = march::Resources { ray_geometry, ray_state, scene: scene.resources() };
            let push = march::Push { tile_size_pixel, blocks_max: 2, early_stop: push.early_stop };
            march::record(recorder, &move_on, &resources, &push);
        }
        let push = resolve::Push { background: push.background, unused_0: 0, tile_size_pixel };
        let resources = resolve::Resources { ray_state, picture, counters, states: None };
        resolve::record(recorder, &finish, &resources, &push);
    });
    (device.written(&picture), device.values(&counters))
}

#[test]
fn pictures_equal_the_twin_and_the_staged_way() {
    let Some(device) = device() else { return };
    let conversion = Conversion::measured(&device);
    let mut random = Random(30);
    let size = [14, 9, 12];
    let mut seen = 0;
    for (case, (channels, filter, early_stop)) in [
        (&[(Kind::F32, 5)][..], FilterShape::Quads, Some(0.3)),
        (&[(Kind::U8, 3)], FilterShape::Fetch, None),
        (&[(Kind::Holes, 30), (Kind::U16, 2)], FilterShape::Quads, None),
        (&[(Kind::Rgba8, 4), (Kind::Constant, 1)], FilterShape::Fetch, Some(0.3)),
        (&[(Kind::Constant, 1)], FilterShape::Fetch, None),
    ]
    .into_iter()
    .enumerate()
    {
        let medium = Medium::random(&mut random, size, channels, TAME);
        let volume = placed(&mut random, size, true);
        let views = [volume.rays(&volume.view(&mut random), PICTURE)];
        let samples = 150.0;
        let push = twins::cast::Push {
            rays: twins::rays::Push {
                tile_origin_pixel: [5, 3],
                tile_size_pixel: [30, 21],
                volume_size: size,
                view: 0,
                step_world: volume.diagonal_world() / samples,
            },
            blocks_max: (samples as u32 + 2).div_ceil(BLOCK_SAMPLES),
            early_stop: early_stop.unwrap_or(0.0),
            background: [0.1, 0.7, 2.0],
            unused_0: 0,
        };
        let settings = Settings {
            blocks_max: push.blocks_max,
            early_stop,
            preintegrated: false,
            macrocells: None,
            sample_every: &[],
        };
        let (wanted, taken) = medium.with_channels(&conversion, |channels| {
            twins::cast::cast(&views, channels, &settings, &push)
        });
        let stops = early_stop.is_some();
        let (pixels, counters) = by_cast(&device, &medium, filter, stops, &views, &push);
        let staged = by_stages(&device, &medium, filter, stops, &views, &push);
        let what = format!("case {case}, {channels:?}");
        let before = u64::from(BEFORE[1]) << 32 | u64::from(BEFORE[0]);
        let counted = (u64::from(counters[1]) << 32 | u64::from(counters[0])) - before;
        let worst = |a: &[[f32; 4]], b: &[[f32; 4]]| {
            let pairs = a.as_flattened().iter().zip(b.as_flattened());
            pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
        };
        if device.same_bits() {
            let bits = |pixels: &[[f32; 4]]| bytemuck::cast_slice::<_, u32>(pixels).to_vec();
            assert_eq!(bits(&pixels), bits(&wanted), "{what}: {:e}", worst(&pixels, &wanted));
            assert_eq!(bits(&pixels), bits(&staged.0), "{what}: the staged way");
            assert_eq!((counted, &counters), (taken, &staged.1), "{what}");
        } else {
            // Drivers may join operations of one shader otherwise than of another; a ray that grazes
            // the box may have a sample more, and a value at a jump fall to its other side.
            let far = |a: &[[f32; 4]], b: &[[f32; 4]]| {
                let off = |(a, b): &(&[f32; 4], &[f32; 4])| worst(&[**a], &[**b]) > 1e-4;
                a.iter().zip(b).filter(off).count()
            };
            assert!(far(&pixels, &wanted) * 50 <= pixels.len(), "{what}: against the twin");
            assert!(far(&pixels, &staged.0) * 50 <= pixels.len(), "{what}: against stages");
            assert!(counted.abs_diff(taken) * 50 <= taken, "{what}: {counted} {taken}");
        }
        seen += pixels.iter().filter(|pixel| pixel[3] > 0.1).count();
    }
    assert!(seen > 300, "{seen} pixels show something");
}
