//! A volume in memory against a store of the same voxels: every brick, entry and description, to the
//! last bit.

mod folder;
mod random;
mod support;

use std::sync::Arc;

use ashfall::import::DenseVolume;
use ashfall::source::{BrickEntry, BrickSource, Description};
use ashfall::store::{Compression, Store};
use ashfall::volume::{
    BrickId, ChannelVoxels, Size3, VolumeVoxels, VoxelFormat, Voxels, WorldFromVoxel,
};
use folder::Folder;
use random::Random;
use rayon::prelude::*;
use support::{Volume, settings, voxels};

fn in_memory(volume: &Volume) -> Arc<VolumeVoxels> {
    let channel =
        |voxels: &Voxels| ChannelVoxels { voxels: voxels.clone(), slope: 1.0, intercept: 0.0 };
    Arc::new(VolumeVoxels {
        size: volume.size,
        world_from_voxel: WorldFromVoxel::from_spacing(volume.spacing).unwrap(),
        channels: volume.channels.iter().map(channel).collect(),
    })
}

fn imported(volume: &Volume, payload: Size3, folder: &Folder) -> Store {
    let path = folder.path("t.bricks");
    volume.import(&path, &settings(payload, 64, 2, Compression::Lz4)).unwrap();
    Store::open(&path).unwrap()
}

/// Loss and range by their bits.
fn bits(entry: BrickEntry) -> (u8, [u32; 3]) {
    match entry {
        BrickEntry::Absent => (0, [0; 3]),
        BrickEntry::Constant(voxel) => (1, [u32::from_le_bytes(voxel), 0, 0]),
        BrickEntry::Stored { range, loss } => {
            // Whether a range ends at 0 or at -0 is not said by anyone.
            let ends = [range.least + 0.0, range.greatest + 0.0, loss];
            (2, ends.map(f32::to_bits))
        }
    }
}

fn compare(volume: &Volume, payload: Size3) {
    let folder = Folder::in_memory();
    let store = imported(volume, payload, &folder);
    let dense = DenseVolume::new("test", in_memory(volume), payload);
    let what = format!("{} of {} in {payload}", volume.size, volume.format());
    let of_store = store.description();
    let told = Description {
        unit: of_store.unit.clone(),
        provenance: of_store.provenance.clone(),
        ..dense.description().clone()
    };
    assert_eq!(&told, of_store, "{what}");
    let (mut got, mut want) = (Vec::new(), vec![1]);
    for id in of_store.bricks() {
        dense.read(id, &mut got).unwrap();
        store.read(id, &mut want).unwrap();
        assert!(got == want, "{what}: {id} has other bytes");
        let [a, b] = [dense.entry(id).unwrap(), store.entry(id).unwrap()];
        assert_eq!(bits(a), bits(b), "{what}: {id}: {a:?} where the store has {b:?}");
        assert_eq!(bits(a), bits(dense.entry(id).unwrap()), "{what}: {id}: twice the same");
    }
}

#[test]
fn every_brick_and_entry_is_a_stores() {
    let mut random = Random(31);
    let shapes: [([u32; 3], [f64; 3], Size3); 9] = [
        ([70, 45, 90], [1.0, 1.0, 1.0], Size3::cube(32)),
        ([67, 33, 35], [0.3, 0.3, 1.0], Size3::cube(16)),
        ([37, 21, 29], [5.0, 1.0, 1.4], Size3::new(8, 8, 5)),
        ([33, 31, 32], [1.0, 1.5, 0.1], Size3::new(7, 13, 3)),
        ([9, 11, 10], [1.0, 1.0, 1.0], Size3::cube(1)),
        ([1, 1, 97], [1.0, 1.0, 1.0], Size3::cube(8)),
        ([97, 1, 1], [1.0, 2.0, 3.0], Size3::cube(8)),
        ([1, 31, 2], [1.0, 1.0, 1.0], Size3::cube(4)),
        ([1, 1, 1], [1.0, 1.0, 1.0], Size3::cube(32)),
    ];
    for (size, spacing, payload) in shapes {
        let size = Size3::from_array(size);
        for format in VoxelFormat::ALL {
            for wild in [false, true] {
                let mut volume = Volume::of(size, spacing, voxels(format, size, &mut random, wild));
                volume.channels.push(voxels(format, size, &mut random, wild));
                compare(&volume, payload);
            }
        }
    }
}

