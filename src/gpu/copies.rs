//! Steps that copy, fill and prepare: buffers into images and buffers, numbers into buffers.

use crate::gpu::access::Access;
use crate::gpu::misuse::misuse;
use crate::gpu::recorder::{Recorder, Step, Use, Work};
use crate::gpu::resources::{Buffer, Image};

/// A box of an image, and where its texels lie tightly packed in a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageRegion {
    /// Of the first texel; a multiple of 4 and of the texel's bytes.
    pub buffer_offset: u64,
    /// First texel of the box.
    pub start: [u32; 3],
    /// Texels along x, y, z.
    pub size: [u32; 3],
}

impl ImageRegion {
    /// Texels in the box.
    pub fn texels(&self) -> u64 {
        self.size.iter().map(|edge| u64::from(*edge)).product()
    }
}

/// Bytes of one buffer that go into another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BufferRegion {
    /// First byte in the source.
    pub source_offset: u64,
    /// First byte in the target.
    pub target_offset: u64,
    /// How many.
    pub bytes: u64,
}

/// Vulkan wants buffer offsets of image copies to be multiples of this on queues that only copy.
const OFFSET_STEP_BYTES: u64 = 4;

impl<'r> Recorder<'r> {
    /// Copies a box of texels from a buffer into an image.
    pub fn copy_to_image(
        &mut self,
        label: &'static str,
        source: &'r Buffer,
        buffer_offset: u64,
        target: &'r Image,
        start: [u32; 3],
        size: [u32; 3],
    ) {
        let region = ImageRegion { buffer_offset, start, size };
        self.copy_regions_to_image(label, source, target, &[region]);
    }

    /// Copies boxes of texels from a buffer into an image, in one step. The boxes must not overlap:
    /// they are copied in no order. Without a region, nothing is recorded.
    pub fn copy_regions_to_image(
        &mut self,
        label: &'static str,
        source: &'r Buffer,
        target: &'r Image,
        regions: &[ImageRegion],
    ) {
        if regions.is_empty() {
            return;
        }
        let spec = target.spec();
        let texel_bytes = spec.format.bytes();
        let mut read = Vec::with_capacity(regions.len());
        for region in regions {
            let ImageRegion { buffer_offset, start, size } = *region;
            let inside = (0..3).all(|axis| {
                size[axis] > 0
                    && start[axis].checked_add(size[axis]).is_some_and(|e| e <= spec.size[axis])
            });
            let grain = self.queue_facts();
            if inside && grain.is_some_and(|queue| !queue.may_copy(start, size, spec.size)) {
                misuse(format_args!(
                    "a copy of {size:?} texels at {start:?} of {} is finer than its queue copies",
                    spec.name
                ));
            }
            let end = buffer_offset.checked_add(region.texels() * texel_bytes);
            let Some(end) = end.filter(|end| inside && *end <= source.bytes()) else {
                misuse(format_args!("copy outside of {} or {}", source.name(), spec.name));
            };
            if buffer_offset % OFFSET_STEP_BYTES != 0 || buffer_offset % texel_bytes != 0 {
                misuse(format_args!(
                    "copy from {} at byte {buffer_offset}: no multiple of {OFFSET_STEP_BYTES} and of a texel of {}",
                    source.name(),
                    spec.name
                ));
            }
            read.push(buffer_offset..end);
        }
        let uses =
            vec![Use::parts(source, Access::CopyRead, read), Use::image(target, Access::CopyWrite)];
        let work = Work::CopyToImage { source, target, regions: regions.to_vec() };
        self.steps.push(Step { label, work, uses, keeps: Vec::new() });
    }

    /// Copies bytes from one buffer into another.
    pub fn copy_buffer(
        &mut self,
        label: &'static str,
        source: &'r Buffer,
        source_offset: u64,
        target: &'r Buffer,
        target_offset: u64,
        bytes: u64,
    ) {
        let region = BufferRegion { source_offset, target_offset, bytes };
        self.copy_regions_to_buffer(label, source, target, &[region]);
    }

    /// Copies several ranges of bytes from one buffer into another, in one step. They must not
    /// overlap: they are copied in no order. Without a region, nothing is recorded.
    pub fn copy_regions_to_buffer(
        &mut self,
        label: &'static str,
        source: &'r Buffer,
        target: &'r Buffer,
        regions: &[BufferRegion],
    ) {
        if source.life.id == target.life.id {
            misuse(format_args!("{} is copied into itself", source.name()));
        }
        if regions.is_empty() {
            return;
        }
        let read = |region: &BufferRegion| range_of(source, region.source_offset, region.bytes);
        let written = |region: &BufferRegion| range_of(target, region.target_offset, region.bytes);
        self.steps.push(Step {
            label,
            uses: vec![
                Use::parts(source, Access::CopyRead, regions.iter().map(read).collect()),
                Use::parts(target, Access::CopyWrite, regions.iter().map(written).collect()),
            ],
            work: Work::CopyToBuffer { source, target, regions: regions.to_vec() },
            keeps: Vec::new(),
        });
    }
}

impl<'r> Recorder<'r> {
    /// Fills a part of a buffer with one number; offset and bytes are multiples of 4.
    pub fn fill(
        &mut self,
        label: &'static str,
        target: &'r Buffer,
        offset: u64,
        bytes: u64,
        value: u32,
    ) {
        let range = range_of(target, offset, bytes);
        if !offset.is_multiple_of(4) || !bytes.is_multiple_of(4) {
            misuse(format_args!("{bytes} bytes at {offset} of {} are no numbers", target.name()));
        }
        self.steps.push(Step {
            label,
            work: Work::Fill { target, offset, bytes, value },
            uses: vec![Use::parts(target, Access::CopyWrite, vec![range])],
            keeps: Vec::new(),
        });
    }

    /// Makes an image that nothing was written to ready to be bound; what it holds is undefined.
    /// Records nothing for an image that was used before.
    pub fn prepare(&mut self, image: &'r Image) {
        let used = Use::image(image, Access::Prepare);
        if used.fresh.is_some() {
            let (label, work) = ("prepare", Work::Prepare);
            self.steps.push(Step { label, work, uses: vec![used], keeps: Vec::new() });
        }
    }
}

/// The bytes, which must be some and lie in the buffer.
fn range_of(buffer: &Buffer, offset: u64, bytes: u64) -> std::ops::Range<u64> {
    match offset.checked_add(bytes) {
        Some(end) if bytes > 0 && end <= buffer.bytes() => offset..end,
        _ => misuse(format_args!("{bytes} bytes at {offset} are not in {}", buffer.name())),
    }
}
