//! probe.comp against twins::probe: sums along lines through random images.

use ashfall::passes::march_shape::FilterShape;
use ashfall::passes::probe::ProbeShape;
use ashfall::twins::filter::Texels;
use ashfall::twins::probe::{Push, probe};

use crate::common::device::{Device, device};
use crate::random::Random;
use crate::texels::{Conversion, Raw, Texture, sums};

const SIZE: [u32; 3] = [13, 9, 7];

fn textures(random: &mut Random) -> [Texture; 3] {
    let count = SIZE.iter().product::<u32>() as usize;
    let mut units = || -> Vec<f64> { (0..count).map(|_| random.unit()).collect() };
    [
        Raw::U8(units().into_iter().map(|unit| (unit * 256.0) as u8).collect()),
        Raw::U16(units().into_iter().map(|unit| (unit * 65536.0) as u16).collect()),
        Raw::F32(units().into_iter().map(|unit| (unit * 2e3 - 1e3) as f32).collect()),
    ]
    .map(|raw| Texture { size: SIZE, raw })
}

/// Lines that stay inside the image: each sample of each line, apron included.
fn lines(samples: u32) -> Push {
    Push {
        origin_voxel: [-0.7, -0.3, -0.9],
        lines_across: 21,
        column_voxel: [0.21, 0.03, 0.01],
        lines_down: 10,
        row_voxel: [0.05, 0.33, 0.02],
        samples,
        step_voxel: [0.07, 0.04, 0.05],
    }
}

/// One sample has equal bits on a CPU. Of several, Mesa adds the two halves of a value to the sum one
/// after the other (it prefers sums that end in a product): each addition rounds by 2^-24 of the sum.
/// Elsewhere drivers may also join the multiplications and additions of positions and weights: each
/// sample is then off by a few 2^-24 of the position's size times the difference of neighbours.
fn compare(device: &Device, got: &[f32], wanted: &[f32], range: f32, push: &Push, what: &str) {
    assert_eq!(got.len(), wanted.len(), "{what}");
    let samples = push.samples as f32;
    let of_sum = 2.0 * samples * samples * range / (1 << 24) as f32;
    let of_samples = if device.same_bits() { 0.0 } else { samples * 1e-5 * range };
    for (line, (got, wanted)) in got.iter().zip(wanted).enumerate() {
        if device.same_bits() && push.samples == 1 {
            assert_eq!(got.to_bits(), wanted.to_bits(), "{what}, line {line}");
        }
        let error = (got - wanted).abs();
        assert!(error <= of_sum + of_samples, "{what}, line {line}: {got} {wanted}");
    }
}

#[test]
fn sums_of_both_arithmetic_filters_equal_the_twin() {
    let Some(device) = device() else { return };
    let conversion = Conversion::measured(&device);
    let mut random = Random(2);
    for (texture, range) in textures(&mut random).iter().zip([1.0, 1.0, 2e3]) {
        let values = conversion.scalars(&texture.raw);
        for samples in [1, 2, 60] {
            let push = lines(samples);
            let wanted = probe(&Texels { size: SIZE, texels: &values }, &push);
            let mut other = None;
            for filter in [FilterShape::Fetch, FilterShape::Quads] {
                let image = texture.image(&device, filter);
                let got = sums(&device, ProbeShape::Filtered(filter), &image, &push);
                let what = format!("{filter:?}, {samples} samples");
                compare(&device, &got, &wanted, range, &push, &what);
                if device.same_bits() {
                    let other = other.get_or_insert_with(|| got.clone());
                    assert_eq!(*other, got, "{what}: both filters give the same bits");
                }
            }
        }
    }
}

/// Without a filter: the texel itself, and how far into its cell the position lies along x.
#[test]
fn one_texel_and_the_bare_loop_equal_plain_sums() {
    let Some(device) = device() else { return };
    let conversion = Conversion::measured(&device);
    let texture = &textures(&mut Random(3))[2];
    let values = conversion.scalars(&texture.raw);
    let image = texture.image(&device, FilterShape::Fetch);
    let push = lines(60);
    let sum = |line: u32, sample: &dyn Fn([f32; 3], [f32; 3]) -> f32| {
        let (x, y) = ((line % 21) as f32, (line / 21) as f32);
        let start: [f32; 3] = std::array::from_fn(|a| {
            push.origin_voxel[a] + x * push.column_voxel[a] + y * push.row_voxel[a]
        });
        let mut sum = 0.0f32;
        for index in 0..60 {
            let position: [f32; 3] =
                std::array::from_fn(|a| start[a] + index as f32 * push.step_voxel[a]);
            let cell = position.map(f32::floor);
            sum += sample(cell, std::array::from_fn(|a| position[a] - cell[a]));
        }
        sum
    };
    let texel = |cell: [f32; 3], within: [f32; 3]| {
        let [x, y, z] = cell.map(|c| (c + 1.0) as usize);
        values[(z * SIZE[1] as usize + y) * SIZE[0] as usize + x] + within[0]
    };
    let bare = |_: [f32; 3], within: [f32; 3]| within[0] + within[1] + within[2];
    let wanted: Vec<f32> = (0..210).map(|line| sum(line, &texel)).collect();
    let got = sums(&device, ProbeShape::OneTexel, &image, &push);
    // Elsewhere a position beside an integer may find the neighbouring texel.
    if device.same_bits() {
        compare(&device, &got, &wanted, 2e3, &push, "one texel");
    }
    let wanted: Vec<f32> = (0..210).map(|line| sum(line, &bare)).collect();
    let got = sums(&device, ProbeShape::Loop, &image, &push);
    compare(&device, &got, &wanted, 3.0, &push, "loop");
}

/// STACK section 3: this driver's own filter is as good as arithmetic for 16 and 32 bits and 1.5 of 255 steps off for
/// 8; other devices have weights of 8 bits, so 1/256 of the range for each of three axes.
#[test]
fn the_sampler_is_within_its_measured_error() {
    let Some(device) = device() else { return };
    let conversion = Conversion::measured(&device);
    let lavapipe = [8e-3, 1e-6, 1e-6];
    let elsewhere = [3.0 / 256.0; 3];
    let textures = textures(&mut Random(4));
    for (index, (texture, range)) in textures.iter().zip([1.0, 1.0, 2e3]).enumerate() {
        let values = conversion.scalars(&texture.raw);
        let push = lines(1);
        let wanted = probe(&Texels { size: SIZE, texels: &values }, &push);
        let filter = FilterShape::Sampler;
        let image = texture.image(&device, filter);
        let got = sums(&device, ProbeShape::Filtered(filter), &image, &push);
        let bound = if device.same_bits() { lavapipe[index] } else { elsewhere[index] };
        let error = got.iter().zip(&wanted).map(|(g, w)| (g - w).abs() / range);
        let worst = error.fold(0.0, f32::max);
        eprintln!("sampler, texture {index}: worst error {worst:e} of the range");
        assert!(worst <= bound, "texture {index}: {worst:e}");
        assert!(worst > 0.0, "texture {index}: the sampler cannot equal our arithmetic everywhere");
    }
}
