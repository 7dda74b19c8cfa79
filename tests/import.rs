//! Import: voxels come back bit for bit, levels are f64 means, aprons are the neighbours' voxels.

mod folder;
mod random;
mod support;

use std::path::Path;

use ashfall::error::{Exit, Result};
use ashfall::import::{Header, Input, Run, Settings, Summary, import_from};
use ashfall::source::{BrickEntry, BrickSource};
use ashfall::store::{Compression, Store, verify};
use ashfall::volume::{BrickId, Levels, Size3, ValueRange, VoxelFormat, Voxels, WorldFromVoxel};
use folder::Folder;
use proptest::prelude::*;
use random::Random;
use support::{Volume, default_settings, naive_means, settings, voxels};

/// Puts a level together out of payloads.
fn level_of(store: &Store, channel: u16, level: u8) -> Voxels {
    let description = store.description();
    let grid = description.grid(level).unwrap();
    let format = description.channels[usize::from(channel)].format;
    let width = format.bytes();
    let mut bytes = vec![0; grid.size.len().unwrap() * width];
    let mut brick = Vec::new();
    for id in description.bricks().filter(|id| id.level == level && id.channel == channel) {
        store.read(id, &mut brick).unwrap();
        let (payload, stored) = description.brick(id);
        for z in payload.start[2]..payload.end[2] {
            for y in payload.start[1]..payload.end[1] {
                let len = (payload.end[0] - payload.start[0]) as usize * width;
                let from = stored.index(1, y - payload.start[1] + 1, z - payload.start[2] + 1);
                let to = grid.size.index(payload.start[0], y, z) * width;
                bytes[to..to + len].copy_from_slice(&brick[from * width..from * width + len]);
            }
        }
    }
    Voxels::from_bytes(format, &bytes)
}

/// Bits of voxels, NaN all alike.
fn bits(voxels: &Voxels) -> Vec<u32> {
    match voxels {
        Voxels::F32(v) => v.iter().map(|v| if v.is_nan() { !0 } else { v.to_bits() }).collect(),
        Voxels::Rgba8(v) => v.iter().map(|v| u32::from_le_bytes(*v)).collect(),
        _ => (0..voxels.len()).map(|i| voxels.value(i) as i32 as u32).collect(),
    }
}

/// Steps between two f32, counted in representable numbers.
fn ulps(a: f32, b: f32) -> u64 {
    let order = |v: f32| {
        let bits = v.to_bits() as i32;
        i64::from(if bits < 0 { i32::MIN.wrapping_sub(bits) } else { bits })
    };
    order(a).abs_diff(order(b))
}

fn check_level_is_mean(level: &Voxels, means: &[(f64, f64)]) {
    match level {
        Voxels::F32(got) => {
            for (got, &(want, magnitude)) in got.iter().zip(means) {
                let same = if want.is_nan() { got.is_nan() } else { ulps(*got, want as f32) <= 1 };
                // Sums that cancel differ by the rounding of their terms, in another order.
                let near = (f64::from(*got) - want).abs() <= 1e-12 * magnitude;
                assert!(same || near, "{got} where the mean is {want}");
            }
        }
        Voxels::Rgba8(got) => {
            for (got, want) in got.iter().flatten().zip(means) {
                assert_eq!(f64::from(*got), want.0.round_ties_even());
            }
        }
        _ => {
            for (i, want) in means.iter().enumerate() {
                assert_eq!(f64::from(level.value(i)), want.0.round_ties_even());
            }
        }
    }
}

