//! Left out, and proven: a ladder of scenes from the plainest to the fullest. Each rung adds what its
//! feature needs, by name, and nothing else; what is planned is what is created; all that is created is
//! used; and a feature that is taken away from the fullest scene is gone.

mod common;

use std::collections::BTreeSet;

use ashfall::gpu::{ShaderCompiler, Variant};
use ashfall::passes::SOURCES;
use ashfall::render::Plan;
use ashfall::study::feature_price::Counts;
use ashfall::study::ladder::{Extent, Feature, inventory, scene};
use common::created::assert_as_planned;
use common::drawing::Device;

/// Several levels are in use where pixels are a little fewer than voxels.
const EXTENT: Extent = Extent { edge: 40, payload: 8, size: [32, 32] };

/// What a feature adds to the rungs below it. A binding of an added pass is not named: it comes with it.
struct Rung {
    feature: Feature,
    added: &'static [&'static str],
    /// Done in another way from here on.
    removed: &'static [&'static str],
    /// How the plans below begin to say that it is left out.
    left_out: Option<&'static str>,
    /// Of what is added, what a higher feature needs too.
    shared: &'static [&'static str],
}

/// The plainest scene: one value, one ray a pixel, one pass.
const PLAINEST: &[&str] = &[
    "pass cast",
    "binding cast.counters",
    "binding cast.picture",
    "binding cast.transfer",
    "binding cast.views",
    "buffer counters",
    "buffer picture",
    "buffer transfer",
    "buffer views",
    "macro LOAD_CHANNELS",
    "macro SAMPLE_CHANNELS",
    "macro SEGMENTS_TOTAL",
    "macro VIEWS",
    "object buffer",
    "object command_buffer",
    "object command_pool",
    "object descriptor_pool",
    "object descriptor_set",
    "object descriptor_set_layout",
    "object device_memory",
    "object pipeline",
    "object pipeline_layout",
    "object query_pool",
    "object semaphore",
    "object shader_module",
];

const NOTHING: Rung =
    Rung { feature: Feature::Field, added: &[], removed: &[], left_out: None, shared: &[] };

