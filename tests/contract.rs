//! What shaders, passes and host structs say of each other, held against the compiled SPIR-V.
//!
//! No device is needed. Each comparison is shown to notice a planted mismatch.

use std::collections::{BTreeMap, BTreeSet};
use std::mem::{offset_of, size_of};
use std::path::Path;

use ashfall::gpu::{
    Binding, BindingKind, ImageFormat, Member, Reflection, Shader, ShaderCompiler, Variant,
};
use ashfall::passes::brick_shape::{AtlasShape, BrickShape, OctreeShape};
use ashfall::passes::cache_buffers::{RankOrder, RankShape};
use ashfall::passes::march_shape::{ChannelShape, FilterShape, MacrocellUse, Shape};
use ashfall::passes::probe::{self, ProbeShape};
use ashfall::passes::{
    SOURCES, cast, choose, count, forget, grant, march, octree_resident, place, publish, rays,
    resolve, scan, tally,
};
use ashfall::twins;
use ashfall::twins::cache::{Answer, CacheRound, Choice, ChunkCounts, Progress, Tallies};
use ashfall::twins::octree::LevelLeaves;
use ashfall::twins::octree_resident::{Change, Places};
use ashfall::twins::place::Placement;
use ashfall::twins::publish::Update;
use ashfall::twins::ranks::LevelView;
use ashfall::twins::ray::{RayGeometry, RayState};
use ashfall::twins::ray_block::RayBlock;
use ashfall::twins::ray_setup::ViewRays;
use ashfall::twins::transfer::TransferSegment;

