//! One contract for every `BrickSource`, and what the faulty ones do on purpose.

mod folder;
mod random;
mod support;

use std::collections::HashMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use ashfall::error::Exit;
use ashfall::import::DenseVolume;
use ashfall::source::faulty::{Corrupt, Failing, Faulty, Short, Slow, Stalling};
use ashfall::source::{BrickEntry, BrickSource, Field, FieldSource, KINDS, computed, read_checked};
use ashfall::store::{Compression, Store};
use ashfall::volume::{
    BrickId, ChannelVoxels, Levels, Size3, ValueRange, VolumeVoxels, VoxelFormat, Voxels,
    WorldFromVoxel,
};
use folder::Folder;
use random::Random;
use support::{Volume, settings, voxels};

/// A ramp that is 0 in the lower half of x: bounds are exact and cost nothing.
struct Ramp {
    format: VoxelFormat,
    size: Size3,
}

impl Ramp {
    fn value(&self, x: u32, y: u32, z: u32) -> u32 {
        if x < self.size.x / 2 { 0 } else { (x - self.size.x / 2 + 2 * y + 3 * z) / 64 }
    }
}

impl Field for Ramp {
    fn format(&self) -> VoxelFormat {
        self.format
    }

    fn fill(&self, start: [u32; 3], size: Size3, stride: [u32; 3]) -> Voxels {
        let mut values = Vec::new();
        for k in 0..size.z {
            for j in 0..size.y {
                for i in 0..size.x {
                    let [x, y, z] = [i, j, k];
                    let [x, y, z] = [
                        start[0] + x * stride[0],
                        start[1] + y * stride[1],
                        start[2] + z * stride[2],
                    ];
                    assert!(x < self.size.x && y < self.size.y && z < self.size.z, "outside");
                    values.push(self.value(x, y, z));
                }
            }
        }
        match self.format {
            VoxelFormat::U16 => Voxels::U16(values.into_iter().map(|v| v as u16).collect()),
            _ => Voxels::F32(values.into_iter().map(|v| v as f32).collect()),
        }
    }

    fn bounds(&self, start: [u32; 3], size: Size3) -> ValueRange {
        let [x, y, z] = start;
        let last = self.value(x + size.x - 1, y + size.y - 1, z + size.z - 1);
        ValueRange { least: self.value(x, y, z) as f32, greatest: last as f32 }
    }
}

fn ramp(format: VoxelFormat, size: Size3) -> FieldSource<Ramp> {
    let world = WorldFromVoxel::from_spacing([1.0, 1.0, 2.0]).unwrap();
    FieldSource::new("ramp", Ramp { format, size }, size, Size3::new(8, 16, 32), world)
}

/// Some bricks of every level: all when they are few, else corners and a random choice.
fn chosen(source: &dyn BrickSource, random: &mut Random) -> Vec<BrickId> {
    let description = source.description();
    let mut chosen = Vec::new();
    for level in 0..description.levels.count() as u8 {
        let bricks = description.grid(level).unwrap().bricks();
        for channel in 0..description.channels.len() as u16 {
            let id = |x, y, z| BrickId { volume: 0, channel, level, x, y, z };
            if bricks.voxel_count() <= 64 {
                for z in 0..bricks.z {
                    for y in 0..bricks.y {
                        chosen.extend((0..bricks.x).map(|x| id(x, y, z)));
                    }
                }
                continue;
            }
            chosen.push(id(0, 0, 0));
            chosen.push(id(bricks.x - 1, bricks.y - 1, bricks.z - 1));
            for _ in 0..12 {
                let [x, y, z] = bricks.to_array().map(|n| random.below(u64::from(n)) as u32);
                chosen.push(id(x, y, z));
            }
        }
    }
    chosen
}

/// The contract of `BrickSource`.
fn check_contract(source: &dyn BrickSource) {
    let description = source.description();
    let spacing = description.world_from_voxel.spacing().to_array();
    assert_eq!(description.levels, Levels::of(description.size(), spacing, description.payload));
    assert!(!description.channels.is_empty());
    let mut random = Random(6);
    let mut read: HashMap<BrickId, Voxels> = HashMap::new();
    for id in chosen(source, &mut random) {
        let format = description.channels[usize::from(id.channel)].format;
        let width = format.bytes();
        let entry = source.entry(id).unwrap();
        let mut bytes = vec![1, 2, 3];
        source.read(id, &mut bytes).unwrap();
        assert_eq!(bytes.len(), description.brick_bytes(id), "{id}");
        let mut again = Vec::new();
        read_checked(source, id, &mut again).unwrap();
        assert_eq!(bytes, again, "{id}: reading twice gives the same bytes");
        let got = Voxels::from_bytes(format, &bytes);
        let range = got.range();
        match entry {
            BrickEntry::Absent => assert_eq!(got.nan_count(), got.len()),
            BrickEntry::Constant(voxel) => {
                assert!(bytes.chunks_exact(width).all(|bytes| *bytes == voxel[..width]), "{id}");
                assert!(voxel[width..].iter().all(|&byte| byte == 0));
            }
            BrickEntry::Stored { range: known, loss } => {
                assert!(range.is_empty() || known.least <= range.least, "{id}");
                assert!(range.is_empty() || known.greatest >= range.greatest, "{id}");
                assert!(loss.is_nan() || loss >= 0.0, "{id}");
            }
        }
        let whole = description.channels[usize::from(id.channel)].range;
        assert!(id.level > 0 || range.is_empty() || whole.least <= range.least);
        assert!(id.level > 0 || range.is_empty() || whole.greatest >= range.greatest);
        check_apron(source, id, &got, &mut read);
    }
    let levels = description.levels.count() as u8;
    let good = BrickId { volume: 0, channel: 0, level: 0, x: 0, y: 0, z: 0 };
    for bad in [
        BrickId { level: levels, ..good },
        BrickId { channel: description.channels.len() as u16, ..good },
        BrickId { x: u32::MAX, ..good },
        BrickId { z: description.grid(0).unwrap().bricks().z, ..good },
    ] {
        assert_eq!(source.entry(bad).unwrap_err().exit, Exit::Input, "{bad}");
        assert_eq!(source.read(bad, &mut Vec::new()).unwrap_err().exit, Exit::Input, "{bad}");
    }
    read_from_many_threads(source);
}