/// The definition of docs/FORMAT.md, word by word.
fn naive_loss(level: &Voxels, levels: &Levels, id: BrickId, start: [u32; 3], end: [u32; 3]) -> f64 {
    let here = levels.get(id.level).unwrap();
    let Some(next) = levels.get(id.level + 1) else { return 0.0 };
    let factor: [u32; 3] = std::array::from_fn(|axis| next.scale[axis] / here.scale[axis]);
    let (mut squares, mut count) = (0.0, 0.0);
    let begins = |axis: usize| {
        (start[axis]..end[axis]).filter(move |voxel| voxel.is_multiple_of(factor[axis]))
    };
    let size = here.size.to_array();
    for z in begins(2) {
        for y in begins(1) {
            for x in begins(0) {
                let mut cell = Vec::new();
                for k in z..(z + factor[2]).min(size[2]) {
                    for j in y..(y + factor[1]).min(size[1]) {
                        for i in x..(x + factor[0]).min(size[0]) {
                            cell.push(here.size.index(i, j, k));
                        }
                    }
                }
                let parts = if let Voxels::Rgba8(_) = level { 4 } else { 1 };
                for part in 0..parts {
                    let values: Vec<f64> = cell
                        .iter()
                        .map(|&index| match level {
                            Voxels::Rgba8(v) => f64::from(v[index][part]),
                            _ => f64::from(level.value(index)),
                        })
                        .filter(|value| !value.is_nan())
                        .collect();
                    let mean = values.iter().sum::<f64>() / values.len() as f64;
                    squares += values.iter().map(|value| (value - mean).powi(2)).sum::<f64>();
                    count += values.len() as f64;
                }
            }
        }
    }
    if count == 0.0 { 0.0 } else { (squares / count).sqrt() }
}

/// Everything the store promises about `volume`.
fn check(store: &Store, volume: &Volume) {
    let description = store.description();
    assert_eq!(description.size(), volume.size);
    let payload = description.payload;
    assert_eq!(description.levels, Levels::of(volume.size, volume.spacing, payload));
    for channel in 0..volume.channels.len() {
        let kept = volume.kept(channel);
        for (number, level) in description.levels.iter().enumerate() {
            let number = number as u8;
            let got = level_of(store, channel as u16, number);
            if number == 0 {
                assert_eq!(bits(&got), bits(&kept), "level 0 comes back bit for bit");
                assert_eq!(description.channels[channel].range, kept.range());
            }
            check_level_is_mean(&got, &naive_means(&kept, volume.size, level));
            check_bricks(store, channel as u16, number, &got);
        }
    }
}

fn check_bricks(store: &Store, channel: u16, level: u8, whole: &Voxels) {
    let description = store.description();
    let size = description.levels.get(level).unwrap().size;
    for id in description.bricks().filter(|id| id.level == level && id.channel == channel) {
        let (payload, stored) = description.brick(id);
        let (read_size, got) = store.read_voxels(id).unwrap();
        assert_eq!(read_size, stored);
        let at = |axis: usize, i: u32| {
            let voxel = i64::from(payload.start[axis]) + i64::from(i) - 1;
            voxel.clamp(0, i64::from(size.to_array()[axis]) - 1) as u32
        };
        let whole_bits = bits(whole);
        let mut want = Vec::new();
        for k in 0..stored.z {
            for j in 0..stored.y {
                for i in 0..stored.x {
                    want.push(whole_bits[size.index(at(0, i), at(1, j), at(2, k))]);
                }
            }
        }
        assert_eq!(bits(&got), want, "{id}: payload and apron are the level's voxels");
        match store.entry(id).unwrap() {
            BrickEntry::Absent => assert_eq!(got.nan_count(), got.len()),
            BrickEntry::Constant(voxel) => {
                let format = got.format();
                let voxel = Voxels::from_bytes(format, &voxel[..format.bytes()]);
                assert!(want.iter().all(|&bits_here| bits_here == bits(&voxel)[0]));
            }
            BrickEntry::Stored { range, loss } => {
                assert_eq!(range, got.range(), "{id}: the range is exact");
                assert!(want.iter().any(|&bits_here| bits_here != want[0]), "{id}: is constant");
                let naive = naive_loss(whole, &description.levels, id, payload.start, payload.end);
                let magnitude = f64::from(range.least.abs().max(range.greatest.abs()));
                let off = (f64::from(loss) - naive).abs();
                assert!(off <= 1e-6 * naive + 1e-7 * magnitude, "{id}: loss {loss}, naive {naive}");
            }
        }
    }
}