/// A struct as Rust lays it out.
struct Host {
    name: &'static str,
    bytes: usize,
    /// Name, offset, bytes.
    fields: Vec<(&'static str, usize, usize)>,
}

fn bytes_of_field<S, F>(_: impl Fn(&S) -> &F) -> usize {
    size_of::<F>()
}

macro_rules! host {
    ($kind:ty { $($field:ident),* $(,)? }) => {
        Host {
            name: stringify!($kind),
            bytes: size_of::<$kind>(),
            fields: vec![$((
                stringify!($field),
                offset_of!($kind, $field),
                bytes_of_field(|host: &$kind| &host.$field),
            )),*],
        }
    };
}

fn ray_geometry() -> Host {
    host!(RayGeometry {
        start_cell,
        sample_count,
        start_fraction,
        step_world,
        delta_cell,
        unused_0,
        delta_fraction,
        unused_1,
    })
}

fn ray_state() -> Host {
    host!(RayState {
        color,
        optical_depth,
        next_sample,
        samples_taken,
        optical_depth_rest,
        unused_0,
    })
}

fn transfer_segment() -> Host {
    host!(TransferSegment { start, slope, begins_at, window_scale, window_offset, unused_0 })
}

fn view_rays() -> Host {
    host!(ViewRays {
        origin_voxel,
        origin_column_voxel,
        origin_row_voxel,
        direction_voxel,
        direction_column_voxel,
        direction_row_voxel,
        direction_world,
        direction_column_world,
        direction_row_world,
    })
}

/// The struct with the fields of `inner` in place of the field that holds it.
fn flattened(outer: Host, field: &str, inner: Host) -> Host {
    let fields = outer.fields.into_iter().flat_map(|(name, start, bytes)| match name == field {
        true => inner.fields.iter().map(|(name, at, bytes)| (*name, start + at, *bytes)).collect(),
        false => vec![(name, start, bytes)],
    });
    Host { name: outer.name, bytes: outer.bytes, fields: fields.collect() }
}

/// The push constants of each pass.
fn push(shader: &str) -> Host {
    match shader {
        "rays" => host!(twins::rays::Push {
            tile_origin_pixel,
            tile_size_pixel,
            volume_size,
            view,
            step_world,
        }),
        "rays for bricks" => host!(twins::rays::BrickPush {
            tile_origin_pixel,
            tile_size_pixel,
            volume_size,
            view,
            step_world,
            level,
            unused_0,
        }),
        "probe" => host!(twins::probe::Push {
            origin_voxel,
            lines_across,
            column_voxel,
            lines_down,
            row_voxel,
            samples,
            step_voxel,
        }),
        "cast" => {
            let cast =
                host!(twins::cast::Push { rays, blocks_max, early_stop, background, unused_0 });
            flattened(cast, "rays", push("rays"))
        }
        "march_bricks" => host!(twins::march_bricks::Push {
            tile_origin_pixel,
            tile_size_pixel,
            volume_size,
            view,
            blocks_max,
            early_stop,
            round,
            last,
        }),
        "place" => host!(twins::place::Push { texels_max, first_placement }),
        "forget" => host!(twins::forget::Push {
            entry_first,
            channels,
            channel,
            places,
            slot_first,
            slot_count,
            keep,
            round,
        }),
        "publish" => host!(twins::publish::Push { update_count }),
        "tally" | "choose" | "count" | "scan" | "grant" => host!(CacheRound {
            round,
            slot_first,
            slot_count,
            entry_first,
            channels,
            word_first,
            word_count,
            ranks,
            grants_max,
            requests_max,
            grant_first,
            request_first,
            atlas,
            live_max,
            held,
        }),
        "octree_resident" => {
            host!(twins::octree_resident::Push { first_change, change_count, level_count })
        }
        "march" => host!(march::Push { tile_size_pixel, blocks_max, early_stop }),
        "resolve" => host!(resolve::Push { background, unused_0, tile_size_pixel }),
        other => panic!("{other}.comp is new: say here which struct its push constants are"),
    }
}

/// The struct that a buffer of this name holds an array of.
fn elements(buffer: &str) -> Option<Host> {
    match buffer {
        "ray_geometry" => Some(ray_geometry()),
        "ray_state" => Some(ray_state()),
        "transfer" => Some(transfer_segment()),
        "views" => Some(view_rays()),
        "levels" => Some(host!(LevelView {
            per_scale_step,
            depth,
            halvings,
            held,
            bricks,
            first_place,
            eye_brick,
            rank_first,
        })),
        "level_leaves" => Some(host!(LevelLeaves {
            leaves,
            first_word,
            shift,
            unused_0,
            rises,
            unused_1,
            brick_shift,
            unused_2,
        })),
        "ray_block" => {
            Some(host!(RayBlock { color, depth, transmitted, sample_index, level, met }))
        }
        "places_of_levels" => Some(host!(Places { bricks, first, halvings, unused_0 })),
        "changes" => Some(host!(Change { brick, level, first_word, there, unused_0, unused_1 })),
        "placements" => Some(host!(Placement { start, first_word, size, unused_0 })),
        "updates" => Some(host!(Update { entry, value, slot, owner })),
        "answers" => Some(host!(Answer {
            wished,
            first_rank,
            first_wishes,
            dead,
            live,
            grants,
            requests,
            touched,
        })),
        "chunk_counts" => Some(host!(ChunkCounts {
            unused,
            dead_unused,
            dead_used,
            above,
            at,
            requests,
            unused_0,
            unused_1,
        })),
        // Plain numbers: one u32 each, vec4 of a constant, entry and rank of a request.
        "page_table" | "slot_owner" | "slot_used" | "slot_needed" | "usage_order"
        | "usage_order_next" | "wished" | "wish_weight" | "touched" | "wishes_of_rank"
        | "live_of_rank" | "upload" | "grants" | "requests" | "constants" | "ray_place"
        | "resident" | "leaf_words" => None,
        // One struct, not an array: compared below.
        "progress" | "tallies" | "choice" => None,
        // Plain numbers: vec4 pixels, two counters, one sum a line.
        "picture" | "counters" | "sums" => None,
        other => panic!("buffer {other} is new: say here which struct it holds"),
    }
}

const SCALAR: ChannelShape = ChannelShape::Scalar { segments: 2 };
const RGBA: ChannelShape = ChannelShape::Rgba { segments: 3 };

fn shape(channels: &[ChannelShape], filter: FilterShape) -> Shape {
    Shape {
        channels: channels.to_vec(),
        filter,
        early_stop: false,
        nan_voxels: false,
        preintegrated: false,
        macrocells: MacrocellUse::Unused,
        sample_every: Vec::new(),
    }
}

fn skipping(shape: Shape) -> Shape {
    Shape { macrocells: MacrocellUse::Skipping, ..shape }
}

fn adaptive(shape: Shape) -> Shape {
    Shape { macrocells: MacrocellUse::Adaptive, ..shape }
}

fn rates(shape: Shape) -> Shape {
    Shape { sample_every: vec![2, 1, 8], ..shape }
}

fn spans(shape: Shape) -> Shape {
    Shape { preintegrated: true, ..shape }
}

/// Shapes of marching that matter: every macro, alone and together.
fn shapes() -> Vec<Shape> {
    use ChannelShape::Constant;
    use FilterShape::{Fetch, Quads, Sampler};
    let full = |shape: Shape| Shape { early_stop: true, nan_voxels: true, ..shape };
    vec![
        shape(&[Constant], Fetch),
        Shape { early_stop: true, ..shape(&[Constant], Fetch) },
        shape(&[Constant, Constant], Fetch),
        shape(&[SCALAR], Sampler),
        shape(&[SCALAR], Quads),
        shape(&[SCALAR], Fetch),
        Shape { early_stop: true, ..shape(&[SCALAR], Fetch) },
        Shape { nan_voxels: true, ..shape(&[SCALAR], Quads) },
        shape(&[RGBA], Fetch),
        full(shape(&[RGBA], Sampler)),
        shape(&[SCALAR, Constant, RGBA], Fetch),
        full(shape(&[SCALAR, SCALAR, SCALAR], Quads)),
        full(shape(&[SCALAR; 16], Fetch)),
        rates(shape(&[SCALAR], Quads)),
        rates(skipping(full(shape(&[SCALAR, Constant, RGBA], Fetch)))),
        // Segments that are searched: too many of one channel, too many of all.
        shape(&[ChannelShape::Scalar { segments: 25 }], Fetch),
        full(shape(&[ChannelShape::Rgba { segments: 24 }; 16], Fetch)),
        spans(shape(&[SCALAR], Quads)),
        spans(full(shape(&[RGBA], Fetch))),
        spans(shape(&[SCALAR, Constant, RGBA], Fetch)),
        skipping(shape(&[SCALAR], Sampler)),
        skipping(spans(shape(&[SCALAR], Quads))),
        adaptive(shape(&[SCALAR], Quads)),
        adaptive(full(shape(&[SCALAR, Constant, RGBA], Fetch))),
        spans(full(shape(&[ChannelShape::Scalar { segments: 25 }], Fetch))),
    ]
}

fn octree(word_bits: u32) -> OctreeShape {
    OctreeShape { leaf: [4; 3], word_bits, ancestors: false }
}

/// Shapes of marching through bricks: every macro, alone and together.
fn brick_shapes() -> Vec<BrickShape> {
    let atlas = |slot_first| AtlasShape {
        entry_first: slot_first * 4,
        channels: 1,
        slot_first,
        slots_across: [4, 4],
    };
    let plain = BrickShape {
        march: shape(&[SCALAR], FilterShape::Quads),
        places: vec![(0, 0)],
        atlases: vec![atlas(0)],
        ranks: RankShape { levels: 1, order: RankOrder::Guarded },
        finest: Vec::new(),
        several_levels: false,
        views: 1,
        skipping: false,
        octree: None,
        closed_form: false,
        show_states: false,
        marks: true,
        payload: [32; 3],
        slot: [34; 3],
    };
    let full = BrickShape {
        march: Shape {
            early_stop: true,
            nan_voxels: true,
            ..shape(&[SCALAR, RGBA], FilterShape::Fetch)
        },
        places: vec![(0, 0), (1, 0)],
        atlases: vec![atlas(0), atlas(64)],
        ranks: RankShape { levels: 4, order: RankOrder::Guarded },
        several_levels: true,
        views: 2,
        skipping: true,
        show_states: true,
        marks: true,
        ..plain.clone()
    };
    vec![
        BrickShape { march: shape(&[SCALAR], FilterShape::Sampler), ..plain.clone() },
        BrickShape { skipping: true, ..plain.clone() },
        BrickShape { marks: false, ..plain.clone() },
        BrickShape { octree: Some(octree(8)), ..plain.clone() },
        BrickShape { octree: Some(octree(8)), closed_form: true, ..plain.clone() },
        BrickShape { march: rates(plain.march.clone()), ..plain.clone() },
        BrickShape {
            octree: Some(octree(8)),
            march: rates(shape(&[SCALAR, RGBA], FilterShape::Fetch)),
            show_states: false,
            ..full.clone()
        },
        BrickShape { octree: Some(octree(32)), march: spans(plain.march.clone()), ..plain.clone() },
        BrickShape { octree: Some(octree(16)), show_states: false, ..full.clone() },
        BrickShape {
            octree: Some(OctreeShape { ancestors: true, ..octree(16) }),
            show_states: false,
            ..full.clone()
        },
        BrickShape { march: spans(plain.march.clone()), ..plain.clone() },
        BrickShape { march: spans(full.march.clone()), ..full.clone() },
        BrickShape { ranks: RankShape { levels: 4, order: RankOrder::Papers }, ..plain.clone() },
        BrickShape {
            ranks: RankShape { levels: 4, order: RankOrder::Substitute },
            ..plain.clone()
        },
        plain,
        BrickShape { ranks: RankShape { levels: 4, order: RankOrder::Substitute }, ..full.clone() },
        BrickShape {
            ranks: RankShape { levels: 4, order: RankOrder::Substitute },
            finest: vec![0, 2],
            ..full.clone()
        },
        BrickShape {
            march: shape(&[ChannelShape::Scalar { segments: 25 }, SCALAR], FilterShape::Fetch),
            ..full.clone()
        },
        full,
    ]
}

fn compiler() -> ShaderCompiler {
    ShaderCompiler::new(SOURCES, Some(std::env::temp_dir().join("ashfall-test-spirv")))
}

fn compiled(variant: &Variant) -> Shader {
    compiler().compile(variant).unwrap_or_else(|why| panic!("{variant:?}: {why}"))
}

/// Every shader with its variants that matter.
fn all() -> Vec<(&'static str, Vec<Shader>)> {
    let probes = [
        ProbeShape::Loop,
        ProbeShape::OneTexel,
        ProbeShape::Filtered(FilterShape::Sampler),
        ProbeShape::Filtered(FilterShape::Fetch),
        ProbeShape::Filtered(FilterShape::Quads),
    ];
    let shapes = shapes();
    let march = shapes.iter().map(|shape| compiled(&shape.variant("march")));
    let cast = shapes.iter().zip([1, 3].into_iter().cycle());
    let cast = cast.map(|(shape, views)| compiled(&cast::variant(shape, views)));
    use RankOrder::{Guarded, Papers, Substitute};
    let rank_shapes = [(1, Guarded), (4, Guarded), (4, Substitute), (4, Papers)]
        .map(|(levels, order)| RankShape { levels, order });
    let ranked = |variant: fn(RankShape) -> Variant| {
        rank_shapes.iter().map(|shape| compiled(&variant(*shape))).collect::<Vec<_>>()
    };
    let mut of_rays: Vec<_> = [1, 3].iter().map(|views| compiled(&rays::variant(*views))).collect();
    of_rays.push(compiled(&rays::brick_variant(2, 3)));
    let bricks = brick_shapes();
    let place_formats = [
        ImageFormat::R8Unorm,
        ImageFormat::R16Unorm,
        ImageFormat::R32Sfloat,
        ImageFormat::Rgba8Unorm,
        ImageFormat::Rgba16Unorm,
        ImageFormat::Rgba32Sfloat,
    ];
    vec![
        ("cast", cast.collect()),
        ("march_bricks", bricks.iter().map(|shape| compiled(&shape.variant())).collect()),
        ("place", place_formats.map(|format| compiled(&place::variant(format))).to_vec()),
        ("forget", vec![compiled(&forget::variant())]),
        ("publish", vec![compiled(&publish::variant())]),
        ("tally", ranked(tally::variant)),
        ("choose", vec![compiled(&choose::variant())]),
        ("count", ranked(count::variant)),
        ("scan", vec![compiled(&scan::variant())]),
        ("grant", ranked(grant::variant)),
        ("octree_resident", vec![compiled(&octree_resident::variant())]),
        ("rays", of_rays),
        ("march", march.collect()),
        ("resolve", vec![compiled(&resolve::variant()), compiled(&resolve::states_variant())]),
        ("probe", probes.iter().map(|shape| compiled(&probe::variant(*shape))).collect()),
    ]
}

fn repository() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// A struct of the host against the members that SPIR-V gives it; the last may be left out.
fn struct_differs(host: &Host, members: &[Member], may_end_early: bool) -> Vec<String> {
    let mut wrong = Vec::new();
    let listed: usize = host.fields.iter().map(|(_, _, bytes)| bytes).sum();
    if listed != host.bytes {
        wrong.push(format!(
            "{}: the fields named in this test have {listed} bytes of {}: name all, leave no padding",
            host.name, host.bytes
        ));
    }
    let missing = host.fields.len().saturating_sub(members.len());
    if members.len() > host.fields.len() || missing > usize::from(may_end_early) {
        wrong.push(format!(
            "{} has {} fields, the shader {} members",
            host.name,
            host.fields.len(),
            members.len()
        ));
    }
    for ((name, offset, bytes), member) in host.fields.iter().zip(members) {
        // The shader nests what the host writes as one name; `cache` is all that a block holds.
        let member_name = member.name.strip_prefix("cache.").unwrap_or(&member.name);
        let same_name = member_name.replace('.', "_") == *name;
        if !same_name || (member.offset, member.bytes) != (*offset, *bytes) {
            wrong.push(format!(
                "{}: {name} at {offset} of {bytes} bytes is {} at {} of {} bytes in the shader",
                host.name, member.name, member.offset, member.bytes
            ));
        }
    }
    wrong
}

/// A buffer's array elements against the struct that the host fills it with.
fn elements_differ(host: &Host, binding: &Binding) -> Vec<String> {
    let Some((array, members)) = binding.members.split_first() else {
        return vec![format!("buffer {} has no members", binding.name)];
    };
    let mut wrong = struct_differs(host, members, false);
    let whole = host.bytes > 0 && array.bytes % host.bytes == 0;
    if !array.name.ends_with("[]") || !whole || array.offset != 0 || array.stride != host.bytes {
        wrong.push(format!(
            "buffer {}: {} at {} with stride {}, but {} has {} bytes",
            binding.name, array.name, array.offset, array.stride, host.name, host.bytes
        ));
    }
    wrong
}

fn push_differs(host: &Host, reflection: &Reflection) -> Vec<String> {
    let mut wrong = struct_differs(host, &reflection.push, true);
    let end = reflection.push.last().map_or(0, |last| last.offset + last.bytes);
    if reflection.push_bytes as usize != end || end > host.bytes {
        wrong.push(format!(
            "{}: {} bytes pushed, members end at {end}, the host has {}",
            host.name, reflection.push_bytes, host.bytes
        ));
    }
    wrong
}

/// What a shader's header says.
#[derive(Clone, Debug, Default, PartialEq)]
struct Header {
    /// Name of a binding, and "reads", "writes" or "updates".
    access: BTreeMap<String, &'static str>,
    workgroup: Option<[u32; 3]>,
    variants: String,
    twin: String,
    /// What a common file binds for whoever includes it.
    binds: BTreeSet<String>,
    /// Common files that the header says more in: "as common/ray_march.glsl".
    told_in: BTreeSet<String>,
}

const SECTIONS: [&str; 9] =
    ["reads", "writes", "updates", "binds", "shape", "spaces", "variants", "twin", "source"];

fn header(text: &str) -> Header {
    let mut header = Header::default();
    let mut section = "";
    let lines = text.lines().map_while(|line| line.strip_prefix("//")).skip(1);
    for line in lines {
        let line = line.strip_prefix(' ').unwrap_or(line);
        let named = line.split_whitespace().filter(|word| word.starts_with("common/"));
        header.told_in.extend(named.map(|word| word.trim_end_matches([',', ';', '.']).to_owned()));
        let mut said = line.trim();
        if !line.starts_with(' ') {
            let first = line.split_whitespace().next().unwrap_or("");
            section = SECTIONS.iter().find(|known| **known == first).copied().unwrap_or("");
            said = line.strip_prefix(section).unwrap_or(line).trim();
        }
        match section {
            "reads" | "writes" | "updates" | "binds" => {
                let mut words = said.split_whitespace();
                if let (Some(name), Some(of)) = (words.next(), words.next())
                    && of.starts_with('[')
                {
                    if section == "binds" {
                        header.binds.insert(name.to_owned());
                    } else {
                        header.access.insert(name.to_owned(), section);
                    }
                }
            }
            "shape" => {
                let numbers: Vec<&str> = said.rsplit(',').next().unwrap_or("").split('x').collect();
                let numbers: Vec<u32> =
                    numbers.iter().filter_map(|part| part.trim().parse().ok()).collect();
                header.workgroup = <[u32; 3]>::try_from(numbers).ok();
            }
            "variants" => header.variants += said,
            "twin" => header.twin = said.to_owned(),
            _ => {}
        }
    }
    header
}

fn access(kind: &BindingKind) -> &'static str {
    match kind {
        BindingKind::StorageBuffer { reads: true, writes: true } => "updates",
        BindingKind::StorageBuffer { writes: true, .. } | BindingKind::StorageImage { .. } => {
            "writes"
        }
        BindingKind::StorageBuffer { .. }
        | BindingKind::UniformBuffer
        | BindingKind::SampledImage { .. } => "reads",
    }
}

