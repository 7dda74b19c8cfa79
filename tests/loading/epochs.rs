//! Sources that change: nothing of before is delivered after.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

use ashfall::error::{Error, Result};
use ashfall::loading::{Block, Delivery, Loading, LoadingLimits};
use ashfall::source::BrickSource;
use ashfall::source::faulty::{Failing, Fault, Faulty, Stalling};
use ashfall::volume::BrickId;

use crate::sources::*;

/// The first voxel of every brick says the version, 0 or 1 as in `checkerboard`. Reads stall at their end, version in hand.
#[derive(Default)]
struct Versioned {
    version: AtomicU8,
    gate: Stalling,
}

impl Fault for Versioned {
    fn before(&self, _: u64, _: BrickId) -> Result<()> {
        Ok(())
    }

    fn after(&self, read: u64, bytes: &mut Vec<u8>) {
        bytes[0] = self.version.load(Ordering::SeqCst);
        let _ = self.gate.before(read, brick(0));
    }
}

/// Waits for reads to be inside the source.
fn until_reads<S: BrickSource, F: Fault>(source: &Faulty<S, F>, reads: u64) {
    while source.reads() < reads {
        std::thread::yield_now();
    }
}

fn versions(deliveries: &[Delivery]) -> Vec<u8> {
    let version = |delivery: &Delivery| match delivery {
        Delivery::Brick { bytes, .. } => bytes[0],
        _ => u8::MAX,
    };
    deliveries.iter().map(version).collect()
}

#[test]
fn what_was_read_before_is_never_delivered_after() {
    let source = faulty("checkerboard", Versioned::default());
    let mut loading = loading(&source, limits(1));
    loading.wish(&wishes(&[(0, 0), (1, 1), (2, 2)]));
    until_reads(&source, 1);
    // One read has begun and one is handed over: both are of before.
    source.fault.version.store(1, Ordering::SeqCst);
    loading.new_epoch(0);
    assert_eq!(loading.outstanding(), 3);
    source.fault.gate.go_on();
    let deliveries = all(&mut loading);
    assert_eq!(versions(&deliveries), [1, 1, 1]);
    let mut got = ids(&deliveries);
    got.sort_unstable();
    assert_eq!(got, bricks(&[0, 1, 2]));
    let done = loading.statistics();
    assert_eq!((done.dropped_old_epoch, done.reads), (2, 5));
}

/// Reads of version 0 fail, after a stall.
#[derive(Default)]
struct Mended(Versioned);

impl Fault for Mended {
    fn before(&self, read: u64, id: BrickId) -> Result<()> {
        let version = self.0.version.load(Ordering::SeqCst);
        self.0.gate.before(read, id)?;
        if version == 0 { Err(Error::input(format!("{id} is of version 0"))) } else { Ok(()) }
    }
}

#[test]
fn a_failure_of_before_costs_nothing_after() {
    let source = faulty("checkerboard", Mended::default());
    let mut loading = loading(&source, LoadingLimits { attempts: 1, ..limits(1) });
    loading.wish(&wishes(&[(0, 0)]));
    until_reads(&source, 1);
    loading.new_epoch(0);
    source.fault.0.version.store(1, Ordering::SeqCst);
    source.fault.0.gate.go_on();
    let deliveries = all(&mut loading);
    assert_eq!((deliveries.len(), failures(&deliveries).len()), (1, 0));
    assert_eq!((source.reads(), loading.statistics().dropped_old_epoch), (2, 1));
}

#[test]
fn old_reads_that_nobody_wishes_are_not_repeated() {
    let source = faulty("checkerboard", Versioned::default());
    let mut loading = loading(&source, limits(1));
    loading.wish(&wishes(&[(0, 0)]));
    loading.wish(&[]);
    loading.new_epoch(0);
    source.fault.gate.go_on();
    assert_eq!((all(&mut loading).len(), loading.statistics().dropped_old_epoch), (0, 1));
    assert_eq!(loading.statistics().cache_bytes, 0);
}

#[test]
fn cached_bricks_of_that_volume_alone_are_read_again() {
    let source: Arc<dyn BrickSource> = Arc::new(volume("shells"));
    let mut loading = Loading::new(vec![source.clone(), source], limits(2)).unwrap();
    let mut list = wishes(&[(0, 0), (0, 0), (1, 1), (1, 1)]);
    list[1].id.volume = 1;
    list[3].id.volume = 1;
    loading.wish(&list);
    assert_eq!(all(&mut loading).len(), 4);
    // Those that wait as hits while the epoch ends, as well.
    loading.wish(&list);
    loading.new_epoch(1);
    assert_eq!(loading.statistics().cache_bytes, 2 * BRICK_BYTES);
    let deliveries = all(&mut loading);
    assert_eq!(deliveries.len(), 4);
    for delivery in deliveries {
        let Delivery::Brick { id, from_cache, .. } = delivery else { panic!("no brick") };
        assert_eq!(from_cache, id.volume == 0);
    }
}

#[test]
fn failures_of_that_volume_alone_are_forgotten() {
    let source: Arc<dyn BrickSource> = faulty("shells", Failing(1));
    let mut loading = Loading::new(vec![source.clone(), source], limits(2)).unwrap();
    let mut list = wishes(&[(0, 0), (0, 0)]);
    list[1].id.volume = 1;
    loading.wish(&list);
    assert_eq!(failures(&all(&mut loading)).len(), 2);
    loading.new_epoch(1);
    loading.new_epoch(7);
    loading.wish(&list);
    assert_eq!(ids(&all(&mut loading)), [list[1].id]);
}

#[test]
fn surveys_are_made_again_when_asked() {
    let source = faulty("shells", Stalling::default());
    let mut loading = loading(&source, limits(1));
    let block = Block::of(brick(0));
    loading.survey(&[block]);
    assert_eq!(all(&mut loading).len(), 1);
    loading.new_epoch(0);
    assert_eq!(loading.outstanding(), 0);
    // Behind a stalled read the survey is handed over, then old; it is made anew and comes once.
    loading.wish(&wishes(&[(0, 0)]));
    loading.survey(&[block]);
    loading.new_epoch(0);
    loading.survey(&[block]);
    source.fault.go_on();
    let deliveries = all(&mut loading);
    assert_eq!((deliveries.len(), ids(&deliveries)), (2, bricks(&[0])));
    assert_eq!(loading.statistics().dropped_old_epoch, 2);
}
