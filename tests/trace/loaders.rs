//! What loaders do with a brick, part by part: read, decode, inspect.

use std::path::PathBuf;

use crate::binary::ashfall;
use crate::common::drawing::Device;
use crate::file::{Read, Span, parse};
use crate::folder::Folder;

/// 64 voxels an edge: one half of the bricks packs well, the other not at all.
fn store(folder: &Folder) -> PathBuf {
    let voxel = |at: u32| {
        let [x, y, z] = [at % 64, at / 64 % 64, at / 4096];
        let noise = at.wrapping_mul(2_654_435_761) >> 24;
        let value = if z < 32 { 40 + x + y } else { noise };
        value as u8
    };
    let raw = folder.write("volume.raw", (0..64 * 64 * 64).map(voxel).collect::<Vec<u8>>());
    let store = folder.path("volume.bricks");
    let raw_flags = ["--raw-size", "64x64x64", "--raw-type", "u8", "--brick", "16"];
    let mut arguments = vec!["import".into(), raw.into_os_string(), "-o".into()];
    arguments.push(store.clone().into_os_string());
    arguments.extend(raw_flags.map(Into::into));
    let run = ashfall(arguments);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    store
}

/// Draws it through a few slots, so that bricks come and go, in a RAM cache that holds them not.
fn traced(folder: &Folder, flags: &[&str]) -> Read {
    let (store, trace) = (store(folder), folder.path("trace.json"));
    let mut arguments = vec!["render".into(), store.into_os_string(), "-o".into()];
    arguments.push(folder.path("picture.png").into_os_string());
    arguments.extend(["--trace".into(), trace.clone().into_os_string()]);
    let fixed =
        ["--addressing", "paged", "--atlas-slots", "12", "--size", "48x40", "--level-max", "0"];
    arguments.extend(fixed.iter().chain(flags).map(Into::into));
    let run = ashfall(arguments);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let read = parse(&std::fs::read(trace).expect("a trace"));
    read.check_tracks();
    read
}

/// Spans of this name, each right behind the span of the same brick by the name before.
fn check_behind(trace: &Read, [before, name]: [&str; 2]) -> usize {
    let loaders = trace.tracks.iter().filter(|(track, _)| track.starts_with("loader"));
    let mut found = 0;
    for (track, spans) in loaders {
        for (index, span) in spans.iter().enumerate().filter(|(_, span)| span.name == name) {
            let first: &Span = &spans[index - 1];
            assert_eq!((&*first.name, &first.args), (before, &span.args), "{track}");
            assert_eq!(first.end_ns, span.begin_ns, "{track}: {before} and {name} of one brick");
            assert!(span.end_ns > span.begin_ns, "{track}: {name} took no time");
            found += 1;
        }
    }
    found
}

#[test]
fn every_brick_that_is_read_from_a_store_is_decoded_behind_it() {
    if Device::open().is_none() {
        return;
    }
    for rounds in ["--lockstep", "--free-running"] {
        let folder = Folder::new("trace-decode");
        let trace = traced(&folder, &[rounds]);
        let reads = trace.spans("loader", "read").len();
        assert!(reads > 12, "{reads} reads");
        assert_eq!(check_behind(&trace, ["read", "decode"]), reads, "{rounds}");
        assert!(trace.spans("loader", "inspect").is_empty(), "nobody inspects");
        // Ways go through both, in this order.
        let mut ways = 0;
        for steps in trace.flow_steps.values() {
            let at = |step: &str| steps.iter().position(|known| known == step);
            let (Some(read), Some(published)) = (at("read"), at("published")) else { continue };
            assert_eq!(at("decode"), Some(read + 1), "{steps:?}");
            assert!(at("wanted") < Some(read) && at("staged") > Some(read + 1), "{steps:?}");
            assert!(at("staged") < Some(published), "{steps:?}");
            ways += 1;
        }
        assert!(ways > 12 && ways <= reads, "{ways} of {reads}");
    }
}

#[test]
fn what_looks_at_voxels_for_the_octree_is_told_behind_the_decoding() {
    if Device::open().is_none() {
        return;
    }
    let folder = Folder::new("trace-inspect");
    let trace = traced(&folder, &["--traversal", "residency-octree"]);
    let reads = trace.spans("loader", "read").len();
    assert_eq!(check_behind(&trace, ["read", "decode"]), reads);
    assert_eq!(check_behind(&trace, ["decode", "inspect"]), reads);
    assert!(reads > 12);
}