/// A header against the reflections of all variants of its shader.
fn header_differs(header: &Header, variants: &[&Reflection]) -> Vec<String> {
    let mut wrong = Vec::new();
    let mut bound = BTreeSet::new();
    for reflection in variants {
        for binding in &reflection.bindings {
            bound.insert(binding.name.clone());
            let (is, said) = (access(&binding.kind), header.access.get(&binding.name));
            if said != Some(&is) {
                wrong.push(format!("the shader {is} {}, its header says {said:?}", binding.name));
            }
        }
        if header.workgroup != Some(reflection.workgroup) {
            wrong.push(format!(
                "the workgroup is {:?}, the header's shape {:?}",
                reflection.workgroup, header.workgroup
            ));
        }
    }
    for name in header.access.keys().filter(|name| !bound.contains(*name)) {
        wrong.push(format!("the header names {name}, which no variant binds"));
    }
    if !repository().join(&header.twin).is_file() || header.twin.is_empty() {
        wrong.push(format!("the header's twin {:?} is not there", header.twin));
    }
    wrong.dedup();
    wrong
}

/// What a pass binds, read from its source: `.read("views", ...)`.
fn pass_differs(header: &Header, pass: &str) -> Vec<String> {
    let mut bound = BTreeMap::new();
    let calls = [
        (".read(\"", "reads"),
        (".uniform(\"", "reads"),
        (".sample(\"", "reads"),
        (".write(\"", "writes"),
        (".update(\"", "updates"),
        (".store(\"", "writes"),
    ];
    for (call, sense) in calls {
        for (at, _) in pass.match_indices(call) {
            let name = pass[at + call.len()..].split('"').next().unwrap_or("");
            bound.insert(name.to_owned(), sense);
        }
    }
    if bound == header.access {
        return Vec::new();
    }
    vec![format!("the pass binds {bound:?}, the shader's header says {:?}", header.access)]
}

