//! Updates that end where nothing changes, counted.

use ashfall::twins::octree::Nodes;
use ashfall::twins::octree_ranges::{Coding, Ranges, Work, update_ranges};
use ashfall::twins::octree_resident::Resident;
use ashfall::twins::octree_shape::{Shape, Wanted};
use ashfall::twins::octree_words::{Shown, Words};
use ashfall::volume::{Levels, Size3, ValueRange};

fn shape(fan_out: u32) -> Shape {
    let levels = Levels::of(Size3::cube(256), [1.0; 3], Size3::cube(16));
    let wanted = Wanted { leaf: [4; 3], fan_out, nodes_max: u64::MAX };
    Shape::new(&levels, Size3::cube(16), &wanted).expect("few nodes")
}

#[test]
fn a_second_brick_beside_the_first_stops_at_its_parent() {
    let mut resident = Resident::nothing(&shape(2));
    let mut count = |there: bool, brick: [u32; 3]| {
        let mut work = Work::default();
        match there {
            true => resident.arrives(0, brick, &mut work),
            false => resident.leaves(0, brick, &mut work),
        }
        (work.looked_at, work.changed)
    };
    // Itself and four levels above it.
    assert_eq!(count(true, [4, 5, 6]), (5, 5));
    assert_eq!(count(true, [5, 5, 6]), (2, 1));
    // Its parent is another one's, its grandparent is not.
    assert_eq!(count(true, [6, 5, 6]), (3, 2));
    assert_eq!(count(false, [4, 5, 6]), (2, 1));
    assert_eq!(count(false, [5, 5, 6]), (3, 2));
    assert_eq!(count(false, [6, 5, 6]), (5, 5));
}

#[test]
fn a_coarse_brick_is_told_to_all_places_beneath() {
    let mut resident = Resident::nothing(&shape(2));
    let mut work = Work::default();
    resident.arrives(2, [1, 0, 3], &mut work);
    // 64 + 8 + 1 beneath, two above.
    assert_eq!(work, Work { looked_at: 75, changed: 75 });
    assert_eq!(resident.best(0, [5, 2, 13]), Some(2));
    assert_eq!(resident.best(0, [8, 2, 13]), None);
}

#[test]
fn ranges_stop_at_the_first_tier_that_holds_them_already() {
    for fan_out in [2, 4] {
        let shape = shape(fan_out);
        let mut ranges = Ranges::unknown(Coding::Unsigned, shape.nodes());
        let tree = &shape.trees[0];
        let tiers = shape.tiers.len() as u64;
        let all = Nodes::all(shape.lowest(tree));
        let all_of = |least, greatest| move |_| ValueRange { least, greatest };
        let mut work = Work::default();
        update_ranges(&shape, 0, &mut ranges, all, all_of(10.0, 20.0), &mut work);
        assert!(work.changed == work.looked_at && work.changed > 64 * 64 * 64);
        let leaf = Nodes::NONE.with([17, 3, 42]);
        let mut update = |least, greatest| {
            let mut work = Work::default();
            let of = all_of(least, greatest);
            let changed = update_ranges(&shape, 0, &mut ranges, leaf, of, &mut work);
            (work.looked_at, work.changed, !changed.is_empty())
        };
        // The same again; narrower, within its neighbours' hull; wider, up to the root; and back.
        assert_eq!(update(10.0, 20.0), (1, 0, false));
        assert_eq!(update(12.0, 13.0), (2, 1, true));
        assert_eq!(update(12.0, 99.0), (tiers, tiers, true));
        assert_eq!(update(12.0, 13.0), (tiers, tiers, true));
    }
}

#[test]
fn words_change_as_far_as_boxes_reach() {
    // Two at a time, a box of 16 leaves is the largest of at most 32.
    for (fan_out, tiers, edge) in [(2, 6, 32), (4, 3, 16)] {
        let shape = shape(fan_out);
        let mut ranges = Ranges::unknown(Coding::Unsigned, shape.nodes());
        let tree = &shape.trees[0];
        assert_eq!(u64::from(tree.rise_max) + 1, tiers);
        let all = Nodes::all(shape.lowest(tree));
        let mut none = Work::default();
        update_ranges(&shape, 0, &mut ranges, all, |_| ValueRange::of(0.0), &mut none);
        let mut words = Words::unknown(&shape, 1);
        let shows = |range: ValueRange| range.greatest >= 100.0;
        fn shown<'a>(ranges: &'a Ranges, shows: &'a dyn Fn(ValueRange) -> bool) -> Shown<'a> {
            Shown { ranges, shows, levels: [0, 4] }
        }
        words.update(&shape, &[shown(&ranges, &shows)], 0, all, &mut none);
        let mut update = |leaf: [u32; 3], value: f32| {
            let mut work = Work::default();
            let leaf = Nodes::NONE.with(leaf);
            update_ranges(&shape, 0, &mut ranges, leaf, |_| ValueRange::of(value), &mut none);
            let sent = words.update(&shape, &[shown(&ranges, &shows)], 0, leaf, &mut work);
            (sent, work.changed)
        };
        // A value that shows as little as the one before: nothing is sent.
        assert_eq!(update([0; 3], 50.0), (0, 0));
        // The first that shows: the words of all leaves in the largest box around.
        assert_eq!(update([0; 3], 200.0), (u64::pow(edge, 3), tiers));
        // One beside it: its own, where the boxes differ already.
        assert_eq!(update([1, 0, 0], 200.0), (1, 1));
        // Far from both: the leaves of what was one box of nothing.
        let far = update([edge as u32 - 1; 3], 200.0);
        assert_eq!(far, (u64::pow(edge / u64::from(fan_out), 3), tiers - 1));
    }
}
