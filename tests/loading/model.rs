//! Long random sequences against a plain model of who waits for what.

use std::collections::{HashMap, HashSet};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use ashfall::error::{Error, Result};
use ashfall::loading::{Block, Delivery, Inspect, Loading, LoadingLimits, Wish};
use ashfall::source::{BrickEntry, BrickSource, Computed, Description, FieldSource};
use ashfall::volume::{BrickId, ValueRange};

use crate::random::Random;
use crate::sources::*;

const OPERATIONS: u32 = 10_000;
const WISHES_MAX: usize = 24;
const CACHED_MAX: usize = 20;
const RAM_BYTES: u64 = CACHED_MAX as u64 * BRICK_BYTES + 1;

/// Bytes that tell brick and version; reads fail, panic or come short now and then. Sees whether one
/// brick is read twice at once.
struct Flaky {
    shape: FieldSource<Computed>,
    version: AtomicU64,
    reads: AtomicU64,
    bytes: AtomicU64,
    chance: Mutex<Random>,
    open: Mutex<HashSet<BrickId>>,
    twice: AtomicBool,
}

impl Flaky {
    fn new(seed: u64) -> Arc<Flaky> {
        Arc::new(Flaky {
            shape: volume("shells"),
            version: AtomicU64::new(0),
            reads: AtomicU64::new(0),
            bytes: AtomicU64::new(0),
            chance: Mutex::new(Random(seed)),
            open: Mutex::new(HashSet::new()),
            twice: AtomicBool::new(false),
        })
    }

    fn voxel(&self, id: BrickId) -> u8 {
        let version = self.version.load(Ordering::SeqCst);
        let name = u64::from(id.x + 4 * id.y + 16 * id.z) + 64 * u64::from(id.level);
        (version.wrapping_mul(151) + name.wrapping_mul(31) + u64::from(id.volume) * 7) as u8
    }
}

/// Ends a read, by return, error or panic.
struct Open<'a>(&'a Flaky, BrickId);

impl Drop for Open<'_> {
    fn drop(&mut self) {
        self.0.open.lock().unwrap().remove(&self.1);
    }
}

impl BrickSource for Flaky {
    fn description(&self) -> &Description {
        self.shape.description()
    }

    fn entry(&self, id: BrickId) -> Result<BrickEntry> {
        self.shape.entry(id)?;
        let range = ValueRange { least: 0.0, greatest: 255.0 };
        Ok(BrickEntry::Stored { range, loss: 0.0 })
    }

    fn read(&self, id: BrickId, bytes: &mut Vec<u8>) -> Result<()> {
        if !self.open.lock().unwrap().insert(id) {
            self.twice.store(true, Ordering::SeqCst);
        }
        let _open = Open(self, id);
        self.reads.fetch_add(1, Ordering::SeqCst);
        let luck = self.chance.lock().unwrap().below(200);
        bytes.clear();
        bytes.resize(self.description().brick_bytes(id), self.voxel(id));
        match luck {
            0 => panic!("a test's panic"),
            1..40 => return Err(Error::input("a bad day")),
            40..50 => bytes.truncate(luck as usize),
            50..100 => std::thread::yield_now(),
            _ => {}
        }
        if bytes.len() as u64 == BRICK_BYTES {
            self.bytes.fetch_add(BRICK_BYTES, Ordering::SeqCst);
        }
        Ok(())
    }
}

/// What somebody waits for, by the promises of the room alone.
#[derive(Default)]
struct Model {
    /// True: in the list, must come. False: dropped from it, may come once if a loader had it.
    wished: HashMap<BrickId, bool>,
    failed: HashSet<BrickId>,
    /// What the cache holds, least recently used first: all bricks are equally large.
    cached: Vec<BrickId>,
    /// True once delivered.
    blocks: HashMap<Block, bool>,
    overflow: u64,
    refused: u64,
}

impl Model {
    fn wish(&mut self, wishes: &[Wish]) {
        let mut ranks: HashMap<BrickId, u64> = HashMap::new();
        for &Wish { id, rank } in wishes {
            ranks.entry(id).and_modify(|r| *r = rank.min(*r)).or_insert(rank);
        }
        let distinct = ranks.len();
        ranks.retain(|id, _| !self.failed.contains(id));
        self.refused += (distinct - ranks.len()) as u64;
        let mut list: Vec<(u64, BrickId)> = ranks.into_iter().map(|(id, r)| (r, id)).collect();
        list.sort_unstable();
        self.overflow += list.len().saturating_sub(WISHES_MAX) as u64;
        list.truncate(WISHES_MAX);
        self.wished.values_mut().for_each(|must| *must = false);
        self.wished.extend(list.into_iter().map(|(_, id)| (id, true)));
    }

    fn take(&mut self, delivery: &Delivery, sources: &[Arc<Flaky>]) {
        match delivery {
            Delivery::Brick { id, bytes, from_cache, leaf_ranges } => {
                let place = self.cached.iter().position(|cached| cached == id);
                assert_eq!(place.is_some(), *from_cache, "{id}");
                match place {
                    Some(place) => _ = self.cached.remove(place),
                    None if self.cached.len() == CACHED_MAX => _ = self.cached.remove(0),
                    None => {}
                }
                self.cached.push(*id);
                assert!(self.wished.remove(id).is_some(), "{id} was not wished");
                let voxel = sources[usize::from(id.volume)].voxel(*id);
                assert_eq!(bytes.len() as u64, BRICK_BYTES);
                assert!(bytes.iter().all(|&byte| byte == voxel), "{id} of another time or place");
                // What was learned comes with the read and is of the same voxels.
                let learned = (!from_cache).then(|| vec![ValueRange::of(voxel.into())]);
                assert_eq!(*leaf_ranges, learned, "{id}");
            }
            Delivery::Failed { id, .. } => {
                assert!(self.wished.remove(id).is_some(), "{id} was not wished");
                assert!(self.failed.insert(*id), "{id} failed twice");
            }
            Delivery::Surveyed { block, entries } => {
                assert_eq!(self.blocks.insert(*block, true), Some(false), "{block:?}");
                assert!(!entries.is_empty() && entries.iter().all(|(_, entry)| entry.is_ok()));
            }
        }
    }

