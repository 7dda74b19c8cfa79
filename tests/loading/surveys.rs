//! What sources know without reading: blocks, once an epoch, before reads.

use std::sync::Arc;

use ashfall::error::Result;
use ashfall::loading::{Block, Delivery, Loading, LoadingLimits};
use ashfall::source::faulty::Stalling;
use ashfall::source::{BrickEntry, BrickSource};
use ashfall::volume::BrickId;

use crate::sources::*;

fn surveyed(delivery: Option<Delivery>) -> (Block, Vec<(BrickId, Result<BrickEntry>)>) {
    match delivery {
        Some(Delivery::Surveyed { block, entries }) => (block, entries),
        other => panic!("no survey: {:?}", ids(other.as_slice())),
    }
}

#[test]
fn a_block_is_surveyed_once_and_says_what_the_source_says() {
    let source = Arc::new(volume("shells"));
    let mut loading = loading(&source, limits(2));
    for (level, bricks) in [(0, 64), (1, 8), (2, 1)] {
        let block = Block::of(BrickId { level, ..brick(0) });
        loading.survey(&[block, block]);
        loading.survey(&[block]);
        let (got, entries) = surveyed(loading.next(LONG));
        assert_eq!((got, entries.len()), (block, bricks));
        for (id, entry) in entries {
            // As text, since an unknown loss is NaN.
            assert_eq!(format!("{entry:?}"), format!("{:?}", source.entry(id)));
        }
        loading.survey(&[block]);
        assert_eq!(loading.outstanding(), 0);
    }
    assert_eq!(loading.statistics().surveys, 3);
    assert_eq!(loading.statistics().reads, 0);
}

#[test]
fn surveys_go_before_reads() {
    let source = faulty("shells", Stalling::default());
    let mut loading = loading(&source, limits(1));
    loading.wish(&wishes(&[(0, 0), (1, 1), (2, 2)]));
    let blocks = [1, 0].map(|level| Block::of(BrickId { level, ..brick(0) }));
    loading.survey(&blocks);
    assert_eq!(loading.outstanding(), 5);
    source.fault.go_on();
    let deliveries = all(&mut loading);
    let (first, last) = (&deliveries[..2], &deliveries[4..]);
    assert_eq!((ids(first), ids(last)), (bricks(&[0, 1]), bricks(&[2])));
    for (delivery, block) in deliveries[2..4].iter().zip(blocks) {
        assert_eq!(surveyed(Some(delivery.clone())).0, block);
    }
}

#[test]
fn a_block_outside_says_so_and_may_be_asked_for_again() {
    let source = Arc::new(volume("shells"));
    let mut loading = loading(&source, limits(1));
    let inside = Block::of(brick(0));
    let outside = [
        Block { x: 1, ..inside },
        Block { x: u32::MAX, ..inside },
        Block { level: 9, ..inside },
        Block { channel: 1, ..inside },
        Block { volume: 1, ..inside },
    ];
    for block in outside {
        for _ in 0..2 {
            loading.survey(&[block]);
            let (got, entries) = surveyed(loading.next(LONG));
            assert_eq!((got, entries[0].0), (block, block.first()));
            assert!(entries.len() == 1 && entries[0].1.is_err());
            loading.survey(&[block]);
            assert_eq!(loading.outstanding(), 0);
            loading.forget_failures();
        }
    }
}

#[test]
fn too_many_surveys_are_counted_and_can_be_asked_for_later() {
    let source: Arc<dyn BrickSource> = Arc::new(volume("shells"));
    let sources = vec![source; 9];
    let mut loading = Loading::new(sources, LoadingLimits { wishes_max: 4, ..limits(1) }).unwrap();
    let blocks: Vec<Block> =
        (0..9).map(|volume| Block::of(BrickId { volume, ..brick(0) })).collect();
    // None is handed over before all were asked.
    loading.survey(&blocks);
    assert_eq!((loading.statistics().surveys_overflow, all(&mut loading).len()), (5, 4));
    loading.survey(&blocks[4..8]);
    assert_eq!((loading.statistics().surveys_overflow, all(&mut loading).len()), (5, 4));
}