const LADDER: [Rung; Feature::ALL.len()] = [
    Rung {
        feature: Feature::Field,
        added: &[
            "binding cast.channels",
            "buffer staging_half_0",
            "image channel_0",
            "macro FILTER_FETCH",
            "macro IMAGES",
            "object image",
            "object image_view",
            "object sampler",
        ],
        left_out: Some("images, sampler, staging, transfer role"),
        ..NOTHING
    },
    Rung {
        feature: Feature::LongTransfer,
        added: &["macro SEARCH_STEPS", "macro TRANSFER_SEARCH"],
        removed: &["macro SEGMENTS_TOTAL"],
        left_out: Some("search of transfer segments"),
        ..NOTHING
    },
    Rung {
        feature: Feature::SecondChannel,
        added: &["buffer staging_half_1", "image channel_1", "macro SEVERAL_CHANNELS"],
        left_out: Some("mixing of channels"),
        shared: &["buffer staging_half_1", "macro SEVERAL_CHANNELS"],
        ..NOTHING
    },
    Rung { feature: Feature::Rgba, added: &["image channel_2"], ..NOTHING },
    Rung {
        feature: Feature::NanVoxels,
        added: &["macro NAN_VOXELS"],
        left_out: Some("test for NaN"),
        ..NOTHING
    },
    Rung {
        feature: Feature::EarlyStop,
        added: &["macro EARLY_STOP"],
        left_out: Some("early stop"),
        ..NOTHING
    },
    Rung {
        feature: Feature::Preintegrated,
        added: &["macro PREINTEGRATED", "macro SPAN_CHANNELS"],
        left_out: Some("spans between samples"),
        ..NOTHING
    },
    Rung { feature: Feature::SecondView, ..NOTHING },
    Rung { feature: Feature::Tiles, ..NOTHING },
    Rung {
        feature: Feature::ShortDispatches,
        added: &[
            "buffer ray_geometry",
            "buffer ray_state",
            "pass march",
            "pass rays",
            "pass resolve",
        ],
        removed: &["pass cast"],
        left_out: Some("rays and resolve as passes"),
        shared: &["buffer ray_geometry", "buffer ray_state", "pass rays", "pass resolve"],
    },
    Rung {
        feature: Feature::Paged,
        added: &[
            "binding rays.levels",
            "binding rays.ray_block",
            "binding rays.ray_place",
            "buffer answers",
            "buffer choice",
            "buffer chunk_counts",
            "buffer constants",
            "buffer grants",
            "buffer levels",
            "buffer live_of_rank",
            "buffer page_table",
            "buffer progress",
            "buffer ray_block",
            "buffer ray_place",
            "buffer report",
            "buffer requests",
            "buffer slot_needed",
            "buffer slot_owner",
            "buffer slot_used",
            "buffer tallies",
            "buffer touched",
            "buffer updates_0",
            "buffer updates_1",
            "buffer usage_order_0",
            "buffer usage_order_1",
            "buffer wished",
            "buffer wishes_of_rank",
            "image atlas_0",
            "image atlas_1",
            "image atlas_2",
            "macro ATLASES",
            "macro BRICKS",
            "macro LEVELS",
            "macro LOOK_UP_CHANNELS",
            "macro MARK_CHANNELS",
            "macro PAYLOAD",
            "macro SLOT",
            "pass choose",
            "pass count",
            "pass grant",
            "pass march_bricks",
            "pass publish",
            "pass scan",
            "pass tally",
        ],
        removed: &[
            "image channel_0",
            "image channel_1",
            "image channel_2",
            "macro IMAGES",
            "pass march",
        ],
        left_out: Some("page table, requests, loaders"),
        ..NOTHING
    },
    Rung {
        feature: Feature::Skipping,
        added: &["macro SKIPPING"],
        left_out: Some("skipping of bricks that show nothing"),
        ..NOTHING
    },
    Rung {
        feature: Feature::SeveralLevels,
        added: &["binding march_bricks.views", "macro SEVERAL_LEVELS"],
        left_out: Some("change of level along a ray"),
        ..NOTHING
    },
    Rung {
        feature: Feature::Substitute,
        added: &[
            "binding count.wish_weight",
            "binding grant.wish_weight",
            "binding march_bricks.wish_weight",
            "binding tally.slot_used",
            "binding tally.wish_weight",
            "buffer wish_weight",
            "macro SUBSTITUTE",
            "macro WEIGHTS",
        ],
        removed: &[
            "binding count.progress",
            "binding count.slot_needed",
            "binding grant.progress",
            "binding grant.slot_needed",
            "binding march_bricks.slot_needed",
            "binding tally.progress",
            "binding tally.slot_needed",
            "buffer slot_needed",
        ],
        left_out: Some("weights of wishes"),
        ..NOTHING
    },
    Rung {
        feature: Feature::Placed,
        added: &[
            "buffer placements",
            "buffer upload",
            "macro TEXEL_BYTES",
            "macro TEXEL_FLOAT",
            "macro TEXEL_FORMAT",
            "pass place",
        ],
        left_out: Some("upload buffer and its pass"),
        ..NOTHING
    },
    Rung {
        feature: Feature::ShowStates,
        added: &["binding resolve.ray_block", "binding resolve.ray_place", "macro SHOW_STATES"],
        left_out: Some("tints of rays"),
        ..NOTHING
    },
];

type Names = BTreeSet<String>;

fn names(list: &[&str]) -> Names {
    list.iter().map(|name| (*name).to_owned()).collect()
}

/// What `now` lists and `before` does not, without bindings of passes that `before` lacks.
fn added(before: &Names, now: &Names) -> Names {
    let comes_with_pass = |name: &&String| {
        let pass = name.strip_prefix("binding ").and_then(|binding| binding.split('.').next());
        pass.is_some_and(|pass| !before.contains(&format!("pass {pass}")))
    };
    now.difference(before).filter(|name| !comes_with_pass(name)).cloned().collect()
}

fn says(plan: &Plan, left_out: &str) -> bool {
    plan.left_out.iter().any(|(what, _)| what.starts_with(left_out))
}

fn plan(device: &Device, features: &[Feature]) -> Plan {
    let (data, settings) = scene(features, &EXTENT).unwrap_or_else(|why| panic!("{why}"));
    device.plan(&data, &settings)
}

