//! Every file that a reader opens comes back from a store, voxel for voxel, with its transform; a store
//! is itself such a file.

mod folder;
mod random;
mod support;
mod truth;

use std::path::{Path, PathBuf};

use ashfall::import::{Options, import, open, read_whole};
use ashfall::source::BrickSource;
use ashfall::store::{Compression, Store};
use ashfall::volume::{Size3, VolumeVoxels, Voxels};
use folder::Folder;
use random::Random;
use support::{Volume, default_settings, settings, voxels};

/// All channels of any readable file.
fn whole(path: &Path) -> VolumeVoxels {
    let mut input = open(path, &Options::default()).unwrap();
    let channels: Vec<u32> = (0..input.header().channels).collect();
    read_whole(&mut *input, &channels, 1 << 30).unwrap()
}

/// The same voxels: NaN and absence alike, infinities clamped.
fn assert_same(kept: &VolumeVoxels, read: &VolumeVoxels, path: &Path) {
    assert_eq!((kept.size, kept.channels.len()), (read.size, read.channels.len()));
    assert_eq!(kept.world_from_voxel.rows(), read.world_from_voxel.rows(), "{}", path.display());
    for (kept, read) in kept.channels.iter().zip(&read.channels) {
        assert_eq!((kept.slope, kept.intercept), (read.slope, read.intercept));
        match (&kept.voxels, &read.voxels) {
            (Voxels::F32(kept), Voxels::F32(read)) => {
                let bits = |v: f32| if v.is_nan() { !0 } else { v.to_bits() };
                let clamped = |v: f32| ashfall::volume::sanitized(v);
                assert!(
                    kept.iter().zip(read).all(|(&a, &b)| bits(a) == bits(clamped(b))),
                    "{}",
                    path.display()
                );
            }
            (kept, read) => assert!(kept == read, "{}", path.display()),
        }
    }
}

fn files(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let zarr = path.extension().is_some_and(|extension| extension == "zarr");
        if path.is_dir() && !zarr {
            files(&path, found);
        } else if path.is_file() {
            found.push(path);
        }
    }
}

#[test]
fn files_of_every_format_come_back_from_their_stores() {
    let Some(shared) = truth::shared() else { return };
    let folder = Folder::in_memory();
    let mut found = Vec::new();
    files(&shared.join("data/volumes"), &mut found);
    let mut imported = 0;
    for path in found {
        // Raw files, headers' data files and lists open with more than their own name alone.
        if open(&path, &Options::default()).is_err() {
            continue;
        }
        let store = folder.path("file.bricks");
        let mut quiet = |_, _| {};
        import(&path, &Options::default(), &store, &default_settings(), &mut quiet).unwrap();
        assert_same(&whole(&store), &whole(&path), &path);
        let unit = open(&path, &Options::default()).unwrap().header().unit.clone();
        assert_eq!(Store::open(&store).unwrap().description().unit, unit);
        imported += 1;
    }
    assert!(imported >= 12, "only {imported} files were imported");
}

#[test]
fn a_store_is_an_input_like_any_other() {
    let folder = Folder::in_memory();
    let size = Size3::new(50, 41, 37);
    for format in ashfall::volume::VoxelFormat::ALL {
        let mut volume =
            Volume::of(size, [1.0, 2.0, 0.5], voxels(format, size, &mut Random(9), true));
        volume.channels.push(voxels(format, size, &mut Random(10), true));
        let [first, second] = ["a.bricks", "b.bricks"].map(|name| folder.path(name));
        volume.import(&first, &settings(Size3::cube(8), 64, 2, Compression::Lz4)).unwrap();
        // Into other bricks, which asks for slices in another order than they come.
        let other = settings(Size3::new(5, 16, 3), 64, 2, Compression::None);
        import(&first, &Options::default(), &second, &other, &mut |_, _| {}).unwrap();
        assert_same(&whole(&second), &whole(&first), &second);
        let kept = volume.kept(0);
        let bits = |voxels: &Voxels| {
            (0..voxels.len())
                .map(|i| if voxels.value(i).is_nan() { !0 } else { voxels.value(i).to_bits() })
                .collect::<Vec<_>>()
        };
        assert_eq!(bits(&whole(&second).channels[0].voxels), bits(&kept));
    }
}

#[test]
fn the_path_of_a_damaged_store_is_named_once() {
    let folder = Folder::in_memory();
    let size = Size3::cube(4);
    let path = folder.path("a.bricks");
    let volume = Volume::of(size, [1.0; 3], Voxels::U8(vec![3; 64]));
    volume.import(&path, &default_settings()).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() - 1]).unwrap();
    let why = open(&path, &Options::default()).map(|_| ()).unwrap_err();
    assert_eq!(why.message.matches("a.bricks").count(), 1, "{}", why.message);
}
