//! Every texel of an image, read by a sampling shader that the tests bring along.

use ashfall::gpu::{
    ComputePipeline, Image, Sampler, SamplerFilter, ShaderCompiler, ShaderSources, Variant,
};

use super::device::Device;

static SOURCES: &ShaderSources = &[(
    "all_texels.comp",
    "#version 460
layout(local_size_x = 8) in;
layout(std430) writeonly buffer texels { vec4 texel[]; };
uniform sampler3D image;
void main() {
    uvec3 size = uvec3(textureSize(image, 0));
    uint index = gl_GlobalInvocationID.x;
    if (index < size.x * size.y * size.z) {
        ivec3 at = ivec3(index % size.x, index / size.x % size.y, index / (size.x * size.y));
        texel[index] = texelFetch(image, at, 0);
    }
}",
)];

impl Device {
    /// Texels as a shader sees them, x fastest. What wrote them must have ended.
    pub fn all_texels(&self, image: &Image) -> Vec<[f32; 4]> {
        let shader = ShaderCompiler::new(SOURCES, None).compile(&Variant::plain("all_texels"));
        let pipeline = ComputePipeline::new(&self.gpu, shader.expect("it compiles"));
        let pipeline = pipeline.expect("a pipeline");
        let sampler = Sampler::new(&self.gpu, SamplerFilter::Nearest).expect("a sampler");
        let count: u32 = image.spec().size.iter().product();
        let room = self.room::<[f32; 4]>("texels", count as usize);
        self.run(|recorder| {
            let dispatch = recorder.compute(&pipeline).write("texels", &room);
            dispatch.sample("image", &[(image, &sampler)]).threads([count, 1, 1]);
            recorder.host_read(&room);
        });
        self.written(&room)
    }
}
