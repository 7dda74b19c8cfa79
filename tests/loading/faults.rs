//! Sources on bad days: slow, failing, short, corrupt, stalling, panicking, gone and back.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use ashfall::error::{Error, Exit, Result};
use ashfall::loading::{Block, Delivery, Inspect, Loading, LoadingLimits, PAUSE_MAX};
use ashfall::source::faulty::{Corrupt, Failing, Fault, Short, Slow, Stalling};
use ashfall::source::{BrickEntry, BrickSource, Computed, Description, FieldSource};
use ashfall::volume::{BrickId, ValueRange};

use crate::sources::*;

/// Every read fails while it is away.
#[derive(Default)]
struct Disk {
    away: AtomicBool,
}

impl Fault for Disk {
    fn before(&self, _: u64, id: BrickId) -> Result<()> {
        if self.away.load(Ordering::SeqCst) {
            return Err(Error::machine(format!("{id}: the disk is gone")));
        }
        Ok(())
    }
}

/// All reads of one brick fail.
struct BadBrick(BrickId);

impl Fault for BadBrick {
    fn before(&self, _: u64, id: BrickId) -> Result<()> {
        if id == self.0 { Err(Error::input(format!("{id} is bad"))) } else { Ok(()) }
    }
}

#[test]
fn a_slow_source_is_waited_for() {
    let source = faulty("shells", Slow(Duration::from_millis(20)));
    let mut loading = loading(&source, limits(1));
    loading.wish(&wishes(&[(0, 0), (1, 1)]));
    assert_eq!(ids(&all(&mut loading)), bricks(&[0, 1]));
}

#[test]
fn every_second_read_fails_and_every_brick_comes() {
    let source = faulty("shells", Failing(2));
    // Which brick meets the bad reads is a matter of luck, so none may run out of attempts.
    let patient = LoadingLimits { attempts: u32::MAX, retry_after: Duration::ZERO, ..limits(1) };
    let mut loading = loading(&source, patient);
    loading.wish(&wishes(&(0..32).map(|n| (n, 0)).collect::<Vec<_>>()));
    let deliveries = all(&mut loading);
    assert_eq!((deliveries.len(), failures(&deliveries).len()), (32, 0));
    let done = loading.statistics();
    // The 32nd read that goes well has number 63.
    assert_eq!((source.reads(), done.reads, done.retries, done.failed), (63, 63, 31, 0));
}

#[test]
fn a_brick_fails_once_after_its_attempts() {
    let source = faulty("shells", Failing(1));
    let mut loading = loading(&source, LoadingLimits { attempts: 4, ..limits(2) });
    for _ in 0..3 {
        loading.wish(&wishes(&[(0, 0)]));
        let deliveries = all(&mut loading);
        let expected = usize::from(loading.statistics().wishes_refused == 0);
        assert_eq!(failures(&deliveries).len(), expected);
    }
    let done = loading.statistics();
    assert_eq!((source.reads(), done.reads, done.retries), (4, 4, 3));
    assert_eq!((done.failed, done.wishes_refused), (1, 2));
}

#[test]
fn a_pause_blocks_no_other_brick() {
    let source = faulty("shells", BadBrick(brick(0)));
    // Far longer than the test: no loader may sleep through it.
    let slow = LoadingLimits { retry_after: PAUSE_MAX, ..limits(1) };
    let mut loading = loading(&source, slow);
    loading.wish(&wishes(&(0..16).map(|n| (n, u64::from(n))).collect::<Vec<_>>()));
    let others: Vec<Delivery> = (1..16).map(|_| loading.next(LONG).expect("one")).collect();
    assert_eq!(ids(&others), bricks(&(1..16).collect::<Vec<_>>()));
    assert_eq!((loading.next(Duration::ZERO), loading.outstanding()), (None, 1));
    // Out of the list it is waited for no longer.
    loading.wish(&[]);
    assert_eq!((loading.outstanding(), loading.statistics().stale), (0, 1));
}

#[test]
fn a_failed_read_that_nobody_wishes_any_more_is_dropped() {
    let source = faulty("shells", Disk::default());
    source.fault.away.store(true, Ordering::SeqCst);
    let mut loading = loading(&source, limits(1));
    loading.wish(&wishes(&[(0, 0)]));
    loading.wish(&[]);
    assert_eq!((all(&mut loading).len(), loading.statistics().stale, source.reads()), (0, 1, 1));
}

#[test]
fn short_and_corrupt_bricks_fail_with_a_reason() {
    fn reasons(source: Arc<impl BrickSource + 'static>, word: &str) {
        let mut loading = loading(&source, limits(2));
        loading.wish(&wishes(&[(0, 0), (21, 1)]));
        let deliveries = all(&mut loading);
        let failures = failures(&deliveries);
        assert_eq!(failures.len(), 2);
        for (_, why) in failures {
            assert!(why.message.contains(word), "{why}");
        }
        let done = loading.statistics();
        assert_eq!((done.bytes_read, done.cache_bytes_max, done.failed), (0, 0, 2));
    }
    reasons(faulty("shells", Short(1)), "999 bytes");
    // Any other value than 1 is outside of the range of `constant`.
    reasons(faulty("constant", Corrupt), "damaged");
}

