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
    ("common/ray_resolve.glsl", include_str!("../../shaders/common/ray_resolve.glsl")),
    ("common/fixed_point.glsl", include_str!("../../shaders/common/fixed_point.glsl")),
    ("common/filter.glsl", include_str!("../../shaders/common/filter.glsl")),
    ("common/exponential.glsl", include_str!("../../shaders/common/exponential.glsl")),
    ("common/transfer.glsl", include_str!("../../shaders/common/transfer.glsl")),
];