/// The source of a pass, or of what passes share.
fn pass_of(name: &str) -> String {
    let path = repository().join(format!("src/passes/{name}.rs"));
    std::fs::read_to_string(path).expect("the shader's pass")
}

/// A pass with the methods that it calls of what binds for several passes: those that march share the
/// scene, those that rank the cache.
fn with_shared(pass: &str) -> String {
    let mut whole = pass.to_owned();
    for (owner, file) in [("scene", "march_shape"), ("buffers", "cache_buffers")] {
        for method in pass_of(file).split(" fn ").skip(1) {
            let name = method.split(['<', '(']).next().unwrap_or("");
            if pass.contains(&format!("{owner}.{name}(")) {
                whole += method;
            }
        }
    }
    whole
}

/// A shader's text and those of the common files it includes, each once.
fn with_includes(name: &str, texts: &mut BTreeMap<String, &'static str>) {
    if texts.insert(name.to_owned(), source(name)).is_some() {
        return;
    }
    for rest in source(name).lines().filter_map(|line| line.strip_prefix("#include \"")) {
        with_includes(rest.trim_end().trim_end_matches('"'), texts);
    }
}

/// Macros that a shader's source asks about, without its own include guards.
fn macros(text: &str) -> BTreeSet<&str> {
    let mut asked = BTreeSet::new();
    for line in text.lines().filter(|line| line.starts_with('#')) {
        for question in ["#ifdef ", "#ifndef ", "defined("] {
            for (at, _) in line.match_indices(question) {
                let after = &line[at + question.len()..];
                let end = after.find(|c: char| !(c.is_alphanumeric() || c == '_'));
                asked.insert(&after[..end.unwrap_or(after.len())]);
            }
        }
    }
    let guards = text.lines().filter_map(|line| line.strip_prefix("#define "));
    guards.filter(|name| name.ends_with("_GLSL")).for_each(|name| _ = asked.remove(name));
    asked
}

