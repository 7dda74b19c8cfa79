//! Nodes of every volume: nested, numbered without gaps, leaves within one brick and of whole voxels.

use std::collections::BTreeSet;

use ashfall::twins::octree::{
    Here, Nodes, Tier, bits_of_word, box_of_node, here, node_of_voxel, packed, unpacked,
};
use ashfall::twins::octree_shape::{Shape, Wanted};
use ashfall::twins::octree_words::Words;
use ashfall::volume::{Levels, Size3};

use crate::random::Random;
use crate::world::PLANS;

fn shape(size: [u32; 3], payload: u32, leaf: [u32; 3], fan_out: u32) -> Shape {
    let payload = Size3::cube(payload);
    let levels = Levels::of(Size3::from_array(size), [1.0; 3], payload);
    let wanted = Wanted { leaf, fan_out, nodes_max: u64::MAX };
    Shape::new(&levels, payload, &wanted).expect("few nodes")
}

fn nodes(shape: &Shape) -> Vec<[u32; 3]> {
    shape.tiers.iter().map(|tier| tier.nodes).collect()
}

#[test]
fn tiers_go_from_leaves_through_bricks_to_one_node() {
    let two = shape([256; 3], 32, [4; 3], 2);
    assert_eq!(nodes(&two), [64, 32, 16, 8, 4, 2, 1].map(|edge| [edge; 3]));
    assert_eq!(two.trees.iter().map(|tree| tree.tier).collect::<Vec<_>>(), [0, 1, 2, 3]);
    // Two halvings at a time down from bricks and up from them.
    let four = shape([256; 3], 32, [4; 3], 4);
    assert_eq!(nodes(&four), [64, 32, 8, 2, 1].map(|edge| [edge; 3]));
    let thin = shape([1024, 1024, 40], 32, [8, 8, 4], 2);
    assert_eq!(thin.leaf, [8, 8, 4]);
    assert_eq!(thin.tiers[0].nodes, [128, 128, 10]);
    assert_eq!(thin.tiers[1].shift, [0, 0, 1]);
    let long = shape([1, 1, 5000], 32, [4; 3], 2);
    assert_eq!(long.tiers[0].nodes, [1, 1, 1250]);
    assert_eq!(nodes(&long).last(), Some(&[1; 3]));
}

#[test]
fn leaves_grow_where_memory_is_short() {
    let payload = Size3::cube(32);
    let levels = Levels::of(Size3::cube(1024), [1.0; 3], payload);
    let of = |nodes_max: u64, fan_out: u32| {
        let wanted = Wanted { leaf: [4; 3], fan_out, nodes_max };
        Shape::new(&levels, payload, &wanted).expect("few nodes")
    };
    for fan_out in [2, 4] {
        let leaves = [u64::MAX, 20_000_000, 3_000_000, 1].map(|most| of(most, fan_out).leaf);
        assert_eq!(leaves[0], [4; 3]);
        assert!(leaves.is_sorted() && leaves[3] == [32; 3], "{leaves:?}");
    }
    let all = of(u64::MAX, 2);
    // (8/7)^2 times the leaves of level 0, and no more.
    assert!((all.nodes() as f64) < 1.31 * 256f64.powi(3), "{}", all.nodes());
    assert!((all.words() as f64) < 1.15 * 256f64.powi(3), "{}", all.words());
}

#[test]
fn nodes_are_nested_and_numbered_without_gaps() {
    for plan in PLANS {
        for fan_out in [2, 4] {
            let shape = plan.shape(fan_out);
            let mut numbers = BTreeSet::new();
            for (level, tree) in shape.trees.iter().enumerate() {
                let tiers = &shape.tiers[tree.tier as usize..];
                for tier in tiers {
                    let number = |node| tree.number(tier, node);
                    assert!(Nodes::all(tier).each().all(|node| numbers.insert(number(node))));
                }
                for pair in tiers.windows(2) {
                    children_part_their_tier(&pair[0], &pair[1], fan_out);
                }
                // A brick's leaves are its own, and all are some brick's.
                let mut leaves = 0;
                let [nx, ny, nz] = shape.bricks(level);
                for brick in (Nodes { start: [0; 3], end: [nx, ny, nz] }).each() {
                    let own = shape.leaves_of_brick(level, brick);
                    assert!(!own.is_empty(), "brick {brick:?} of level {level} of {plan:?}");
                    leaves += own.count();
                }
                assert_eq!(leaves, Nodes::all(shape.lowest(tree)).count());
                let edges = shape.leaf_edges(level);
                assert!((0..3).all(|axis| plan.payload[axis] % edges[axis] == 0), "{edges:?}");
            }
            assert_eq!(numbers.len(), shape.nodes());
            assert_eq!(numbers.last(), Some(&(shape.nodes() - 1)));
        }
    }
}

fn children_part_their_tier(finer: &Tier, tier: &Tier, fan_out: u32) {
    let mut seen = BTreeSet::new();
    for parent in Nodes::all(tier).each() {
        let children = Nodes::NONE.with(parent).in_tier(tier, finer);
        assert!((0..3).all(|a| children.end[a] - children.start[a] <= fan_out));
        assert!(!children.is_empty());
        for child in children.each() {
            assert!(seen.insert(child), "{child:?} has two parents");
            assert_eq!(Nodes::NONE.with(child).in_tier(finer, tier).start, parent);
        }
    }
    assert_eq!(seen.len() as u64, Nodes::all(finer).count());
}

#[test]
fn a_voxel_lies_in_the_box_of_its_node() {
    let mut random = Random(9);
    for plan in PLANS {
        for fan_out in [2, 4] {
            let shape = plan.shape(fan_out);
            let words = Words::unknown(&shape, 1);
            for turn in 0..400 {
                let level = turn % shape.trees.len();
                let tree = &shape.trees[level];
                let size = shape.sizes[level];
                let voxel = size.map(|edge| random.below(edge.into()) as i32);
                let holds = |(first, edge): ([i32; 3], [i32; 3])| {
                    (0..3).all(|a| first[a] <= voxel[a] && voxel[a] < first[a] + edge[a])
                };
                for tier in &shape.tiers[tree.tier as usize..] {
                    let node = node_of_voxel(shape.leaf, tree, tier, voxel);
                    assert!(holds(box_of_node(shape.leaf, tree, tier, node)));
                }
                let Here { shows, first, edge, .. } =
                    here(shape.leaf, &shape.tiers, tree, &words.of_leaf, voxel);
                assert!(shows == 1 && holds((first, edge)));
            }
        }
    }
}

#[test]
fn words_are_packed_and_unpacked() {
    assert_eq!([1, 4, 5, 12, 13, 16, 28].map(bits_of_word), [8, 8, 16, 16, 32, 32, 32]);
    let mut random = Random(3);
    for channels in 1..=28 {
        let bits = bits_of_word(channels);
        for _ in 0..50 {
            let shows = random.next() as u32 & ((1 << channels) - 1);
            let word = shows | (random.next() as u32 & 15) << 28;
            let small = packed(word, bits);
            assert!(u64::from(small) < 1 << bits);
            assert_eq!(unpacked(small, bits), word);
        }
    }
}
