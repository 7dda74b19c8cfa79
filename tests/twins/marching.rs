//! march.comp against twins::march: ray states of random rays through random media.

use ashfall::passes::march_shape::{FilterShape, MacrocellUse};
use ashfall::render::open_both_ends;
use ashfall::twins::exponential::attenuate;
use ashfall::twins::march::march;
use ashfall::twins::ray::{RayGeometry, RayState};
use ashfall::twins::ray_march::{MacrocellCodes, Settings};

use crate::common::device::{Device, device};
use crate::random::Random;
use crate::scene::{Kind, Medium, Powers, TAME, WILD, blocks_of, inner_rays, marched};
use crate::texels::Conversion;

const SIZE: [u32; 3] = [11, 6, 9];
const RAYS: usize = 256;

/// Fresh rays, rays on their way and rays that have ended, some with a state beyond their end.
fn states(random: &mut Random, geometry: &[RayGeometry], at: Powers) -> Vec<RayState> {
    let state = |(index, geometry): (usize, &RayGeometry)| {
        let count = geometry.sample_count;
        let next_sample = match index % 4 {
            0 | 1 => 0,
            2 => (random.unit() * f64::from(count)) as u32,
            _ => count + (index as u32 % 8) / 4,
        };
        if next_sample == 0 {
            return RayState::default();
        }
        let optical_depth = 10f64.powf(random.between(at[0], at[1].min(0.5))) as f32;
        RayState {
            color: [0; 3].map(|_| random.unit() as f32),
            optical_depth,
            next_sample,
            samples_taken: next_sample / 2,
            optical_depth_rest: optical_depth * 1e-8,
            unused_0: 77,
        }
    };
    geometry.iter().enumerate().map(state).collect()
}

/// Elsewhere a joined multiplication and addition moves a value by 2^-24 of itself: colours and
/// depths by 1e-5 of theirs over 200 samples; and, over a jump of the transfer function, the odd ray
/// by any amount.
fn compare(device: &Device, got: &[RayState], wanted: &[RayState], tame: bool, what: &str) {
    let words = |state: &RayState| bytemuck::cast::<RayState, [u32; 8]>(*state);
    let mut far = 0;
    for (ray, (got, wanted)) in got.iter().zip(wanted).enumerate() {
        if device.same_bits() {
            assert_eq!(words(got), words(wanted), "{what}, ray {ray}: {got:?} {wanted:?}");
            continue;
        }
        let near = |g: f32, w: f32| (g - w).abs() <= 1e-5 * w.abs().max(1.0);
        let colors = got.color.iter().zip(wanted.color).all(|(g, w)| near(*g, w));
        let same = got.samples_taken == wanted.samples_taken;
        far += usize::from(!(colors && same && near(got.optical_depth, wanted.optical_depth)));
    }
    assert_eq!(got.len(), wanted.len());
    assert!(!tame || far * 50 <= got.len(), "{what}: {far} of {} rays are far off", got.len());
}

struct Case<'a> {
    what: &'a str,
    channels: &'a [(Kind, u32)],
    extinctions: Powers,
    early_stop: Option<f32>,
}

fn check(device: &Device, conversion: &Conversion, random: &mut Random, case: &Case) {
    let mut medium = Medium::random(random, SIZE, case.channels, case.extinctions);
    let mut ways = vec![MacrocellUse::Unused];
    if medium.kinds.iter().any(|kind| *kind != Kind::Constant) {
        ways.push(MacrocellUse::Skipping);
    }
    for macrocells in &ways {
        check_integrator(device, conversion, random, case, &medium, (false, *macrocells));
    }
    // Channels that take one of several samples.
    medium.sample_every = [2, 1, 8].into_iter().take(case.channels.len()).collect();
    let rates = (false, ways[ways.len() - 1]);
    check_integrator(device, conversion, random, case, &medium, rates);
    medium.sample_every.clear();
    if ways.len() > 1 {
        let adaptive = (false, MacrocellUse::Adaptive);
        check_integrator(device, conversion, random, case, &medium, adaptive);
    }
    for (kind, segments) in medium.kinds.iter().zip(&mut medium.segments) {
        if *kind != Kind::Constant {
            open_both_ends(segments);
        }
    }
    for macrocells in ways {
        check_integrator(device, conversion, random, case, &medium, (true, macrocells));
    }
}