#[test]
fn an_inspection_that_panics_costs_its_brick() {
    let source: Arc<dyn BrickSource> = Arc::new(volume("shells"));
    let inspect: Inspect = Arc::new(|id, bytes| {
        assert!(id != brick(1), "a test's panic");
        vec![ValueRange::of(bytes.len() as f32)]
    });
    let mut loading = Loading::inspecting(vec![source.clone()], limits(1), inspect).unwrap();
    for from_cache in [false, true] {
        loading.wish(&wishes(&[(0, 0), (1, 1), (2, 2)]));
        let deliveries = all(&mut loading);
        for delivery in &deliveries {
            let Delivery::Brick { leaf_ranges, .. } = delivery else { continue };
            let learned = (!from_cache).then(|| vec![ValueRange::of(BRICK_BYTES as f32)]);
            assert_eq!(*leaf_ranges, learned);
        }
        if !from_cache {
            let failures = failures(&deliveries);
            assert!(matches!(failures[..], [(id, why)] if id == brick(1)
                && why.exit == Exit::Bug && why.message.contains("inspection panicked")));
        }
        assert_true_to(&*source, &deliveries);
        assert_eq!(deliveries.len(), if from_cache { 2 } else { 3 });
    }
}

#[test]
fn one_stalled_loader_holds_up_only_its_own_bricks() {
    let stalled = faulty("shells", Stalling::default());
    let sources: Vec<Arc<dyn BrickSource>> = vec![stalled.clone(), Arc::new(volume("shells"))];
    let mut loading = Loading::new(sources, limits(2)).unwrap();
    let mut list = wishes(&[(0, 0)]);
    list.extend(wishes(&(0..20).map(|n| (n, 1)).collect::<Vec<_>>()));
    list[1..].iter_mut().for_each(|wish| wish.id.volume = 1);
    loading.wish(&list);
    let others: Vec<Delivery> = (0..20).map(|_| loading.next(LONG).expect("one")).collect();
    assert!(ids(&others).iter().all(|id| id.volume == 1));
    assert_eq!((loading.next(Duration::ZERO), loading.outstanding()), (None, 1));
    stalled.fault.go_on();
    assert_eq!(ids(&all(&mut loading)), bricks(&[0]));
}

#[test]
fn a_disk_that_vanishes_and_returns() {
    let source = faulty("shells", Disk::default());
    let mut loading = loading(&source, limits(2));
    let list = wishes(&(0..10).map(|n| (n, u64::from(n))).collect::<Vec<_>>());
    source.fault.away.store(true, Ordering::SeqCst);
    loading.wish(&list);
    let deliveries = all(&mut loading);
    assert_eq!(failures(&deliveries).len(), 10);
    assert!(failures(&deliveries).iter().all(|(_, why)| why.exit == Exit::Machine));
    // It is back, but nobody said so.
    source.fault.away.store(false, Ordering::SeqCst);
    loading.wish(&list);
    assert_eq!((loading.outstanding(), loading.next(LONG)), (0, None));
    loading.forget_failures();
    loading.wish(&list);
    let deliveries = all(&mut loading);
    assert_eq!((deliveries.len(), failures(&deliveries).len()), (10, 0));
    assert_true_to(&*source, &deliveries);
}

#[test]
fn what_does_not_exist_fails() {
    let source = Arc::new(volume("shells"));
    let mut loading = loading(&source, limits(1));
    let mut list = wishes(&[(0, 0); 3]);
    list[0].id.x = 4;
    list[1].id.volume = 1;
    list[2].id.channel = u16::MAX;
    loading.wish(&list);
    assert_eq!(failures(&all(&mut loading)).len(), 3);
}

/// Panics at every second read and entry.
struct Panicking(FieldSource<Computed>, AtomicU64);

impl Panicking {
    fn perhaps(&self) {
        assert!(!self.1.fetch_add(1, Ordering::SeqCst).is_multiple_of(2), "a test's panic");
    }
}

impl BrickSource for Panicking {
    fn description(&self) -> &Description {
        self.0.description()
    }

    fn entry(&self, id: BrickId) -> Result<BrickEntry> {
        self.perhaps();
        self.0.entry(id)
    }

    fn read(&self, id: BrickId, bytes: &mut Vec<u8>) -> Result<()> {
        self.0.read(id, bytes)
    }
}

#[test]
fn a_panic_costs_an_attempt_and_no_loader() {
    let source = Arc::new(Panicking(volume("shells"), AtomicU64::new(0)));
    let mut loading = loading(&source, limits(1));
    loading.wish(&wishes(&[(0, 0), (1, 1), (2, 2)]));
    let deliveries = all(&mut loading);
    assert_eq!((deliveries.len(), failures(&deliveries).len()), (3, 0));
    assert!(loading.statistics().retries > 0);
    loading.survey(&[Block::of(brick(0))]);
    let Some(Delivery::Surveyed { entries, .. }) = loading.next(LONG) else { panic!("no survey") };
    let errors: Vec<&Error> = entries.iter().filter_map(|(_, e)| e.as_ref().err()).collect();
    assert_eq!((entries.len(), errors.len()), (64, 32));
    assert!(errors.iter().all(|e| e.exit == Exit::Bug && e.message.contains("a test's panic")));
}