/// Large plateaus and NaN: bricks that are constant or absent, at level 0 and above it.
#[test]
fn empty_and_constant_bricks_are_known() {
    let size = Size3::new(64, 48, 80);
    let value = |index: usize| match index / (64 * 48) {
        // One of the other NaN.
        0..24 => f32::from_bits(0xFFC0_0001),
        24..64 => -0.0,
        slice => (index % 7) as f32 * slice as f32,
    };
    let values = Voxels::F32((0..size.len().unwrap()).map(value).collect());
    let volume = Volume::of(size, [1.0; 3], values);
    compare(&volume, Size3::cube(8));
    let dense = DenseVolume::new("test", in_memory(&volume), Size3::cube(8));
    let entries = |level| {
        let bricks = dense.description().bricks().filter(move |id| id.level == level);
        bricks.map(|id| dense.entry(id).unwrap()).collect::<Vec<_>>()
    };
    for level in [0, 1] {
        let entries = entries(level);
        assert!(entries.contains(&BrickEntry::Absent), "level {level}");
        assert!(entries.iter().any(|entry| matches!(entry, BrickEntry::Constant(_))));
        assert!(entries.iter().any(|entry| matches!(entry, BrickEntry::Stored { .. })));
    }
}

#[test]
fn channels_of_several_formats_stand_side_by_side() {
    let size = Size3::new(41, 19, 27);
    let mut random = Random(8);
    let of = |format, random: &mut Random| {
        Volume::of(size, [1.0, 1.0, 2.0], voxels(format, size, random, true))
    };
    let parts = VoxelFormat::ALL.map(|format| of(format, &mut random));
    let mut all = parts[0].clone();
    all.channels = parts.iter().map(|part| part.channels[0].clone()).collect();
    let dense = DenseVolume::new("all", in_memory(&all), Size3::cube(8));
    for id in dense.description().bricks() {
        let part = &parts[usize::from(id.channel)];
        assert_eq!(dense.description().channels[usize::from(id.channel)].format, part.format());
    }
    for (channel, part) in parts.iter().enumerate() {
        let alone = DenseVolume::new("one", in_memory(part), Size3::cube(8));
        for id in alone.description().bricks() {
            let here = BrickId { channel: channel as u16, ..id };
            assert!(
                dense.read_voxels(here).unwrap().1.bytes()
                    == alone.read_voxels(id).unwrap().1.bytes()
            );
            assert_eq!(bits(dense.entry(here).unwrap()), bits(alone.entry(id).unwrap()));
        }
    }
}

#[test]
fn level_0_is_not_copied() {
    let mut random = Random(2);
    let size = Size3::new(20, 20, 20);
    for format in VoxelFormat::ALL {
        let given =
            in_memory(&Volume::of(size, [1.0; 3], voxels(format, size, &mut random, false)));
        let dense = DenseVolume::new("test", given.clone(), Size3::cube(8));
        assert!(Arc::ptr_eq(dense.voxels(), &given), "{format}");
    }
    let wild =
        in_memory(&Volume::of(size, [1.0; 3], voxels(VoxelFormat::F32, size, &mut random, true)));
    let before = wild.clone();
    let dense = DenseVolume::new("test", wild.clone(), Size3::cube(8));
    assert!(!Arc::ptr_eq(dense.voxels(), &wild), "voxels of others are left as they were");
    let bytes = |voxels: &VolumeVoxels| voxels.channels[0].voxels.bytes().to_vec();
    assert_eq!(bytes(&before), bytes(&wild));
}

/// More askers than threads, all of one pool, all at the levels that are not made yet.
#[test]
fn many_threads_of_one_pool_may_ask_first() {
    let size = Size3::new(120, 110, 100);
    let given = in_memory(&Volume::of(
        size,
        [1.0; 3],
        voxels(VoxelFormat::U16, size, &mut Random(4), false),
    ));
    let dense = DenseVolume::new("test", given, Size3::cube(8));
    let ids: Vec<BrickId> = dense.description().bricks().filter(|id| id.level > 0).collect();
    let read = |id: &BrickId| dense.read_voxels(*id).unwrap().1.len();
    let voxels: usize = ids.par_iter().map(read).sum();
    assert!(voxels > 0);
}
