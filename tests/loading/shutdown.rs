//! Threads: their names, and their end.

use std::collections::BTreeSet;
use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use ashfall::error::Result;
use ashfall::loading::{Loading, PATIENCE};
use ashfall::source::BrickSource;
use ashfall::source::faulty::{Fault, Slow, Stalling};
use ashfall::volume::BrickId;

use crate::sources::*;

#[derive(Default)]
struct Names(Mutex<BTreeSet<String>>);

impl Fault for Names {
    fn before(&self, _: u64, _: BrickId) -> Result<()> {
        let name = std::thread::current().name().unwrap_or("nameless").to_owned();
        self.0.lock().unwrap().insert(name);
        // Lets the others have some.
        std::thread::sleep(Duration::from_micros(200));
        Ok(())
    }
}

#[test]
fn loaders_have_names() {
    let source = faulty("shells", Names::default());
    let mut loading = loading(&source, limits(2));
    loading.wish(&wishes(&(0..64).map(|n| (n, 0)).collect::<Vec<_>>()));
    all(&mut loading);
    let names = source.fault.0.lock().unwrap().clone();
    let known = ["loader 0", "loader 1"].map(str::to_owned);
    assert!(!names.is_empty() && names.iter().all(|name| known.contains(name)), "{names:?}");
}

#[test]
fn dropping_joins_the_loaders() {
    let source = faulty("shells", Slow(Duration::from_millis(20)));
    let mut loading = loading(&source, limits(2));
    loading.wish(&wishes(&(0..64).map(|n| (n, 0)).collect::<Vec<_>>()));
    let start = Instant::now();
    drop(loading);
    assert!(start.elapsed() < PATIENCE, "{:?}", start.elapsed());
    // Each loader held the sources: none is left.
    assert_eq!(Arc::strong_count(&source), 1);
}

#[test]
fn dropping_forgets_what_was_handed_over_and_not_begun() {
    // Whether the stop comes within the first read is up to the machine; once in a while it does, and
    // never would if loaders did not heed it.
    let stopped_in_time = || {
        let source = faulty("shells", Slow(Duration::from_millis(100)));
        let mut loading = loading(&source, limits(1));
        loading.wish(&wishes(&[(0, 0), (1, 1)]));
        while source.reads() < 1 {
            std::thread::yield_now();
        }
        drop(loading);
        source.reads() == 1
    };
    assert!((0..10).any(|_| stopped_in_time()));
}

#[test]
fn dropping_with_arrivals_nobody_took() {
    let source = Arc::new(volume("shells"));
    for wished in 0..20 {
        let mut loading = loading(&source, limits(3));
        loading.wish(&wishes(&(0..wished).map(|n| (n, 0)).collect::<Vec<_>>()));
        drop(loading);
        assert_eq!(Arc::strong_count(&source), 1);
    }
}

#[test]
fn a_stalled_source_does_not_hold_up_dropping() {
    let source = faulty("shells", Stalling::default());
    let mut loading = loading(&source, limits(2));
    loading.wish(&wishes(&[(0, 0), (1, 1), (2, 2), (3, 3)]));
    while source.reads() < 2 {
        std::thread::yield_now();
    }
    let start = Instant::now();
    // Elsewhere, so that a drop that hangs fails this test alone.
    let (dropped, done) = channel();
    std::thread::spawn(move || {
        drop(loading);
        dropped.send(()).unwrap();
    });
    assert!(done.recv_timeout(LONG).is_ok(), "dropping hangs");
    assert!(start.elapsed() >= PATIENCE);
    assert!(Arc::strong_count(&source) > 1, "the loaders are still inside");
    // Released, they end by themselves and read no more.
    source.fault.go_on();
    let start = Instant::now();
    while Arc::strong_count(&source) > 1 {
        assert!(start.elapsed() < LONG);
        std::thread::yield_now();
    }
    assert_eq!(source.reads(), 2);
}

#[test]
fn an_owner_may_live_on_any_thread() {
    fn movable<T: Send>() {}
    movable::<Loading>();
    let sources: Vec<Arc<dyn BrickSource>> = Vec::new();
    assert!(Loading::new(sources, limits(1)).unwrap().next(LONG).is_none());
}