fn import_and_check(volume: &Volume, settings: &Settings) {
    let folder = Folder::in_memory();
    let path = folder.path("t.bricks");
    let summary = volume.import(&path, settings).unwrap();
    assert_eq!(folder.names(), ["t.bricks"]);
    let store = Store::open(&path).unwrap();
    assert_eq!(*store.description(), summary.description);
    check(&store, volume);
    let report = verify(&path, &|_, _| {}).unwrap();
    assert_eq!((report.damaged_bricks, report.bricks), (0, store.numbering().count()));
}

fn volume_strategy() -> impl Strategy<Value = (Volume, Settings)> {
    let size = (1u32..40, 1u32..40, 1u32..40);
    let payload = (1u32..14, 1u32..14, 1u32..14);
    let spacing = prop::sample::select(vec![
        [1.0, 1.0, 1.0],
        [0.3, 0.3, 1.0],
        [5.0, 1.0, 1.4],
        [1.0, 1.5, 0.1],
    ]);
    let how = (0usize..5, 1usize..4, 1usize..4, any::<u64>(), 0u32..8);
    (size, payload, spacing, how).prop_map(|(size, payload, spacing, how)| {
        let size = Size3::new(size.0, size.1, size.2);
        let payload = Size3::new(payload.0, payload.1, payload.2);
        let (format, channels, jobs, seed, flags) = how;
        let mut random = Random(seed);
        let format = VoxelFormat::ALL[format];
        let channels =
            (0..channels).map(|_| voxels(format, size, &mut random, flags & 1 == 1)).collect();
        let absent_slices = if random.once_in(4) {
            (0..size.z).filter(|_| random.once_in(5)).collect()
        } else {
            Vec::new()
        };
        let shuffled = flags & 2 == 2;
        let volume = Volume { size, spacing, channels, absent_slices, seed, shuffled };
        // A budget of 256 KiB sends many slices to disk.
        let ram_mib = if flags & 4 == 4 { 1 } else { 1024 };
        let compression = if random.once_in(3) { Compression::None } else { Compression::Lz4 };
        (volume, settings(payload, ram_mib, jobs, compression))
    })
}

fn cases() -> ProptestConfig {
    let cases = if std::env::var_os("ASHFALL_LONG").is_some() { 5000 } else { 150 };
    ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }
}

proptest! {
    #![proptest_config(cases())]
    #[test]
    fn random_volumes_come_back((volume, settings) in volume_strategy()) {
        import_and_check(&volume, &settings);
    }
}

#[test]
fn sizes_at_the_edges_come_back() {
    let mut random = Random(3);
    for size in
        [[1, 1, 1], [1, 1, 97], [97, 1, 1], [1, 31, 2], [33, 33, 33], [65, 34, 67], [5000, 3, 2]]
    {
        let size = Size3::from_array(size);
        for format in VoxelFormat::ALL {
            let voxels = voxels(format, size, &mut random, true);
            import_and_check(&Volume::of(size, [1.0; 3], voxels), &default_settings());
        }
    }
}

#[test]
fn the_bytes_do_not_depend_on_jobs_memory_or_the_order_of_runs() {
    let mut random = Random(5);
    let size = Size3::new(70, 45, 90);
    let voxels = voxels(VoxelFormat::I16, size, &mut random, false);
    let mut volume = Volume::of(size, [1.0; 3], voxels);
    let folder = Folder::in_memory();
    let mut made = Vec::new();
    for (jobs, ram_mib, seed) in [(1, 1024, 1), (3, 1024, 1), (2, 1, 2), (2, 1024, 9)] {
        volume.seed = seed;
        let path = folder.path("t.bricks");
        volume.import(&path, &settings(Size3::cube(16), ram_mib, jobs, Compression::Lz4)).unwrap();
        made.push(std::fs::read(&path).unwrap());
    }
    assert!(made.iter().all(|bytes| *bytes == made[0]));
}