#[test]
fn every_rung_adds_what_its_feature_needs_and_nothing_else() {
    let Some(device) = Device::open() else { return };
    let mut below = plan(&device, &[]);
    assert_eq!(inventory(&below), names(PLAINEST), "the plainest scene");
    for (index, rung) in LADDER.iter().enumerate() {
        let name = rung.feature.name();
        assert_eq!(rung.feature, Feature::ALL[index], "the ladder's order");
        let plan = plan(&device, &Feature::ALL[..=index]);
        let (before, now) = (inventory(&below), inventory(&plan));
        assert_eq!(added(&before, &now), names(rung.added), "{name} adds");
        assert_eq!(added(&now, &before), names(rung.removed), "{name} does in another way");
        let (less, more) = (Counts::of(&below), Counts::of(&plan));
        let in_shaders = rung.added.iter().any(|name| name.starts_with("macro"))
            || rung.added.iter().any(|name| name.starts_with("pass"))
            || rung.feature == Feature::Rgba;
        let instructions = more.spirv_instructions.cmp(&less.spirv_instructions);
        assert_eq!(instructions.is_gt(), in_shaders, "{name}: {less:?}, {more:?}");
        assert!(instructions.is_ge() && more.objects >= less.objects, "{name}");
        if let Some(left_out) = rung.left_out {
            assert!(says(&below, left_out), "{name}: below it, {:?}", below.left_out);
            assert!(!says(&plan, left_out), "{name}: {:?}", plan.left_out);
        }
        below = plan;
    }
    device.finish();
}

#[test]
fn what_is_taken_away_from_the_fullest_scene_is_gone() {
    let Some(device) = Device::open() else { return };
    let fullest = plan(&device, &Feature::ALL);
    let all = inventory(&fullest);
    for rung in LADDER {
        let name = rung.feature.name();
        let without = plan(&device, &rung.feature.all_without());
        let left = inventory(&without);
        for gone in rung.added.iter().filter(|name| all.contains(**name)) {
            let stays = rung.shared.contains(gone);
            assert_eq!(left.contains(*gone), stays, "without {name}: {gone}");
        }
        if let Some(left_out) = rung.left_out.filter(|_| rung.shared.is_empty()) {
            assert!(says(&without, left_out), "without {name}: {:?}", without.left_out);
            assert!(!says(&fullest, left_out), "the fullest: {:?}", fullest.left_out);
        }
    }
    let march = |plan: &Plan| {
        let march = plan.passes.iter().find(|pass| pass.name == "march_bricks");
        march.map(|pass| pass.dispatches_per_tile)
    };
    let long = plan(&device, &Feature::ShortDispatches.all_without());
    assert!(march(&long) == Some(1) && march(&fullest) > Some(1), "short dispatches");
    device.finish();
}

#[test]
fn every_rung_creates_what_its_plan_counts_and_uses_all_of_it() {
    // Without a cache: what is planned is what these sources give.
    let compiler = ShaderCompiler::new(SOURCES, None);
    println!(
        "rung                     objects passes buffers images bindings instructions     bytes"
    );
    for top in 0..=Feature::ALL.len() {
        // A device of its own, so that everything counted belongs to this rung.
        let Some(device) = Device::open() else { return };
        let features = &Feature::ALL[..top];
        let name = features.last().map_or("the plainest", |feature| feature.name());
        let (data, mut settings) = scene(features, &EXTENT).unwrap_or_else(|why| panic!("{why}"));
        settings.paging.keep_records = true;
        let mut renderer = device.renderer(&data, &settings);
        let mut used = Names::new();
        for view in 0..data.scene.views.len() {
            let (picture, statistics) =
                renderer.draw(view, &mut |_| {}).unwrap_or_else(|why| panic!("{name}: {why}"));
            assert!(statistics.converged, "{name}: {statistics:?}");
            let seen = picture.pixels.iter().filter(|pixel| pixel[3] > 0.05).count();
            assert!(seen > 100, "{name}: {seen} pixels show something");
            for step in renderer.records().iter().flat_map(|record| &record.steps) {
                used.extend(step.accesses.iter().map(|(name, _)| (*name).to_owned()));
            }
        }
        let plan = renderer.plan();
        assert_as_planned(&device, plan, name);
        for pass in &plan.passes {
            let variant = Variant { shader: pass.name, defines: pass.defines.clone() };
            let shader = compiler.compile(&variant).unwrap_or_else(|why| panic!("{why}"));
            assert_eq!(shader.spirv.len(), pass.spirv_words, "{name}: {}", pass.name);
        }
        let made = plan.buffers.iter().map(|buffer| buffer.name);
        let made = made.chain(plan.images.iter().map(|image| image.name));
        // Uploads of a direct volume are over before its first record.
        let unused: Vec<_> = made
            .filter(|name| !used.contains(*name) && !name.starts_with("staging_half_"))
            .collect();
        assert_eq!(unused, Vec::<&str>::new(), "{name}: made, and never used");
        let counts = Counts::of(plan);
        println!(
            "{name:<24} {:>7} {:>6} {:>7} {:>6} {:>8} {:>12} {:>9}",
            counts.objects,
            counts.passes,
            counts.buffers,
            counts.images,
            counts.bindings,
            counts.spirv_instructions,
            counts.memory_bytes
        );
        drop(renderer);
        device.finish();
    }
}
