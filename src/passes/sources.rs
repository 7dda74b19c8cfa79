//! The GLSL that the binary carries.

use crate::gpu::ShaderSources;

/// Every shader and every common file, by name.
pub static SOURCES: &ShaderSources = &[
    ("cast.comp", include_str!("../../shaders/cast.comp")),
    ("rays.comp", include_str!("../../shaders/rays.comp")),
    ("march.comp", include_str!("../../shaders/march.comp")),
    ("probe.comp", include_str!("../../shaders/probe.comp")),
    ("resolve.comp", include_str!("../../shaders/resolve.comp")),
    ("common/limits.glsl", include_str!("../../shaders/common/limits.glsl")),
    ("common/ray.glsl", include_str!("../../shaders/common/ray.glsl")),
    ("common/ray_setup.glsl", include_str!("../../shaders/common/ray_setup.glsl")),
    ("common/ray_march.glsl", include_str!("../../shaders/common/ray_march.glsl")),
    ("common/macrocells.glsl", include_str!("../../shaders/common/macrocells.glsl")),
    ("common/preintegrate.glsl", include_str!("../../shaders/common/preintegrate.glsl")),
    ("common/ray_resolve.glsl", include_str!("../../shaders/common/ray_resolve.glsl")),
    ("common/fixed_point.glsl", include_str!("../../shaders/common/fixed_point.glsl")),
    ("common/filter.glsl", include_str!("../../shaders/common/filter.glsl")),
    ("common/exponential.glsl", include_str!("../../shaders/common/exponential.glsl")),
    ("common/transfer.glsl", include_str!("../../shaders/common/transfer.glsl")),
    ("march_bricks.comp", include_str!("../../shaders/march_bricks.comp")),
    ("publish.comp", include_str!("../../shaders/publish.comp")),
    ("tally.comp", include_str!("../../shaders/tally.comp")),
    ("choose.comp", include_str!("../../shaders/choose.comp")),
    ("count.comp", include_str!("../../shaders/count.comp")),
    ("scan.comp", include_str!("../../shaders/scan.comp")),
    ("place.comp", include_str!("../../shaders/place.comp")),
    ("octree_resident.comp", include_str!("../../shaders/octree_resident.comp")),
    ("grant.comp", include_str!("../../shaders/grant.comp")),
    ("common/brick_march.glsl", include_str!("../../shaders/common/brick_march.glsl")),
    ("common/cache.glsl", include_str!("../../shaders/common/cache.glsl")),
    ("common/classify.glsl", include_str!("../../shaders/common/classify.glsl")),
    ("common/ranking.glsl", include_str!("../../shaders/common/ranking.glsl")),
    ("common/ranks.glsl", include_str!("../../shaders/common/ranks.glsl")),
    ("common/ray_block.glsl", include_str!("../../shaders/common/ray_block.glsl")),
];