fn source(name: &str) -> &'static str {
    SOURCES.iter().find(|(known, _)| *known == name).expect("a source").1
}

#[test]
fn host_structs_lie_as_in_the_shaders() {
    let mut seen = BTreeSet::new();
    let shaders = all();
    for (name, variants) in &shaders {
        for shader in variants {
            let bricks = shader.variant.defines.iter().any(|(define, _)| define == "BRICKS");
            let push = if bricks { push("rays for bricks") } else { push(name) };
            assert_eq!(push_differs(&push, &shader.reflection), [""; 0], "{name}");
            for binding in &shader.reflection.bindings {
                let image = matches!(
                    binding.kind,
                    BindingKind::SampledImage { .. } | BindingKind::StorageImage { .. }
                );
                if image {
                    continue;
                }
                if let Some(host) = elements(&binding.name) {
                    assert_eq!(
                        elements_differ(&host, binding),
                        [""; 0],
                        "{name}: {}",
                        binding.name
                    );
                    seen.insert(host.name);
                }
            }
        }
    }
    let wanted = [
        "Answer",
        "Change",
        "ChunkCounts",
        "LevelLeaves",
        "LevelView",
        "Placement",
        "Places",
        "RayBlock",
        "RayGeometry",
        "RayState",
        "TransferSegment",
        "Update",
        "ViewRays",
    ];
    assert_eq!(seen, BTreeSet::from(wanted), "every shared struct is compared");
    let resolve = compiled(&resolve::variant()).reflection;
    let of = |name: &str| resolve.bindings.iter().find(|binding| binding.name == name).unwrap();
    assert_eq!(of("picture").members[0].stride, 16, "a pixel is four f32");
    for (host, shader, buffer) in [
        (host!(Progress { front, waiting, running, moved }), "tally", "progress"),
        (host!(Tallies { dead, live, wished, unused_0 }), "choose", "tallies"),
        (host!(Choice { grants, dead_grants, request_cut, victim_cut }), "choose", "choice"),
    ] {
        let (_, variants) = shaders.iter().find(|(name, _)| *name == shader).expect("a shader");
        let binding = variants[0].reflection.bindings.iter().find(|b| b.name == buffer).unwrap();
        let mut members = binding.members.clone();
        for member in &mut members {
            member.name = member.name.rsplit('.').next().unwrap_or("").to_owned();
        }
        assert_eq!(struct_differs(&host, &members, false), [""; 0], "{buffer}");
    }
    let counters: Vec<_> = of("counters").members.iter().map(|member| member.offset).collect();
    assert_eq!(counters, [0, 4]);
}

