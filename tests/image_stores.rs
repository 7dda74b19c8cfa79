//! Shaders that store into images: every format, beside what copies put there, and images that are
//! bound before anything is in them.

mod common;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use ashfall::gpu::{
    Access, BindingKind, ComputePipeline, Image, ImageFormat, ImageSpec, Recorder, RoleKind,
    Sampler, SamplerFilter, ShaderCompiler, ShaderSources, Staging, StepKind, Variant,
};
use common::device::{Device, device};

static SOURCES: &ShaderSources = &[
    (
        "store.comp",
        "#version 460
layout(local_size_x = 4, local_size_y = 4, local_size_z = 4) in;
layout(FORMAT) writeonly uniform image3D atlas[2];
layout(push_constant) uniform Push { uvec3 start; uint levels; uvec3 size; } push;
void main() {
    uvec3 at = gl_GlobalInvocationID;
    if (any(greaterThanEqual(at, push.size))) return;
    uvec4 level = (at.x * 37u + at.y * 1009u + at.z * 4099u + uvec4(0u, 1u, 2u, 3u)) % push.levels;
    vec4 texel = vec4(level) / float(push.levels - 1u);
    imageStore(atlas[0], ivec3(push.start + at), texel);
    imageStore(atlas[1], ivec3(push.start + at), texel.wzyx);
}",
    ),
    (
        "load.comp",
        "#version 460
layout(local_size_x = 4) in;
layout(r32f) uniform image3D atlas;
void main() {
    ivec3 at = ivec3(gl_GlobalInvocationID);
    imageStore(atlas, at, 2.0 * imageLoad(atlas, at));
}",
    ),
];

const SIZE: [u32; 3] = [13, 9, 7];
const FORMATS: [ImageFormat; 6] = [
    ImageFormat::R8Unorm,
    ImageFormat::R16Unorm,
    ImageFormat::R32Sfloat,
    ImageFormat::Rgba8Unorm,
    ImageFormat::Rgba16Unorm,
    ImageFormat::Rgba32Sfloat,
];

#[repr(C)]
#[derive(Clone, Copy, bytemuck::NoUninit)]
struct Push {
    start: [u32; 3],
    levels: u32,
    size: [u32; 3],
}

fn pipeline(device: &Device, format: ImageFormat) -> Arc<ComputePipeline> {
    let variant = Variant::plain("store").define("FORMAT", format.glsl());
    let shader = ShaderCompiler::new(SOURCES, None).compile(&variant).expect("it compiles");
    ComputePipeline::new(&device.gpu, shader).expect("a pipeline")
}

fn image(device: &Device, name: &'static str, format: ImageFormat, stored: bool) -> Image {
    let spec = ImageSpec { name, size: SIZE, format, stored };
    Image::new(&device.gpu, &spec).expect("an image")
}

/// Numbers that each format keeps exactly.
fn levels(format: ImageFormat) -> u32 {
    match format {
        ImageFormat::R8Unorm | ImageFormat::Rgba8Unorm => 256,
        ImageFormat::R16Unorm | ImageFormat::Rgba16Unorm => 65536,
        // 0, 1/4096 and so on.
        ImageFormat::R32Sfloat | ImageFormat::Rgba32Sfloat => 4097,
    }
}

fn channels(format: ImageFormat) -> usize {
    match format {
        ImageFormat::R8Unorm | ImageFormat::R16Unorm | ImageFormat::R32Sfloat => 1,
        _ => 4,
    }
}

/// The twin of store.comp, in levels; outside of the box, what was copied: all zeros.
fn expected(push: &Push, second: bool) -> Vec<[u32; 4]> {
    let mut all = Vec::new();
    for z in 0..SIZE[2] {
        for y in 0..SIZE[1] {
            for x in 0..SIZE[0] {
                let at: [Option<u32>; 3] = std::array::from_fn(|axis| {
                    let offset = [x, y, z][axis].checked_sub(push.start[axis]);
                    offset.filter(|offset| *offset < push.size[axis])
                });
                let mut texel = [0; 4];
                if let [Some(x), Some(y), Some(z)] = at {
                    let level = |c| (x * 37 + y * 1009 + z * 4099 + c) % push.levels;
                    texel = [0, 1, 2, 3].map(|c| level(if second { 3 - c } else { c }));
                }
                all.push(texel);
            }
        }
    }
    all
}

fn same(device: &Device, image: &Image, push: &Push, second: bool) {
    let format = image.spec().format;
    let unit = (push.levels - 1) as f32;
    for (index, (found, wanted)) in
        device.all_texels(image).iter().zip(expected(push, second)).enumerate()
    {
        for c in 0..channels(format) {
            let level = found[c] * unit;
            assert!(
                (level - wanted[c] as f32).abs() < 0.01,
                "{} texel {index}[{c}]: level {level}, not {}",
                format.name(),
                wanted[c]
            );
        }
    }
}

