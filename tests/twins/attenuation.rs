//! The shaders' exponential, through resolve.comp and through a march of one sample; the counters.

use ashfall::passes::resolve;
use ashfall::twins::exponential::attenuate;
use ashfall::twins::limits::OPAQUE_DEPTH;
use ashfall::twins::ray::{RayGeometry, RayState};
use ashfall::twins::transfer::TransferSegment;

use crate::common::device::{Device, device};
use crate::random::Random;
use crate::scene::{Kind, Medium, TAME, marched};

/// Optical depths from denormal to beyond opaque.
fn depths() -> Vec<f32> {
    let sweep = std::iter::successors(Some(1e-39f32), |x| Some(x * 1.013));
    let mut depths: Vec<f32> = sweep.take_while(|x| *x < 2e6).collect();
    depths.extend([0.0, 1e6, 3e38, f32::INFINITY, 87.0, 86.9, 0.346_573_6, 0.346_573_5]);
    depths
}

/// Pixels and counters of resolve.comp.
fn resolved(
    device: &Device,
    states: &[RayState],
    tile: [u32; 2],
    background: [f32; 3],
    before: [u32; 2],
) -> (Vec<[f32; 4]>, [u32; 2]) {
    let pipeline = device.pipeline(&resolve::variant());
    let ray_state = device.filled("ray_state", states);
    let picture = device.room::<[f32; 4]>("picture", states.len());
    let counters = device.filled("counters", &before);
    let push = resolve::Push { background, unused_0: 0, tile_size_pixel: tile };
    device.run(|recorder| {
        let (picture, counters) = (&picture, &counters);
        let resources =
            resolve::Resources { ray_state: &ray_state, picture, counters, states: None };
        resolve::record(recorder, &pipeline, &resources, &push);
    });
    let counters = device.values::<u32>(&counters);
    (device.written(&picture), [counters[0], counters[1]])
}

/// Against f64: 3e-7 of the value on any device, which is what pictures are promised from. Against
/// the twin: bits on a CPU; elsewhere joined operations leave a few units in the last place.
fn compare(device: &Device, x: f32, got: [f32; 2]) {
    let wanted = attenuate(x);
    if device.same_bits() {
        let bits = got.map(f32::to_bits);
        let equal = [wanted.transmitted, wanted.absorbed].map(f32::to_bits);
        assert_eq!(bits, equal, "{x:e}: {got:?} {wanted:?}");
    }
    let bounded = f64::from(x).min(87.0);
    let exact = [(-bounded).exp(), -(-bounded).exp_m1()];
    for (got, exact) in got.into_iter().zip(exact) {
        let error = (f64::from(got) - exact).abs();
        // Below 86.6 the least number that is not denormal takes part, which devices may flush.
        let least = f64::from(f32::MIN_POSITIVE);
        assert!(error <= 4e-7 * exact + least, "{x:e}: {got:e} is not {exact:e}");
    }
}

#[test]
fn resolve_attenuates_as_the_twin_at_every_depth() {
    let Some(device) = device() else { return };
    let depths = depths();
    let state = |depth: &f32| RayState { optical_depth: *depth, ..RayState::default() };
    let states: Vec<_> = depths.iter().map(state).collect();
    let tile = [states.len() as u32, 1];
    let (pixels, counters) = resolved(&device, &states, tile, [1.0, 0.0, 0.0], [5, 6]);
    assert_eq!(counters, [5, 6]);
    for (depth, [transmitted, _, _, absorbed]) in depths.iter().zip(pixels) {
        compare(&device, *depth, [transmitted, absorbed]);
    }
}

/// A constant channel, one sample of length 1: colour is what is absorbed, and nothing else is done.
#[test]
fn a_march_of_one_sample_attenuates_as_the_twin() {
    let Some(device) = device() else { return };
    let mut medium = Medium::random(&mut Random(20), [4; 3], &[(Kind::Constant, 1)], TAME);
    medium.segments[0][0] =
        TransferSegment { start: [1.0, 0.5, 0.0, 1.0], ..TransferSegment::default() };
    let depths: Vec<f32> = depths().into_iter().filter(|depth| *depth < 9e5).collect();
    let ray = |step_world: &f32| RayGeometry {
        sample_count: 1,
        step_world: *step_world,
        ..RayGeometry::default()
    };
    let rays: Vec<_> = depths.iter().map(ray).collect();
    let shape = medium.shape(ashfall::passes::march_shape::FilterShape::Fetch, false);
    let pipeline = device.pipeline(&shape.variant("march"));
    let scene = medium.on(&device, shape.filter);
    let fresh = vec![RayState::default(); rays.len()];
    let states = marched(&device, &pipeline, &scene, &rays, &fresh, None, &[1]);
    for (depth, state) in depths.iter().zip(states) {
        let [r, g, b] = state.color;
        compare(&device, *depth, [attenuate(*depth).transmitted, r]);
        assert_eq!(
            (g, b, state.optical_depth),
            (r * 0.5, 0.0, depth.min(OPAQUE_DEPTH)),
            "{depth:e}"
        );
        assert_eq!((state.next_sample, state.samples_taken), (1, 1));
    }
}

#[test]
fn random_states_resolve_as_the_twin_and_samples_carry() {
    let Some(device) = device() else { return };
    let mut random = Random(21);
    let tile = [37, 11];
    let mut state = || RayState {
        color: [0; 3].map(|_| random.between(-0.5, 2.0) as f32),
        optical_depth: 10f64.powf(random.between(-6.0, 2.0)) as f32,
        next_sample: 9,
        samples_taken: (random.unit() * 1e6) as u32,
        optical_depth_rest: 1.0,
        unused_0: 3,
    };
    let states: Vec<_> = (0..tile[0] * tile[1]).map(|_| state()).collect();
    let background = [0.25, 1.5, -0.125];
    let (wanted, samples) = ashfall::twins::resolve::resolve(&states, background);
    // Started so that the low word overflows in the midst of the rays, once and never.
    for start in [0u64, (1 << 32) - samples / 2, (3 << 32) - 1, (1 << 32) - samples - 1] {
        let words = [start as u32, (start >> 32) as u32];
        let (pixels, counters) = resolved(&device, &states, tile, background, words);
        let counted = u64::from(counters[1]) << 32 | u64::from(counters[0]);
        assert_eq!(counted, start + samples, "from {start}");
        for (index, (got, wanted)) in pixels.iter().zip(&wanted).enumerate() {
            if device.same_bits() {
                assert_eq!(got.map(f32::to_bits), wanted.map(f32::to_bits), "pixel {index}");
            }
            let error = got.iter().zip(wanted).map(|(g, w)| (g - w).abs()).fold(0.0, f32::max);
            assert!(error < 1e-6, "pixel {index}: {got:?} {wanted:?}");
        }
    }
    // Two overflows in one dispatch.
    let many = vec![RayState { samples_taken: u32::MAX, ..RayState::default() }; 3];
    let (_, counters) = resolved(&device, &many, [3, 1], background, [2, 0]);
    assert_eq!(u64::from(counters[1]) << 32 | u64::from(counters[0]), 2 + 3 * u64::from(u32::MAX));
}