#[test]
fn headers_say_what_the_shaders_do() {
    for (name, variants) in all() {
        let text = source(&format!("{name}.comp"));
        let header = header(text);
        let reflections: Vec<_> = variants.iter().map(|shader| &shader.reflection).collect();
        assert_eq!(header_differs(&header, &reflections), [""; 0], "{name}.comp");
        assert_eq!(header.twin, format!("src/twins/{name}.rs"));
        let pass = with_shared(&pass_of(name));
        assert_eq!(pass_differs(&header, &pass), [""; 0], "src/passes/{name}.rs");

        let defined = variants.iter().flat_map(|shader| &shader.variant.defines);
        let defined: BTreeSet<&str> = defined.map(|(name, _)| &name[..]).collect();
        let mut texts = BTreeMap::new();
        with_includes(&format!("{name}.comp"), &mut texts);
        let whole: String = texts.values().copied().collect();
        for (file, text) in &texts {
            let of_file = crate::header(text);
            for binding in &of_file.binds {
                assert!(header.access.contains_key(binding), "{name}.comp does not tell {binding}");
            }
            let strange = of_file.told_in.iter().find(|told| !texts.contains_key(*told));
            assert_eq!(strange, None, "{file} sends its reader to a file that {name} lacks");
        }
        let told: String = texts.values().map(|text| crate::header(text).variants + " ").collect();
        for asked in macros(&whole) {
            assert!(
                defined.contains(asked),
                "{name}.comp asks about {asked}: no variant defines it"
            );
        }
        for given in defined {
            let known = told.split(|c: char| !(c.is_alphanumeric() || c == '_'));
            assert!(known.clone().any(|word| word == given), "{name}.comp: header lacks {given}");
            assert!(whole.matches(given).count() > 1, "{name}.comp never uses {given}");
        }
    }
    for (name, text) in SOURCES.iter().filter(|(name, _)| name.starts_with("common/")) {
        for twin in text.split("twin: ").skip(1) {
            let twin = twin.split_whitespace().next().unwrap_or("");
            assert!(repository().join(twin).is_file(), "{name}: its twin {twin} is not there");
        }
    }
}