fn check_integrator(
    device: &Device,
    conversion: &Conversion,
    random: &mut Random,
    case: &Case,
    medium: &Medium,
    (preintegrated, macrocells): (bool, MacrocellUse),
) {
    let geometry = inner_rays(random, SIZE, RAYS);
    let before = states(random, &geometry, case.extinctions);
    let blocks_max = blocks_of(&geometry);
    let mut wanted = before.clone();
    let codes = match macrocells {
        MacrocellUse::Unused => None,
        MacrocellUse::Skipping => Some(MacrocellCodes::Skipping(&medium.codes)),
        MacrocellUse::Adaptive => Some(MacrocellCodes::Adaptive(&medium.codes)),
    };
    let settings = Settings {
        blocks_max,
        early_stop: case.early_stop,
        preintegrated,
        macrocells: codes,
        sample_every: &medium.sample_every,
    };
    medium.with_channels(conversion, |channels| {
        march(&geometry, &mut wanted, channels, &settings);
    });
    let ended = |(state, ray): (&RayState, &RayGeometry)| state.next_sample >= ray.sample_count;
    assert!(wanted.iter().zip(&geometry).all(ended), "{}: every ray ends", case.what);
    let moved = wanted.iter().zip(&before).filter(|(after, before)| after != before).count();
    assert!(moved * 2 > RAYS, "{}: {moved} rays moved", case.what);
    if case.early_stop.is_some() && macrocells == MacrocellUse::Unused {
        let early = wanted.iter().zip(&before).zip(&geometry).filter(|((after, before), ray)| {
            let taken = after.samples_taken / if preintegrated { 2 } else { 1 };
            before.next_sample == 0 && taken < ray.sample_count
        });
        assert!(early.count() > 3, "{}: no ray stops early", case.what);
    }

    let filters = match case.channels {
        channels if channels.iter().any(|(kind, _)| *kind == Kind::Rgba8) => {
            &[FilterShape::Fetch][..]
        }
        // Eight channels fetched texel by texel take lavapipe half a minute to compile.
        [_, _, _, _, ..] => &[FilterShape::Quads],
        _ => &[FilterShape::Quads, FilterShape::Fetch],
    };
    let tame = case.extinctions != WILD;
    for filter in filters {
        let mut shape = medium.shape(*filter, case.early_stop.is_some());
        shape.preintegrated = preintegrated;
        shape.macrocells = macrocells;
        let pipeline = device.pipeline(&shape.variant("march"));
        let scene = medium.on(device, *filter);
        let march = |blocks: &[u32]| {
            marched(device, &pipeline, &scene, &geometry, &before, case.early_stop, blocks)
        };
        let got = march(&[blocks_max]);
        let what =
            format!("{}, {filter:?}, {macrocells:?}, preintegrated: {preintegrated}", case.what);
        compare(device, &got, &wanted, tame, &what);
        // Resumed in other pieces: the same bits on every device.
        for blocks in [&vec![1; blocks_max as usize][..], &[2, 1, 0, 3, blocks_max]] {
            let pieces = march(blocks);
            let same =
                bytemuck::cast_slice::<_, u8>(&pieces) == bytemuck::cast_slice::<_, u8>(&got);
            assert!(same, "{what}: other states in blocks of {blocks:?}");
        }
    }
}

fn check_all(seed: u64, cases: &[Case]) {
    let Some(device) = device() else { return };
    let conversion = Conversion::measured(&device);
    let mut random = Random(seed);
    cases.iter().for_each(|case| check(&device, &conversion, &mut random, case));
}

#[test]
fn one_channel_of_each_kind_equals_the_twin() {
    let case = |what, channels, early_stop| Case { what, channels, extinctions: TAME, early_stop };
    check_all(
        10,
        &[
            case("constant", &[(Kind::Constant, 1)], None),
            case("u8, one segment", &[(Kind::U8, 1)], None),
            case("u16", &[(Kind::U16, 3)], Some(0.4)),
            case("f32, 24 segments", &[(Kind::F32, 24)], None),
            case("with NaN", &[(Kind::Holes, 5)], Some(0.4)),
            case("huge", &[(Kind::Huge, 6)], None),
            case("quarters", &[(Kind::Quarters, 6)], None),
            case("rgba", &[(Kind::Rgba8, 4)], Some(0.4)),
        ],
    );
}