#[test]
fn every_format_takes_a_box_of_texels() {
    let Some(device) = device() else { return };
    for format in FORMATS {
        if !device.gpu.stores(format) {
            assert!(!device.same_bits(), "lavapipe stores {}", format.name());
            eprintln!("{} cannot be stored here", format.name());
            continue;
        }
        let pipeline = pipeline(&device, format);
        let kinds: Vec<_> = pipeline.reflection().bindings.iter().map(|b| b.kind).collect();
        assert_eq!(kinds, [BindingKind::StorageImage { count: 2 }]);
        let images =
            [image(&device, "first", format, true), image(&device, "second", format, true)];
        // Zeros first, by a copy on the other role.
        let texels = vec![0; (u64::from(13 * 9 * 7u32) * format.bytes()) as usize];
        let mut staging = Staging::new(&device.gpu, 1 << 16).expect("staging");
        assert!(staging.stage_image(&texels, 0, [0; 3], SIZE).expect("staged"));
        assert!(staging.stage_image(&texels, 1, [0; 3], SIZE).expect("staged"));
        let copied = staging.flush("zeros", &[&images[0], &images[1]], &[], &[]);
        let copied = copied.expect("flushed").expect("staged").point;
        let push = Push { start: [3, 1, 2], levels: levels(format), size: [9, 8, 4] };
        let mut recorder = Recorder::new(&device.gpu, RoleKind::Render, None);
        for _ in 0..2 {
            let dispatch = recorder.compute(&pipeline).store("atlas", &[&images[0], &images[1]]);
            dispatch.push_front(&push).threads(push.size);
        }
        let submitted = recorder.submit(&[copied]).expect("submitted");
        let steps = &submitted.record.steps;
        assert!(steps[0].barriers.is_empty(), "the time point orders the copy");
        assert_eq!(steps[1].barriers.len(), 2, "the second store waits for the first");
        same(&device, &images[0], &push, false);
        same(&device, &images[1], &push, true);
    }
}

#[test]
fn an_image_may_be_stored_into_first_of_all() {
    let Some(device) = device() else { return };
    let format = ImageFormat::R32Sfloat;
    let pipeline = pipeline(&device, format);
    let images = [image(&device, "first", format, true), image(&device, "second", format, true)];
    let push = Push { start: [0; 3], levels: levels(format), size: SIZE };
    let mut recorder = Recorder::new(&device.gpu, RoleKind::Render, None);
    let dispatch = recorder.compute(&pipeline).store("atlas", &[&images[0], &images[1]]);
    dispatch.push_front(&push).threads(push.size);
    let submitted = recorder.submit(&[]).expect("submitted");
    assert!(submitted.record.steps[0].barriers.iter().all(|(_, barrier)| barrier.discard));
    assert_eq!(submitted.record.steps[0].barriers.len(), 2);
    assert_eq!(submitted.record.steps[0].accesses[0], ("first", Access::ShaderStore));
    same(&device, &images[0], &push, false);
    same(&device, &images[1], &push, true);
}

#[test]
fn a_prepared_image_may_be_bound_empty_and_filled_later() {
    let Some(device) = device() else { return };
    let image = image(&device, "atlas", ImageFormat::R8Unorm, false);
    let mut recorder = Recorder::new(&device.gpu, RoleKind::Render, None);
    recorder.prepare(&image);
    recorder.prepare(&image);
    let submitted = recorder.submit(&[]).expect("submitted");
    let [step] = &submitted.record.steps[..] else { panic!("once: {:?}", submitted.record) };
    assert_eq!((step.label, &step.kind), ("prepare", &StepKind::Prepare));
    assert!(step.barriers.iter().any(|(name, barrier)| *name == "atlas" && barrier.discard));
    assert_eq!(device.all_texels(&image).len(), 13 * 9 * 7, "whatever they hold");
    let mut staging = Staging::new(&device.gpu, 1 << 10).expect("staging");
    assert!(staging.stage_image(&[255; 13 * 9 * 7], 0, [0; 3], SIZE).expect("staged"));
    let copied = staging.flush("ones", &[&image], &[], &[submitted.point]).expect("flushed");
    let copied = copied.expect("staged");
    assert!(copied.record.steps[0].barriers.is_empty(), "{:?}", copied.record.steps[0].barriers);
    device.gpu.wait(copied.point).expect("it ends");
    assert!(device.all_texels(&image).iter().all(|texel| texel[0] == 1.0));
}

#[test]
fn misuse_of_stores_is_refused() {
    let Some(device) = device() else { return };
    let compiler = ShaderCompiler::new(SOURCES, None);
    let why = compiler.compile(&Variant::plain("load")).expect_err("it reads");
    assert!(why.message.contains("not declared writeonly"), "{}", why.message);
    let pipeline = pipeline(&device, ImageFormat::R32Sfloat);
    let sampler = Sampler::new(&device.gpu, SamplerFilter::Nearest).expect("a sampler");
    let made = |stored| image(&device, "atlas", ImageFormat::R32Sfloat, stored);
    let push = Push { start: [0; 3], levels: 2, size: SIZE };
    let (first, plain) = (made(true), made(false));
    let refused = |record: &dyn Fn()| catch_unwind(AssertUnwindSafe(record)).is_err();
    let new = || Recorder::new(&device.gpu, RoleKind::Render, None);
    let one_of_two = refused(&|| {
        let mut recorder = new();
        let dispatch = recorder.compute(&pipeline).store("atlas", &[&first]);
        dispatch.push_front(&push).threads(SIZE);
    });
    assert!(one_of_two, "an array of two");
    let not_made_for_it = refused(&|| _ = new().compute(&pipeline).store("atlas", &[&plain]));
    assert!(not_made_for_it, "no storage image");
    let sampled = refused(&|| {
        let mut recorder = new();
        let images = [(&first, &sampler), (&first, &sampler)];
        let dispatch = recorder.compute(&pipeline).sample("atlas", &images);
        dispatch.push_front(&push).threads(SIZE);
    });
    assert!(sampled, "stored into, not sampled");
}