#[test]
fn every_comp_file_is_compiled_here() {
    let here: BTreeSet<_> = all().iter().map(|(name, _)| format!("{name}.comp")).collect();
    let carried = SOURCES.iter().map(|(name, _)| *name).filter(|name| name.ends_with(".comp"));
    assert_eq!(here, carried.map(str::to_owned).collect());
}

#[test]
fn the_binary_carries_the_files_on_disk() {
    let folder = repository().join("shaders");
    let mut names = BTreeSet::new();
    for (inside, prefix) in [(folder.clone(), ""), (folder.join("common"), "common/")] {
        for entry in std::fs::read_dir(inside).expect("shaders").flatten() {
            if entry.path().is_file() {
                names.insert(format!("{prefix}{}", entry.file_name().to_string_lossy()));
            }
        }
    }
    assert_eq!(names, SOURCES.iter().map(|(name, _)| (*name).to_owned()).collect());
    for (name, text) in SOURCES {
        assert_eq!(*text, std::fs::read_to_string(folder.join(name)).expect("read"), "{name}");
    }
}

#[test]
fn what_a_scene_lacks_is_not_in_the_shader() {
    for shape in shapes() {
        let reflection = compiled(&shape.variant("march")).reflection;
        let images: Vec<_> = reflection
            .bindings
            .iter()
            .filter_map(|binding| match binding.kind {
                BindingKind::SampledImage { count } => Some((&binding.name[..], count)),
                BindingKind::StorageBuffer { .. }
                | BindingKind::StorageImage { .. }
                | BindingKind::UniformBuffer => None,
            })
            .collect();
        match shape.images() {
            0 => assert_eq!(images, [], "{shape:?}"),
            count if shape.macrocells == MacrocellUse::Unused => {
                assert_eq!(images, [("channels", count as u32)], "{shape:?}");
            }
            count => {
                let both = [("macrocells", 1), ("channels", count as u32)];
                assert_eq!(images, both, "{shape:?}");
            }
        }
        let bytes = if shape.early_stop { 16 } else { 12 };
        assert_eq!(reflection.push_bytes, bytes, "{shape:?}");
        let numbers = reflection.bindings.iter().map(|binding| binding.number).enumerate();
        assert!(numbers.clone().all(|(index, number)| index as u32 == number), "{shape:?}");
    }
}

#[test]
fn each_feature_costs_instructions() {
    use FilterShape::{Fetch, Quads, Sampler};
    let early = |shape: Shape| Shape { early_stop: true, ..shape };
    let nan = |shape: Shape| Shape { nan_voxels: true, ..shape };
    let count = |shape: &Shape| compiled(&shape.variant("march")).reflection.instructions;
    for ladder in [
        vec![
            shape(&[ChannelShape::Constant], Fetch),
            shape(&[SCALAR], Fetch),
            early(shape(&[SCALAR], Fetch)),
            nan(early(shape(&[SCALAR], Fetch))),
            spans(nan(early(shape(&[SCALAR], Fetch)))),
        ],
        vec![
            nan(early(shape(&[SCALAR], Fetch))),
            nan(early(shape(&[SCALAR; 2], Fetch))),
            nan(early(shape(&[SCALAR; 3], Fetch))),
            nan(early(shape(&[SCALAR; 16], Fetch))),
        ],
        vec![
            shape(&[ChannelShape::Constant], Sampler),
            shape(&[SCALAR], Sampler),
            shape(&[SCALAR], Quads),
            shape(&[SCALAR], Fetch),
        ],
        vec![
            shape(&[ChannelShape::Constant], Fetch),
            early(shape(&[ChannelShape::Constant], Fetch)),
        ],
        vec![shape(&[SCALAR], Fetch), shape(&[RGBA], Fetch), shape(&[RGBA, SCALAR], Fetch)],
    ] {
        let counts: Vec<u32> = ladder.iter().map(count).collect();
        assert!(
            counts.windows(2).all(|pair| pair[0] < pair[1]),
            "instructions do not rise: {counts:?} of {ladder:?}"
        );
    }
}