#[test]
fn several_channels_equal_the_twin() {
    let case = |what, channels, early_stop| Case { what, channels, extinctions: TAME, early_stop };
    check_all(
        11,
        &[
            case("constants", &[(Kind::Constant, 1), (Kind::Constant, 1)], None),
            case("scalars", &[(Kind::U8, 3), (Kind::Constant, 1), (Kind::Holes, 2)], Some(0.2)),
            case("mixed", &[(Kind::Rgba8, 2), (Kind::U16, 7), (Kind::Rgba8, 1)], None),
        ],
    );
}

#[test]
fn segments_that_are_searched_equal_the_twin() {
    let case = |what, channels, early_stop| Case { what, channels, extinctions: TAME, early_stop };
    check_all(
        12,
        &[
            case("300 segments", &[(Kind::F32, 300)], Some(0.4)),
            case("quarters", &[(Kind::Quarters, 40)], None),
            case("25 and one", &[(Kind::U16, 25), (Kind::Constant, 1), (Kind::Rgba8, 2)], None),
            // Counts around a power of two: one more than the last power of two, and a power of two itself.
            case("33 and 64", &[(Kind::U8, 33), (Kind::F32, 64)], None),
        ],
    );
}

/// Blocks of optical depth 1 exactly: a ray stops behind the first one, and only then, if less than
/// the bound is transmitted.
#[test]
fn rays_stop_at_their_bound_to_the_last_bit() {
    let Some(device) = device() else { return };
    let mut medium = Medium::random(&mut Random(15), SIZE, &[(Kind::Constant, 1)], TAME);
    medium.segments[0][0].start = [1.0; 4];
    let ray = RayGeometry { sample_count: 100, step_world: 1.0 / 32.0, ..RayGeometry::default() };
    let pipeline = device.pipeline(&medium.shape(FilterShape::Fetch, true).variant("march"));
    let scene = medium.on(&device, FilterShape::Fetch);
    let stops_after = |bound: f32| {
        let fresh = [RayState::default()];
        let after = marched(&device, &pipeline, &scene, &[ray], &fresh, Some(bound), &[4]);
        assert_eq!(after[0].next_sample, 100);
        after[0].samples_taken
    };
    let fresh = [RayState::default()];
    let open = device.pipeline(&medium.shape(FilterShape::Fetch, false).variant("march"));
    let after = marched(&device, &open, &scene, &[ray], &fresh, None, &[1]);
    assert_eq!((after[0].optical_depth, after[0].next_sample), (1.0, 32));
    let transmitted = attenuate(1.0).transmitted;
    let ulps = if device.same_bits() { 0 } else { 3 };
    let bits = transmitted.to_bits();
    assert_eq!(stops_after(f32::from_bits(bits - ulps)), 64, "not less than the bound");
    assert_eq!(stops_after(f32::from_bits(bits + ulps + 1)), 32, "less than the bound");
}

#[test]
fn every_number_of_selected_segments_equals_the_twin() {
    let channels: Vec<(Kind, u32)> = (1..=24).map(|segments| (Kind::F32, segments)).collect();
    let case = |channels| Case {
        what: "8 counts of segments",
        channels,
        extinctions: [-3.0, -0.5],
        early_stop: None,
    };
    check_all(14, &channels.chunks(8).map(case).collect::<Vec<_>>());
}

#[test]
fn extinctions_from_1e_minus_24_to_1e24_equal_the_twin() {
    let case = |what, channels, early_stop| Case { what, channels, extinctions: WILD, early_stop };
    check_all(
        13,
        &[
            case("wild constant", &[(Kind::Constant, 1)], None),
            case("wild scalar", &[(Kind::F32, 24)], Some(1e-3)),
            case("wild scalar to the end", &[(Kind::F32, 24)], None),
            Case {
                extinctions: [-24.0, -21.0],
                ..case("faint", &[(Kind::F32, 3), (Kind::U8, 2)], None)
            },
            case("wild channels", &[(Kind::F32, 5), (Kind::U8, 9), (Kind::Rgba8, 3)], None),
        ],
    );
}