    fn forget(&mut self, volume: u16) {
        self.failed.retain(|id| id.volume != volume);
        self.cached.retain(|id| id.volume != volume);
        self.blocks.retain(|block, delivered| block.volume != volume || !*delivered);
    }
}

fn some_brick(random: &mut Random) -> BrickId {
    let volume = random.below(2) as u16;
    match random.below(40) {
        0 => BrickId { volume, level: 2, ..brick(0) },
        1 => BrickId { volume, ..brick(64) },
        _ => BrickId { volume, ..brick(random.below(64) as u32) },
    }
}

fn run(seed: u64, loaders: usize, attempts: u32) {
    let random = &mut Random(seed);
    let sources = [Flaky::new(seed + 1), Flaky::new(seed + 2)];
    let limits = LoadingLimits {
        ram_bytes: RAM_BYTES,
        loaders,
        attempts,
        retry_after: Duration::from_micros(20),
        wishes_max: WISHES_MAX,
        yielding: seed % 2 == 1,
    };
    let shared = sources.iter().map(|source| source.clone() as Arc<dyn BrickSource>);
    let inspect: Inspect = Arc::new(|_, bytes| vec![ValueRange::of(bytes[0].into())]);
    let mut loading = Loading::inspecting(shared.collect(), limits, inspect).unwrap();
    let mut model = Model::default();
    for _ in 0..OPERATIONS {
        match random.below(100) {
            0..20 => {
                let count = random.below(40);
                let list: Vec<Wish> = (0..count)
                    .map(|_| Wish { id: some_brick(random), rank: random.below(20) })
                    .collect();
                loading.wish(&list);
                model.wish(&list);
            }
            20..23 => {
                let block = Block::of(BrickId { x: 0, y: 0, z: 0, ..some_brick(random) });
                loading.survey(&[block]);
                model.blocks.entry(block).or_insert(false);
            }
            23..25 => {
                let volume = random.below(3) as u16;
                if let Some(source) = sources.get(usize::from(volume)) {
                    source.version.fetch_add(1, Ordering::SeqCst);
                }
                loading.new_epoch(volume);
                model.forget(volume);
            }
            25..28 => {
                loading.forget_failures();
                model.failed.clear();
            }
            choice => {
                let timeout = Duration::from_micros(if choice < 40 { 0 } else { 500 });
                if let Some(delivery) = loading.next(timeout) {
                    model.take(&delivery, &sources);
                }
            }
        }
        let live = model.wished.values().filter(|&&must| must).count();
        let asked = model.blocks.values().filter(|&&delivered| !delivered).count();
        assert!(loading.outstanding() >= live + asked);
        let cached_bytes = loading.statistics().cache_bytes;
        assert_eq!(cached_bytes, model.cached.len() as u64 * BRICK_BYTES);
    }
    // What is wished at the end comes without another call but `next`.
    all(&mut loading).iter().for_each(|delivery| model.take(delivery, &sources));
    assert!(!model.wished.values().any(|&must| must), "a wish was forgotten");
    assert!(!model.blocks.values().any(|&delivered| !delivered), "a survey was forgotten");

    let done = loading.statistics();
    let sum = |of: fn(&Flaky) -> &AtomicU64| {
        sources.iter().map(|source| of(source).load(Ordering::SeqCst)).sum::<u64>()
    };
    assert!(
        !sources.iter().any(|source| source.twice.load(Ordering::SeqCst)),
        "read twice at once"
    );
    // Reads of what does not exist end before they reach the source's own count.
    assert!(done.reads >= sum(|source| &source.reads));
    assert_eq!(done.bytes_read, sum(|source| &source.bytes));
    assert_eq!((done.wishes_overflow, done.wishes_refused), (model.overflow, model.refused));
    assert!(done.cache_bytes_max <= RAM_BYTES && done.cache_bytes_max > RAM_BYTES - BRICK_BYTES);
    // The sequence met what it is for.
    for (what, count) in [
        ("hits", done.cache_hits),
        ("stale", done.stale),
        ("failed", done.failed),
        ("old", done.dropped_old_epoch),
        ("overflow", done.wishes_overflow),
        ("refused", done.wishes_refused),
        ("surveys", done.surveys),
    ] {
        assert!(count > 10, "{what}: {count} in {done:?}");
    }
    assert_eq!(done.surveys_overflow, 0);
}

#[test]
fn one_loader_keeps_the_promises() {
    run(0x9E37_79B9, 1, 2);
}

#[test]
fn many_loaders_keep_the_promises() {
    for seed in [1, 77, 0xDEAD_BEEF] {
        run(seed, 5, 2);
    }
}

#[test]
fn a_single_attempt_keeps_the_promises() {
    run(42, 3, 1);
}
