//! Moves every ray of a tile on through the bricks that are there.

use crate::gpu::{Buffer, ComputePipeline, Image, Recorder, Sampler};
use crate::passes::cache_buffers::{CacheBuffers, binds};
use crate::twins::march_bricks::Push;

/// What is kept of the rays of a tile between dispatches.
pub struct RayBuffers {
    /// `[ray]` fixed-point start and step in the level in use.
    pub ray_geometry: Buffer,
    /// `[ray]` position, optical depth, colour.
    pub ray_state: Buffer,
    /// `[ray]` the block of samples that the ray is in.
    pub ray_block: Buffer,
    /// `[ray]` where it waits.
    pub ray_place: Buffer,
}

/// What the pass touches beside cache and rays.
pub struct Resources<'r> {
    /// `[view]` rays of each view, linear in the pixel.
    pub views: &'r Buffer,
    /// `[segment]` transfer functions of all channels.
    pub transfer: &'r Buffer,
    /// `[number]` texels of bricks of one value.
    pub constants: &'r Buffer,
    /// One per texel format.
    pub atlases: &'r [Image],
    /// For every atlas.
    pub sampler: &'r Sampler,
    /// Where leaves lie and their words, where the variant has an octree.
    pub octree: Option<&'r OctreeBuffers>,
}

/// What rays read of a residency octree.
pub struct OctreeBuffers {
    /// `[level]` where the leaves of a level lie.
    pub level_leaves: Buffer,
    /// `[word]` which channels show something around a leaf, and in how large a box.
    pub leaf_words: Buffer,
}

/// Rays that have ended stay as they are; the others go on from where they were.
pub fn record<'r>(
    recorder: &mut Recorder<'r>,
    pipeline: &'r ComputePipeline,
    cache: &'r CacheBuffers,
    rays: &'r RayBuffers,
    resources: &Resources<'r>,
    push: &Push,
) {
    let has =
        |macro_name: &str| pipeline.variant().defines.iter().any(|(name, _)| name == macro_name);
    let [width, height] = push.tile_size_pixel;
    let atlases: Vec<_> =
        resources.atlases.iter().map(|atlas| (atlas, resources.sampler)).collect();
    let mut dispatch = recorder
        .compute(pipeline)
        .uniform("levels", &cache.levels)
        .read("page_table", &cache.page_table)
        .read("constants", resources.constants)
        .sample("atlases", &atlases)
        .write("slot_used", &cache.slot_used)
        .update("ray_geometry", &rays.ray_geometry)
        .update("ray_state", &rays.ray_state)
        .update("ray_block", &rays.ray_block)
        .update("ray_place", &rays.ray_place)
        .update("wished", &cache.wished)
        .update("progress", &cache.progress);
    dispatch = if has("TRANSFER_SEARCH") {
        dispatch.read("transfer", resources.transfer)
    } else {
        dispatch.uniform("transfer", resources.transfer)
    };
    dispatch =
        if has("SEVERAL_LEVELS") { dispatch.uniform("views", resources.views) } else { dispatch };
    if let Some(weight) = cache.wish_weight.as_ref().filter(|_| binds(pipeline, "wish_weight")) {
        dispatch = dispatch.update("wish_weight", weight);
    }
    if let Some(needed) = cache.slot_needed.as_ref().filter(|_| binds(pipeline, "slot_needed")) {
        dispatch = dispatch.write("slot_needed", needed);
    }
    if let Some(octree) = resources.octree.filter(|_| has("OCTREE")) {
        dispatch = dispatch
            .uniform("level_leaves", &octree.level_leaves)
            .read("leaf_words", &octree.leaf_words);
    }
    dispatch.push(push).threads([width, height, 1]);
}
