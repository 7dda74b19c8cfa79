//! rays.comp against twins::rays: fixed-point geometry of random cameras on random volumes.

use ashfall::passes::{rays, resolve};
use ashfall::twins::ray::{RayGeometry, RayState};
use ashfall::twins::rays::Push;

use crate::common::device::{Device, device};
use crate::random::Random;
use crate::views::{pick, placed};

const VIEWS: usize = 3;
const PICTURE: [u32; 2] = [48, 36];

/// A number of fixed point, in units of 2^-32.
fn units(cell: i32, fraction: u32) -> i64 {
    (i64::from(cell) << 32) | i64::from(fraction)
}

/// Beside equal bits: f64 holds a coordinate of 2^20 voxels to 2^-32, and the few operations before
/// fixed point may each be off by one such unit where they are joined. A count is a rounded-up
/// quotient, so it may be one more or less, and then every step differs: only the count is compared.
fn compare(device: &Device, got: &RayGeometry, wanted: &RayGeometry, magnitude: f64, what: &str) {
    if device.same_bits() {
        assert_eq!(got, wanted, "{what}");
        return;
    }
    assert!(got.sample_count.abs_diff(wanted.sample_count) <= 1, "{what}: {got:?} {wanted:?}");
    if got.sample_count != wanted.sample_count {
        return;
    }
    let bound = 4 + (8.0 * magnitude / f64::from(1 << 20)) as u64;
    for axis in 0..3 {
        for (g, w) in [
            (
                units(got.start_cell[axis], got.start_fraction[axis]),
                units(wanted.start_cell[axis], wanted.start_fraction[axis]),
            ),
            (
                units(got.delta_cell[axis], got.delta_fraction[axis]),
                units(wanted.delta_cell[axis], wanted.delta_fraction[axis]),
            ),
        ] {
            assert!(g.abs_diff(w) <= bound, "{what}, axis {axis}: {got:?} {wanted:?}");
        }
    }
    let error = (got.step_world - wanted.step_world).abs();
    assert!(error <= 2e-7 * wanted.step_world, "{what}: {got:?} {wanted:?}");
}

#[test]
fn geometry_of_random_views_equals_the_twin() {
    let Some(device) = device() else { return };
    let pipeline = device.pipeline(&rays::variant(VIEWS));
    let mut random = Random(1);
    let (mut hits, mut misses, mut still, mut inside) = (0, 0, 0, 0);
    let sizes = [
        [1, 1, 1],
        [5, 7, 3],
        [256, 256, 256],
        [1 << 20, 3, 1 << 10],
        [1 << 24, 1 << 24, 1 << 24],
        [1, 4096, 1],
    ];
    for case in 0..96 {
        let size = sizes[case / 4 % sizes.len()];
        let volume = placed(&mut random, size, case % 4 != 0);
        let views: Vec<_> = (0..VIEWS)
            .map(|_| match case % 4 {
                0 => volume.view_along_axis(&mut random),
                _ => volume.view(&mut random),
            })
            .map(|view| volume.rays(&view, PICTURE))
            .collect();
        let samples = pick(&mut random, &[0.3, 20.0, 3e3, 1e6, 5e8]);
        let push = Push {
            tile_origin_pixel: [0, 1].map(|_| (random.unit() * 20.0) as u32),
            tile_size_pixel: [pick(&mut random, &[1, 8, 13, 28]), pick(&mut random, &[1, 9, 16])],
            volume_size: size,
            view: (case % VIEWS) as u32,
            step_world: volume.diagonal_world() / samples,
        };
        let (wanted, fresh) = ashfall::twins::rays::rays(&views, &push);
        let views_buffer = device.filled("views", &views);
        let ray_geometry = device.room::<RayGeometry>("ray_geometry", wanted.len());
        let ray_state = device.room::<RayState>("ray_state", wanted.len());
        device.run(|recorder| {
            let resources = rays::Resources {
                views: &views_buffer,
                ray_geometry: &ray_geometry,
                ray_state: &ray_state,
            };
            rays::record(recorder, &pipeline, &resources, &push);
            recorder.host_read(&ray_geometry);
            recorder.host_read(&ray_state);
        });
        assert_eq!(device.written::<RayState>(&ray_state), fresh, "case {case}");
        let view = &views[case % VIEWS];
        let far = view.origin_voxel.iter().fold(0.0f64, |most, part| most.max(part.abs()));
        let magnitude = size.iter().fold(far, |most, edge| most.max(f64::from(*edge)));
        for (index, got) in device.written::<RayGeometry>(&ray_geometry).iter().enumerate() {
            let what = format!("case {case} {size:?}, ray {index} of {push:?}");
            compare(&device, got, &wanted[index], magnitude, &what);
            let hit = got.sample_count > 0;
            hits += usize::from(hit);
            misses += usize::from(!hit);
            still += usize::from(hit && view.direction_voxel[..3].contains(&0.0));
            let within =
                |axis: usize| (0.0..f64::from(size[axis])).contains(&view.origin_voxel[axis]);
            inside += usize::from(hit && (0..3).all(within));
        }
    }
    // The input is what it is meant to be.
    let seen = [hits, misses, still, inside];
    assert!(seen.iter().all(|count| *count > 100), "hit, miss, still, inside: {seen:?}");
}

/// Silence of validation means something: a missing barrier before a read is heard.
/// (Of two writes by dispatches, layers of 1.3.239 say nothing: there the recorder's own record is all.)
#[test]
fn a_missing_barrier_is_heard() {
    let Some(device) = device() else { return };
    let pipeline = device.pipeline(&rays::variant(1));
    let views = device.filled("views", &[ashfall::twins::ray_setup::ViewRays::default()]);
    let ray_geometry = device.room::<RayGeometry>("ray_geometry", 64);
    let ray_state = device.room::<RayState>("ray_state", 64);
    let push = Push {
        tile_origin_pixel: [0; 2],
        tile_size_pixel: [8; 2],
        volume_size: [1; 3],
        view: 0,
        step_world: 1.0,
    };
    let finish = device.pipeline(&resolve::variant());
    let picture = device.room::<[f32; 4]>("picture", 64);
    let counters = device.filled("counters", &[0u32; 2]);
    device.run(|recorder| {
        let (ray_geometry, ray_state) = (&ray_geometry, &ray_state);
        let resources = rays::Resources { views: &views, ray_geometry, ray_state };
        rays::record(recorder, &pipeline, &resources, &push);
        let tile_size_pixel = push.tile_size_pixel;
        let push = resolve::Push { background: [0.0; 3], unused_0: 0, tile_size_pixel };
        let (picture, counters) = (&picture, &counters);
        let resources = resolve::Resources { ray_state, picture, counters, states: None };
        resolve::record(recorder, &finish, &resources, &push);
        recorder.leave_out_barriers_before("resolve");
    });
    assert!(
        device.gpu.messages().iter().any(|said| said.text.contains("SYNC-HAZARD-READ-AFTER-WRITE"))
    );
    drop((views, ray_geometry, ray_state, picture, counters, pipeline, finish));
    let end = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| drop(device)));
    assert!(end.is_err(), "the device ends as if nothing had been said");
}