#[test]
fn what_is_not_a_number_is_counted() {
    let size = Size3::new(3, 2, 4);
    let mut values = vec![1.0f32; 24];
    values[0] = f32::NAN;
    values[1] = f32::INFINITY;
    values[2] = f32::NEG_INFINITY;
    values[3] = f32::INFINITY;
    let mut volume = Volume::of(size, [1.0; 3], Voxels::F32(values));
    volume.absent_slices = vec![2];
    let folder = Folder::in_memory();
    let summary = volume.import(&folder.path("t.bricks"), &default_settings()).unwrap();
    let channel = &summary.description.channels[0];
    assert_eq!(channel.nan_voxels, 1);
    assert_eq!(channel.infinite_voxels, 3);
    assert_eq!(channel.absent_voxels, 6);
    assert_eq!(channel.range, ValueRange { least: f32::MIN, greatest: f32::MAX });
}

#[test]
fn absent_integers_become_f32_and_wholly_absent_bricks_are_known() {
    let size = Size3::new(8, 8, 40);
    let mut volume = Volume::of(size, [1.0; 3], Voxels::U16(vec![7; 8 * 8 * 40]));
    volume.absent_slices = (10..40).collect();
    let folder = Folder::in_memory();
    let path = folder.path("t.bricks");
    let payload = settings(Size3::cube(8), 64, 1, Compression::Lz4);
    let summary = volume.import(&path, &payload).unwrap();
    assert_eq!(summary.description.channels[0].format, VoxelFormat::F32);
    let store = Store::open(&path).unwrap();
    let id = |z| BrickId { volume: 0, channel: 0, level: 0, x: 0, y: 0, z };
    assert_eq!(store.entry(id(0)).unwrap(), BrickEntry::Constant(7f32.to_le_bytes()));
    assert_eq!(store.entry(id(4)).unwrap(), BrickEntry::Absent);
    check(&store, &volume);
}

/// An input of one run whose header may promise something else.
struct OneRun(Header, Option<Run>);

impl Input for OneRun {
    fn header(&self) -> &Header {
        &self.0
    }

    fn next_run(&mut self) -> Result<Option<Run>> {
        Ok(self.1.take())
    }
}

/// Imports 4 x 4 x 6 voxels of which a run brings the first slices.
fn import_one_run(voxels: &Voxels, absent_voxels: u64, target: &Path) -> Result<Summary> {
    let open = || {
        let header = Header {
            path: "memory".into(),
            size: Size3::new(4, 4, 6),
            channels: 1,
            times: 1,
            format: voxels.format(),
            world_from_voxel: WorldFromVoxel::from_spacing([1.0; 3]).unwrap(),
            scaling: Vec::new(),
            unit: None,
            format_name: "memory",
            notes: Vec::new(),
            absent_voxels,
        };
        let size = Size3::new(4, 4, voxels.len() as u32 / 16);
        let run = Run { channel: 0, start: [0; 3], size, voxels: voxels.clone() };
        Ok(Box::new(OneRun(header, Some(run))) as Box<dyn Input>)
    };
    import_from(&open, target, &default_settings(), &mut |_, _| {})
}

#[test]
fn an_input_that_ends_early_is_refused() {
    let folder = Folder::in_memory();
    let path = folder.path("t.bricks");
    let why = import_one_run(&Voxels::U8(vec![1; 80]), 0, &path).unwrap_err();
    assert_eq!(why.exit, Exit::Input);
    assert!(why.message.contains("16 of 96 voxels"), "{}", why.message);
    assert!(folder.names().is_empty(), "nothing is left behind");
}

#[test]
fn absent_voxels_that_come_as_nan_are_not_counted_twice() {
    let folder = Folder::in_memory();
    let mut values = vec![2.0f32; 80];
    values[..20].fill(f32::NAN);
    // Of the 20 NaN, 8 stand for voxels that the file does not have; 16 more never come.
    let path = folder.path("t.bricks");
    let summary = import_one_run(&Voxels::F32(values), 24, &path).unwrap();
    let channel = &summary.description.channels[0];
    assert_eq!((channel.nan_voxels, channel.absent_voxels), (12, 24));
}

#[test]
fn a_run_outside_the_volume_is_a_sentence() {
    let folder = Folder::in_memory();
    let why = import_one_run(&Voxels::U8(vec![1; 112]), 0, &folder.path("t.bricks")).unwrap_err();
    assert!(why.message.contains("outside the volume"), "{}", why.message);
    assert!(folder.names().is_empty());
}