/// Each stored voxel equals the payload voxel of whichever brick owns it.
fn check_apron(
    source: &dyn BrickSource,
    id: BrickId,
    got: &Voxels,
    read: &mut HashMap<BrickId, Voxels>,
) {
    let description = source.description();
    let (payload, stored) = description.brick(id);
    let size = description.levels.get(id.level).unwrap().size.to_array();
    let edge = description.payload.to_array();
    let width = got.format().bytes();
    let on_face = |i: u32, len: u32| i == 0 || i == len - 1;
    for k in 0..stored.z {
        for j in 0..stored.y {
            for i in 0..stored.x {
                if !on_face(i, stored.x) && !on_face(j, stored.y) && !on_face(k, stored.z) {
                    continue;
                }
                let voxel: [u32; 3] = std::array::from_fn(|axis| {
                    let at = i64::from(payload.start[axis]) + i64::from([i, j, k][axis]) - 1;
                    at.clamp(0, i64::from(size[axis]) - 1) as u32
                });
                let [x, y, z] = std::array::from_fn(|axis| voxel[axis] / edge[axis]);
                let owner = BrickId { x, y, z, ..id };
                let (owner_payload, owner_stored) = description.brick(owner);
                let voxels =
                    read.entry(owner).or_insert_with(|| source.read_voxels(owner).unwrap().1);
                let at: [u32; 3] =
                    std::array::from_fn(|axis| voxel[axis] - owner_payload.start[axis] + 1);
                let want = owner_stored.index(at[0], at[1], at[2]) * width;
                let have = stored.index(i, j, k) * width;
                assert_eq!(
                    got.bytes()[have..have + width],
                    voxels.bytes()[want..want + width],
                    "{id}: voxel {i} {j} {k} is not that of {owner}"
                );
            }
        }
    }
}

fn read_from_many_threads(source: &dyn BrickSource) {
    let ids: Vec<_> = source.description().bricks().take(40).collect();
    let read = |&id: &BrickId| source.read_voxels(id).unwrap().1.bytes().to_vec();
    let one: Vec<_> = ids.iter().map(read).collect();
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| assert_eq!(ids.iter().map(read).collect::<Vec<_>>(), one));
        }
    });
}

fn stores(folder: &Folder) -> Vec<Store> {
    let mut random = Random(21);
    let mut stores = Vec::new();
    for format in VoxelFormat::ALL {
        let size = Size3::new(37, 21, 29);
        let mut volume = Volume::of(size, [1.0, 1.0, 2.0], voxels(format, size, &mut random, true));
        volume.channels.push(voxels(format, size, &mut random, true));
        if format == VoxelFormat::F32 {
            volume.absent_slices = (0..14).collect();
        }
        let path = folder.path(&format!("{format}.bricks"));
        let payload = settings(Size3::new(8, 8, 5), 64, 2, Compression::Lz4);
        volume.import(&path, &payload).unwrap();
        stores.push(Store::open(&path).unwrap());
    }
    stores
}

#[test]
fn stores_keep_the_contract() {
    let folder = Folder::in_memory();
    for store in stores(&folder) {
        check_contract(&store);
    }
}

#[test]
fn dense_volumes_keep_the_contract() {
    let mut random = Random(22);
    let size = Size3::new(37, 21, 29);
    let world_from_voxel = WorldFromVoxel::from_spacing([1.0, 1.0, 2.0]).unwrap();
    for format in VoxelFormat::ALL {
        let channel = |voxels| ChannelVoxels { voxels, slope: 2.0, intercept: -1.0 };
        let channels = (0..2).map(|_| channel(voxels(format, size, &mut random, true))).collect();
        let whole = Arc::new(VolumeVoxels { size, world_from_voxel, channels });
        check_contract(&DenseVolume::new("dense", whole, Size3::new(8, 8, 5)));
    }
}

