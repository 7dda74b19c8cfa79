//! What the reflection says of a shader's buffers and images, for each way to declare and use them.

use ashfall::gpu::{BindingKind, ShaderCompiler, ShaderSources, Variant};

static SOURCES: &ShaderSources = &[(
    "uses.comp",
    "#version 460
layout(local_size_x = 8) in;
struct Entry { uvec2 state; float least; float most; };
layout(std430) readonly buffer entries { Entry entry[]; };
layout(std430) writeonly buffer requests { Entry request[]; };
layout(std430) buffer table { Entry slot[]; };
layout(std430) buffer counters { uint count[]; };
layout(std430) coherent buffer ranks { uint rank[]; };
layout(std430) buffer parts { readonly uint total; writeonly uint marks[]; };
layout(std430) buffer heads { readonly uint first; readonly Entry head[]; };
layout(r32f) writeonly uniform image3D atlas;
layout(rgba8) writeonly uniform image3D pictures[3];
uniform sampler3D probed[2];
void main() {
    uint index = gl_GlobalInvocationID.x;
    Entry wanted = entry[index];
    uint at = atomicAdd(count[0], 1u);
    atomicMin(rank[at], index + total);
    marks[at] = 1u;
    request[at] = wanted;
    slot[at] = head[first];
    imageStore(atlas, ivec3(at), vec4(texelFetch(probed[0], ivec3(0), 0).r));
    imageStore(pictures[1], ivec3(at), texelFetch(probed[1], ivec3(0), 0));
}",
)];

#[test]
fn bindings_say_how_the_shader_uses_them() {
    let shader = ShaderCompiler::new(SOURCES, None).compile(&Variant::plain("uses"));
    let reflection = shader.unwrap_or_else(|why| panic!("{why}")).reflection;
    let kind = |name: &str| {
        let found = reflection.bindings.iter().find(|binding| binding.name == name);
        found.unwrap_or_else(|| panic!("{name} in {:?}", reflection.bindings)).kind
    };
    let buffer = |reads, writes| BindingKind::StorageBuffer { reads, writes };
    assert_eq!(kind("entries"), buffer(true, false), "readonly array of structs");
    assert_eq!(kind("requests"), buffer(false, true), "writeonly array of structs");
    assert_eq!(kind("table"), buffer(true, true), "declared neither, though only written");
    assert_eq!(kind("counters"), buffer(true, true), "only atomics");
    assert_eq!(kind("ranks"), buffer(true, true), "only atomics, coherent");
    assert_eq!(kind("parts"), buffer(true, true), "one member each way");
    assert_eq!(kind("heads"), buffer(true, false), "each member readonly");
    assert_eq!(kind("atlas"), BindingKind::StorageImage { count: 1 });
    assert_eq!(kind("pictures"), BindingKind::StorageImage { count: 3 });
    assert_eq!(kind("probed"), BindingKind::SampledImage { count: 2 });
    let entries = reflection.bindings.iter().find(|binding| binding.name == "entries");
    let members = &entries.expect("bound").members;
    let names: Vec<_> = members.iter().map(|member| (&member.name[..], member.offset)).collect();
    assert_eq!(names, [("entry[]", 0), ("state", 0), ("least", 8), ("most", 12)]);
    assert_eq!(members[0].stride, 16);
}
