//! Rank order, joined wishes, stale wishes, the cache.

use std::sync::Arc;
use std::time::Duration;

use ashfall::loading::{Delivery, JOBS_PER_LOADER, Loading, LoadingLimits};
use ashfall::source::faulty::{Failing, Slow, Stalling};

use crate::sources::*;

fn from_cache(deliveries: &[Delivery]) -> Vec<bool> {
    let hit = |delivery: &Delivery| matches!(delivery, Delivery::Brick { from_cache: true, .. });
    deliveries.iter().map(hit).collect()
}

#[test]
fn one_loader_delivers_in_rank_order() {
    let source = Arc::new(volume("shells"));
    let mut loading = loading(&source, limits(1));
    let list: Vec<(u32, u64)> = (0..64).map(|n| (n, u64::from(n * 37 % 64))).collect();
    loading.wish(&wishes(&list));
    assert_eq!(loading.outstanding(), 64);
    let deliveries = all(&mut loading);
    let mut by_rank = list;
    by_rank.sort_by_key(|&(_, rank)| rank);
    let numbers: Vec<u32> = by_rank.iter().map(|&(number, _)| number).collect();
    assert_eq!(ids(&deliveries), bricks(&numbers));
    assert!(!from_cache(&deliveries).contains(&true));
    assert_true_to(&*source, &deliveries);
    let done = loading.statistics();
    assert_eq!((done.reads, done.bytes_read), (64, 64 * BRICK_BYTES));
    assert_eq!(loading.next(LONG), None, "nothing is under way, so nothing is waited for");
}

#[test]
fn many_loaders_deliver_each_brick_once() {
    let source = faulty("shells", Slow(Duration::from_micros(100)));
    let mut loading = loading(&source, limits(4));
    loading.wish(&wishes(&(0..64).map(|n| (n, 0)).collect::<Vec<_>>()));
    let deliveries = all(&mut loading);
    let mut got = ids(&deliveries);
    got.sort_unstable();
    let mut wanted = bricks(&(0..64).collect::<Vec<_>>());
    wanted.sort_unstable();
    assert_eq!(got, wanted);
    assert_true_to(&*source, &deliveries);
}

#[test]
fn a_better_rank_overtakes_what_no_loader_has() {
    let source = faulty("shells", Stalling::default());
    let mut loading = loading(&source, limits(1));
    loading.wish(&wishes(&[(0, 10), (1, 11), (2, 12), (3, 13)]));
    // Two jobs are handed over, whether or not the loader has begun; nothing comes meanwhile.
    assert_eq!((JOBS_PER_LOADER, loading.statistics().reads), (2, 2));
    assert_eq!(loading.next(Duration::from_millis(1)), None);
    loading.wish(&wishes(&[(0, 10), (1, 11), (2, 12), (3, 5), (4, 1)]));
    source.fault.go_on();
    assert_eq!(ids(&all(&mut loading)), bricks(&[0, 1, 4, 3, 2]));
}

#[test]
fn loaders_run_ahead_of_a_lazy_owner_by_their_bound_alone() {
    let source = faulty("shells", Failing(0));
    let mut loading = loading(&source, limits(2));
    let list = wishes(&(0..64).map(|n| (n, 0)).collect::<Vec<_>>());
    loading.wish(&list);
    let bound = 2 * JOBS_PER_LOADER as u64;
    while source.reads() < bound {
        std::thread::yield_now();
    }
    // All that was handed over has been begun; until something is taken, no more is.
    loading.wish(&list);
    assert_eq!(loading.statistics().reads, bound);
    assert!(loading.next(LONG).is_some());
    assert_eq!(loading.statistics().reads, bound + 1);
}

#[test]
fn one_brick_wished_often_is_read_once() {
    let source = faulty("shells", Stalling::default());
    let mut loading = loading(&source, limits(1));
    let list = wishes(&[(1, 9), (0, 5), (1, 1), (0, 7)]);
    for _ in 0..10 {
        loading.wish(&list);
        assert_eq!(loading.outstanding(), 2);
    }
    source.fault.go_on();
    // Read, perhaps arrived, not taken: wished again it is still the same delivery.
    loading.wish(&[]);
    loading.wish(&list);
    assert_eq!(ids(&all(&mut loading)), bricks(&[1, 0]));
    assert_eq!((source.reads(), loading.statistics().stale), (2, 0));
}