#[test]
fn a_struct_that_lies_otherwise_is_noticed() {
    let reflection = compiled(&rays::variant(2)).reflection;
    let of = |name: &str| -> Binding {
        reflection.bindings.iter().find(|binding| binding.name == name).expect("bound").clone()
    };
    let good = of("ray_geometry");
    assert_eq!(elements_differ(&ray_geometry(), &good), [""; 0]);
    let plants: [fn(&mut Binding); 8] = [
        |binding| binding.members[0].stride += 16,
        |binding| binding.members[0].offset = 16,
        |binding| binding.members[3].name = "start".to_owned(),
        |binding| binding.members[3].offset += 4,
        |binding| binding.members[3].bytes = 16,
        |binding| binding.members.swap(2, 4),
        |binding| drop(binding.members.pop()),
        |binding| binding.members.push(binding.members[1].clone()),
    ];
    for (index, plant) in plants.iter().enumerate() {
        let mut bad = good.clone();
        plant(&mut bad);
        assert_ne!(elements_differ(&ray_geometry(), &bad), [""; 0], "plant {index}");
    }
    assert_ne!(elements_differ(&ray_state(), &good), [""; 0], "another struct");
    let mut forgetful = ray_geometry();
    forgetful.fields.pop();
    let mut short = good.clone();
    short.members.pop();
    assert_ne!(elements_differ(&forgetful, &short), [""; 0], "a field forgotten on both sides");

    assert_eq!(push_differs(&push("rays"), &reflection), [""; 0]);
    let plants: [fn(&mut Reflection); 4] = [
        |reflection| reflection.push_bytes += 8,
        |reflection| reflection.push[1].name = "tile.size".to_owned(),
        |reflection| reflection.push.truncate(3),
        |reflection| reflection.push[4].offset += 8,
    ];
    for (index, plant) in plants.iter().enumerate() {
        let mut bad = reflection.clone();
        plant(&mut bad);
        assert_ne!(push_differs(&push("rays"), &bad), [""; 0], "plant {index}");
    }
}

#[test]
fn a_header_that_lies_is_noticed() {
    let reflection = compiled(&resolve::variant()).reflection;
    let states = compiled(&resolve::states_variant()).reflection;
    let good = header(source("resolve.comp"));
    assert_eq!(header_differs(&good, &[&reflection, &states]), [""; 0]);
    let plants: [fn(&mut Header); 7] = [
        |header| _ = header.access.insert("picture".to_owned(), "updates"),
        |header| _ = header.access.insert("ray_state".to_owned(), "updates"),
        |header| _ = header.access.remove("counters"),
        |header| _ = header.access.insert("views".to_owned(), "reads"),
        |header| header.workgroup = Some([64, 1, 1]),
        |header| header.workgroup = None,
        |header| header.twin = "src/twins/resolved.rs".to_owned(),
    ];
    for (index, plant) in plants.iter().enumerate() {
        let mut bad = good.clone();
        plant(&mut bad);
        assert_ne!(header_differs(&bad, &[&reflection, &states]), [""; 0], "plant {index}");
    }
    let pass = ".read(\"ray_state\", a).write(\"picture\", b).update(\"counters\", c)\
                .read(\"ray_block\", d).read(\"ray_place\", e)";
    assert_eq!(pass_differs(&good, pass), [""; 0]);
    for (from, to) in [("read", "write"), ("counters", "counter"), (".update", ".read")] {
        assert_ne!(pass_differs(&good, &pass.replace(from, to)), [""; 0], "{from}");
    }
    let (good, tally) = (header(source("tally.comp")), pass_of("tally"));
    assert_eq!(pass_differs(&good, &with_shared(&tally)), [""; 0]);
    for shared in ["bind_ranking(", "read_weights("] {
        assert!(tally.contains(shared), "{shared}");
        let without = with_shared(&tally.replace(shared, "leave_out("));
        assert_ne!(pass_differs(&good, &without), [""; 0], "{shared}");
    }
    let twice = pass_of("grant").replace("bind_ranking(", "read_weights(");
    assert_ne!(pass_differs(&header(source("grant.comp")), &with_shared(&twice)), [""; 0]);
}

#[test]
fn headers_and_macros_are_read_as_written() {
    let read = header(
        "// a.comp: what it is for.\n//\n// reads    one  [ray]  text\n//          two  [x]  more [text]\n\
         //          that goes on\n// updates  three  [y]\n// shape    one thread per ray, 8 x 4 x 1\n\
         // variants A: x;\n//          B\n// twin     src/twins/a.rs\n#version 460\n// reads four [z]\n",
    );
    let access: Vec<_> = read.access.iter().map(|(name, sense)| (&name[..], *sense)).collect();
    assert_eq!(access, [("one", "reads"), ("three", "updates"), ("two", "reads")]);
    assert_eq!((read.workgroup, &read.twin[..]), (Some([8, 4, 1]), "src/twins/a.rs"));
    let asked = "#ifdef A\n#elif defined(B) && !defined(C_2)\n// #ifdef D\n#define E\n";
    let asked = macros(asked);
    assert_eq!(macros("#ifndef A_GLSL\n#define A_GLSL\n#ifdef B"), BTreeSet::from(["B"]));
    assert_eq!(asked, BTreeSet::from(["A", "B", "C_2"]));
    let read =
        header("// b.glsl: it.\n//\n// binds    c  [x]  text\n// variants as common/d.glsl;\n");
    assert_eq!(read.binds, BTreeSet::from(["c".to_owned()]));
    assert_eq!(read.told_in, BTreeSet::from(["common/d.glsl".to_owned()]));
}