#[test]
fn computed_fields_keep_the_contract() {
    check_contract(&ramp(VoxelFormat::U16, Size3::new(61, 33, 70)));
    check_contract(&ramp(VoxelFormat::F32, Size3::new(1, 1, 1)));
    check_contract(&ramp(VoxelFormat::U16, Size3::cube(4096)));
    check_contract(&ramp(VoxelFormat::F32, Size3::new(4097, 9000, 64)));
}

#[test]
fn computed_volumes_of_every_kind_keep_the_contract() {
    for kind in KINDS {
        for size in [Size3::new(40, 25, 33), Size3::cube(4096)] {
            let field = computed(kind, size).unwrap();
            let world = WorldFromVoxel::from_spacing([1.0; 3]).unwrap();
            check_contract(&FieldSource::new(kind, field, size, Size3::cube(8), world));
        }
    }
}

#[test]
fn coarse_levels_of_fields_are_sampled_next_to_the_coarse_voxel_s_centre() {
    let source = ramp(VoxelFormat::U16, Size3::new(61, 33, 70));
    let description = source.description();
    for id in description.bricks() {
        let level = description.levels.get(id.level).unwrap();
        let (payload, stored) = description.brick(id);
        let (_, got) = source.read_voxels(id).unwrap();
        let voxel = [payload.end[0] - 1, payload.start[1], payload.start[2]];
        let size = description.size().to_array();
        let [x, y, z] = std::array::from_fn(|axis| {
            (voxel[axis] * level.scale[axis] + level.scale[axis] / 2).min(size[axis] - 1)
        });
        let want = Ramp { format: VoxelFormat::U16, size: description.size() }.value(x, y, z);
        assert_eq!(got.value(stored.index(stored.x - 2, 1, 1)), want as f32, "{id}");
    }
}

#[test]
fn empty_space_of_a_field_is_known_without_evaluating_it() {
    let source = ramp(VoxelFormat::U16, Size3::cube(4096));
    let id = BrickId { volume: 0, channel: 0, level: 0, x: 3, y: 100, z: 100 };
    assert_eq!(source.entry(id).unwrap(), BrickEntry::Constant([0; 4]));
}

#[test]
fn wrappers_that_do_no_harm_keep_the_contract() {
    let field = || ramp(VoxelFormat::U16, Size3::new(30, 20, 40));
    check_contract(&Faulty::new(field(), Slow(Duration::ZERO)));
    check_contract(&Faulty::new(field(), Failing(0)));
    check_contract(&Faulty::new(field(), Short(0)));
    let stalling = Faulty::new(field(), Stalling::default());
    stalling.fault.go_on();
    check_contract(&stalling);
}

fn first() -> BrickId {
    BrickId { volume: 0, channel: 0, level: 0, x: 0, y: 0, z: 0 }
}

#[test]
fn slow_reads_take_their_time() {
    let source =
        Faulty::new(ramp(VoxelFormat::U16, Size3::cube(8)), Slow(Duration::from_millis(20)));
    let start = Instant::now();
    source.read(first(), &mut Vec::new()).unwrap();
    assert!(start.elapsed() >= Duration::from_millis(20));
}

#[test]
fn every_nth_read_fails_and_the_next_succeeds() {
    let source = Faulty::new(ramp(VoxelFormat::U16, Size3::cube(8)), Failing(3));
    let mut bytes = Vec::new();
    let outcomes: Vec<bool> = (0..7).map(|_| source.read(first(), &mut bytes).is_ok()).collect();
    assert_eq!(outcomes, [true, true, false, true, true, false, true]);
    assert_eq!(source.reads(), 7);
}

#[test]
fn short_and_corrupt_bricks_are_noticed_by_a_checked_read() {
    let size = Size3::new(128, 64, 64);
    let id = BrickId { x: 10, ..first() };
    let mut bytes = Vec::new();
    let short = Faulty::new(ramp(VoxelFormat::U16, size), Short(1));
    let why = read_checked(&short, id, &mut bytes).unwrap_err();
    assert!(why.message.contains("x 10") && why.message.contains("bytes"), "{}", why.message);
    let corrupt = Faulty::new(ramp(VoxelFormat::U16, size), Corrupt);
    let noticed = (0..50).filter(|_| read_checked(&corrupt, id, &mut bytes).is_err()).count();
    assert_eq!(noticed, 50, "values of a few hundred do not survive a flipped byte in range");
}

#[test]
fn stalled_reads_go_on_when_told() {
    let source = Faulty::new(ramp(VoxelFormat::U16, Size3::cube(8)), Stalling::default());
    std::thread::scope(|scope| {
        let reading = scope.spawn(|| source.read(first(), &mut Vec::new()));
        while source.reads() == 0 {
            std::thread::yield_now();
        }
        std::thread::sleep(Duration::from_millis(20));
        assert!(!reading.is_finished(), "it waits");
        source.fault.go_on();
        reading.join().unwrap().unwrap();
    });
}