#[test]
fn wishes_no_longer_wished_are_dropped_unless_a_loader_has_them() {
    let source = faulty("shells", Stalling::default());
    let mut loading = loading(&source, limits(1));
    loading.wish(&wishes(&[(0, 0), (1, 1), (2, 2), (3, 3), (4, 4)]));
    loading.wish(&wishes(&[(3, 3)]));
    assert_eq!((loading.statistics().stale, loading.outstanding()), (2, 3));
    loading.wish(&[]);
    assert_eq!((loading.statistics().stale, loading.outstanding()), (3, 2));
    source.fault.go_on();
    assert_eq!(ids(&all(&mut loading)), bricks(&[0, 1]));
    assert_eq!(source.reads(), 2);
}

#[test]
fn cached_bricks_come_first_by_rank_and_are_not_read() {
    let source = Arc::new(volume("shells"));
    let mut loading = loading(&source, limits(1));
    loading.wish(&wishes(&[(0, 0), (1, 1), (2, 2)]));
    all(&mut loading);
    loading.wish(&wishes(&[(7, 0), (0, 3), (2, 1), (1, 2), (8, 1)]));
    let deliveries = all(&mut loading);
    assert_eq!(ids(&deliveries), bricks(&[2, 1, 0, 7, 8]));
    assert_eq!(from_cache(&deliveries), [true, true, true, false, false]);
    assert_true_to(&*source, &deliveries);
    let done = loading.statistics();
    assert_eq!((done.reads, done.cache_hits, done.cache_bytes), (5, 3, 5 * BRICK_BYTES));
}

#[test]
fn the_cache_keeps_its_bound_and_the_last_used() {
    let source = Arc::new(volume("shells"));
    let ram_bytes = 3 * BRICK_BYTES + BRICK_BYTES / 2;
    let mut loading = loading(&source, LoadingLimits { ram_bytes, ..limits(1) });
    let mut take = |number| {
        loading.wish(&wishes(&[(number, 0)]));
        let hit = from_cache(&all(&mut loading));
        assert!(loading.statistics().cache_bytes <= ram_bytes);
        hit[0]
    };
    assert_eq!([0, 1, 2, 0, 3].map(&mut take), [false, false, false, true, false]);
    // 1 went, since 0 was used after it.
    assert_eq!([0, 2, 3, 1].map(&mut take), [true, true, true, false]);
    assert_eq!(loading.statistics().cache_bytes_max, 3 * BRICK_BYTES);
}

#[test]
fn a_cache_of_one_brick_gives_it_before_it_goes() {
    let source = Arc::new(volume("shells"));
    let mut loading = loading(&source, LoadingLimits { ram_bytes: BRICK_BYTES, ..limits(1) });
    loading.wish(&wishes(&[(0, 0)]));
    all(&mut loading);
    // 1 drives 0 out; wished beside it, it comes first though its rank is worse.
    loading.wish(&wishes(&[(1, 0)]));
    all(&mut loading);
    loading.wish(&wishes(&[(0, 0), (1, 1)]));
    let deliveries = all(&mut loading);
    assert_eq!(ids(&deliveries), bricks(&[1, 0]));
    assert_eq!(from_cache(&deliveries), [true, false]);
}

#[test]
fn without_a_cache_every_wish_is_read() {
    let source = Arc::new(volume("shells"));
    let mut loading = loading(&source, LoadingLimits { ram_bytes: BRICK_BYTES - 1, ..limits(2) });
    for _ in 0..3 {
        loading.wish(&wishes(&[(0, 0), (1, 1)]));
        assert_eq!(all(&mut loading).len(), 2);
    }
    let done = loading.statistics();
    assert_eq!((done.reads, done.cache_bytes_max, done.cache_hits), (6, 0, 0));
}

#[test]
fn a_list_too_long_loses_its_last_ranks_and_says_so() {
    let source = faulty("shells", Failing(0));
    let mut loading = loading(&source, LoadingLimits { wishes_max: 3, ..limits(1) });
    loading.wish(&wishes(&[(0, 5), (1, 4), (2, 3), (3, 2), (4, 1), (4, 9)]));
    assert_eq!((loading.statistics().wishes_overflow, loading.outstanding()), (2, 3));
    assert_eq!(ids(&all(&mut loading)), bricks(&[4, 3, 2]));
}

#[test]
fn limits_that_allow_no_work_are_refused() {
    let refused = |limits| Loading::new(Vec::new(), limits).err().expect("refused").message;
    assert!(refused(limits(0)).contains("loaders"));
    assert!(refused(LoadingLimits { attempts: 0, ..limits(1) }).contains("attempts"));
}
