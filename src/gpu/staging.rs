//! Two staging halves, or three: the host fills one while the transfer role copies from the others. One, where
//! there is but one copy.

use std::sync::Arc;
use std::time::Instant;

use crate::error::Result;
use crate::gpu::copies::{BufferRegion, ImageRegion};
use crate::gpu::device::Gpu;
use crate::gpu::memory::MemoryHome;
use crate::gpu::misuse::misuse;
use crate::gpu::record::{HostEvent, Submitted};
use crate::gpu::recorder::Recorder;
use crate::gpu::resources::{Buffer, BufferSpec, Image};
use crate::gpu::roles::{RoleKind, TimePoint};
use crate::gpu::timestamps::{SubmitTimes, Timestamps};

/// Two or three host-visible upload buffers, which take turns after each submit.
///
/// Stage any number of copies, each to a target named by its index, then [`Staging::flush`] with the
/// targets: no target is borrowed before that.
pub struct Staging {
    gpu: Arc<Gpu>,
    /// Three, two, or one.
    halves: Vec<Half>,
    current: usize,
    copy_ms: f64,
    /// Of copies that have ended, where somebody wants them.
    times: Option<Vec<SubmitTimes>>,
    /// The last wait for a half to be free.
    waited: Option<[Instant; 2]>,
    last: Option<TimePoint>,
    /// What the host did since the last flush.
    host: Vec<HostEvent>,
}

/// One upload buffer, and what is staged in it.
struct Half {
    buffer: Buffer,
    timestamps: Option<Timestamps>,
    unmeasured: bool,
    /// The copies that last read it.
    read_until: Option<TimePoint>,
    staged: Vec<Staged>,
    /// Of what is staged, each once.
    targets: Vec<Target>,
    /// First byte that nothing is staged in.
    free: u64,
}

struct Staged {
    place: Place,
    source_offset: u64,
    bytes: u64,
}

/// Where staged bytes go; targets are indices into the slices given to [`Staging::flush`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// A box of an image; the bytes are its texels, tightly packed.
    Image {
        /// Index of the image.
        image: usize,
        /// First texel of the box.
        start: [u32; 3],
        /// Texels along x, y, z.
        size: [u32; 3],
    },
    /// Bytes of a buffer.
    Buffer {
        /// Index of the buffer.
        buffer: usize,
        /// First byte.
        offset: u64,
    },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Target {
    Image(usize),
    Buffer(usize),
}

/// Targets of one flush: each is one copy step, for which there must be timestamps.
const STEPS_MAX: usize = 64;
/// Staged bytes begin at multiples of the largest texel.
const ALIGNMENT_BYTES: u64 = 16;

impl Staging {
    /// The buffers that staging of `half_bytes` each consists of: one for a single copy, else as many as the device
    /// was opened with, [`Gpu::staging_halves`].
    pub fn specs(gpu: &Gpu, half_bytes: u64, copies: u64) -> Vec<BufferSpec> {
        let halves = ["staging_half_0", "staging_half_1", "staging_half_2"].into_iter();
        let half = |name| BufferSpec { name, bytes: half_bytes, home: MemoryHome::Upload };
        halves.take(copies.clamp(1, gpu.staging_halves()) as usize).map(half).collect()
    }

    /// Makes both halves.
    ///
    /// # Errors
    /// Exit code 4 when memory is full.
    pub fn new(gpu: &Arc<Gpu>, half_bytes: u64) -> Result<Staging> {
        Staging::for_copies(gpu, half_bytes, u64::MAX)
    }

    /// As [`Staging::new`] for so many flushes; of more, each waits for the one before if there is one half.
    ///
    /// # Errors
    /// As [`Staging::new`].
    pub fn for_copies(gpu: &Arc<Gpu>, half_bytes: u64, copies: u64) -> Result<Staging> {
        let half = |spec: BufferSpec| {
            Ok(Half {
                buffer: Buffer::new(gpu, &spec)?,
                timestamps: Timestamps::new(gpu, RoleKind::Transfer, STEPS_MAX as u32)?,
                unmeasured: false,
                read_until: None,
                staged: Vec::new(),
                targets: Vec::new(),
                free: 0,
            })
        };
        Ok(Staging {
            gpu: gpu.clone(),
            halves: Staging::specs(gpu, half_bytes, copies)
                .into_iter()
                .map(half)
                .collect::<Result<_>>()?,
            current: 0,
            copy_ms: 0.0,
            times: None,
            waited: None,
            last: None,
            host: Vec::new(),
        })
    }

    /// Bytes of one half.
    pub fn half_bytes(&self) -> u64 {
        self.halves[0].buffer.bytes()
    }

    /// Copies tightly packed texels into a box of an image, on the transfer role. Returns at once;
    /// the image may be used after the time point.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost.
    pub fn copy_to_image(
        &mut self,
        label: &'static str,
        texels: &[u8],
        target: &Image,
        start: [u32; 3],
        size: [u32; 3],
    ) -> Result<TimePoint> {
        if !self.halves[self.current].staged.is_empty() {
            misuse("a single copy while others are staged");
        }
        if !self.stage_image(texels, 0, start, size)? {
            misuse("a copy larger than a staging half");
        }
        match self.flush(label, &[target], &[], &[])? {
            Some(submitted) => Ok(submitted.point),
            None => misuse("a copy of nothing"),
        }
    }

    /// Puts texels for a box of image number `image` into the half being filled; false when it has
    /// no room left: flush first. Waits only for the copies that last read that half.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost.
    pub fn stage_image(
        &mut self,
        texels: &[u8],
        image: usize,
        start: [u32; 3],
        size: [u32; 3],
    ) -> Result<bool> {
        let bytes = texels.len() as u64;
        let place = Place::Image { image, start, size };
        self.stage_with(place, bytes, |target| target.copy_from_slice(texels))
    }

    /// As [`Staging::stage_image`], for bytes from `offset` on of buffer number `buffer`.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost.
    pub fn stage_buffer(&mut self, data: &[u8], buffer: usize, offset: u64) -> Result<bool> {
        let place = Place::Buffer { buffer, offset };
        self.stage_with(place, data.len() as u64, |target| target.copy_from_slice(data))
    }

    /// Lets `fill` write what goes to `place` straight into mapped memory, `bytes` long, which it must
    /// write all of and not read. False when the half has no room left: flush first.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost.
    pub fn stage_with(
        &mut self,
        place: Place,
        bytes: u64,
        fill: impl FnOnce(&mut [u8]),
    ) -> Result<bool> {
        if bytes == 0 {
            misuse("nothing is staged");
        }
        let half = &mut self.halves[self.current];
        let end = half.free.checked_add(bytes).filter(|end| *end <= half.buffer.bytes());
        let new_target = !half.targets.contains(&place.target());
        let room = !new_target || half.targets.len() < STEPS_MAX;
        let Some(end) = end.filter(|_| room) else { return Ok(false) };
        if half.staged.is_empty()
            && let Some(point) = half.read_until
        {
            let begin = Instant::now();
            self.gpu.wait(point)?;
            self.copy_ms += half.measure(&mut self.times)?;
            self.waited = Some([begin, Instant::now()]);
            self.host.push(HostEvent::Waited(point));
        }
        half.buffer.write_with(half.free, bytes, fill)?;
        self.host.push(HostEvent::Wrote { buffer: half.buffer.name(), range: half.free..end });
        if new_target {
            half.targets.push(place.target());
        }
        half.staged.push(Staged { place, source_offset: half.free, bytes });
        half.free = end.next_multiple_of(ALIGNMENT_BYTES);
        Ok(true)
    }

    /// Submits all staged copies on the transfer role, which begins with them once `waits` are
    /// reached, and swaps halves; nothing when nothing was staged.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost.
    pub fn flush(
        &mut self,
        label: &'static str,
        images: &[&Image],
        buffers: &[&Buffer],
        waits: &[TimePoint],
    ) -> Result<Option<Submitted>> {
        let half = &mut self.halves[self.current];
        if half.staged.is_empty() {
            return Ok(None);
        }
        let staged = std::mem::take(&mut half.staged);
        half.free = 0;
        let mut recorder = Recorder::new(&self.gpu, RoleKind::Transfer, half.timestamps.as_ref());
        for target in std::mem::take(&mut half.targets) {
            let of_target = staged.iter().filter(|staged| staged.place.target() == target);
            match target {
                Target::Image(index) if index < images.len() => {
                    let regions: Vec<_> = of_target.map(|s| s.box_of(images[index])).collect();
                    let (source, target) = (&half.buffer, images[index]);
                    recorder.copy_regions_to_image(label, source, target, &regions);
                }
                Target::Buffer(index) if index < buffers.len() => {
                    let regions: Vec<_> = of_target.map(Staged::bytes).collect();
                    let (source, target) = (&half.buffer, buffers[index]);
                    recorder.copy_regions_to_buffer(label, source, target, &regions);
                }
                missing => misuse(format_args!("{missing:?} is staged, but not given to flush")),
            }
        }
        // What is read by the other role is its own from now on; it comes back to be written anew, without its bytes.
        for buffer in buffers.iter().filter(|buffer| buffer.is_handed_over()) {
            recorder.release(buffer, RoleKind::Render);
        }
        let mut submitted = recorder.submit(waits)?;
        submitted.record.host = std::mem::take(&mut self.host);
        half.unmeasured = true;
        half.read_until = Some(submitted.point);
        self.last = Some(submitted.point);
        self.current = (self.current + 1) % self.halves.len();
        Ok(Some(submitted))
    }

    /// Measures the copies that have ended. Best while the device has nothing else to do: lavapipe 22.3 keeps who asks
    /// for timestamps waiting until its queue is idle.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost.
    pub fn measure_ended(&mut self) -> Result<()> {
        for half in self.halves.iter_mut().filter(|half| half.unmeasured) {
            if half.read_until.is_some_and(|point| self.gpu.has_reached(point)) {
                self.copy_ms += half.measure(&mut self.times)?;
            }
        }
        Ok(())
    }

    /// Milliseconds of the copies measured so far.
    pub fn copy_ms(&self) -> f64 {
        self.copy_ms
    }

    /// From now on keeps when copies ran, one entry a flush, until they are taken.
    pub fn keep_times(&mut self) {
        self.times.get_or_insert_default();
    }

    /// When copies ran that were measured since the last call, in the order of their ends' becoming
    /// known: once their half is used again, and at [`Staging::finish`].
    pub fn take_times(&mut self) -> Vec<SubmitTimes> {
        self.times.as_mut().map(std::mem::take).unwrap_or_default()
    }

    /// From when to when the host last waited for a half that the device still read; once.
    pub fn take_wait(&mut self) -> Option<[Instant; 2]> {
        self.waited.take()
    }

    /// What the host did with the halves since the last flush, whose record holds what was before.
    pub fn take_host_events(&mut self) -> Vec<HostEvent> {
        std::mem::take(&mut self.host)
    }

    /// Waits for every copy and returns the milliseconds they took on the device, as far as its
    /// transfer queue has timestamps.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost.
    pub fn finish(&mut self) -> Result<f64> {
        if let Some(last) = self.last {
            self.gpu.wait(last)?;
            self.host.push(HostEvent::Waited(last));
        }
        for half in &mut self.halves {
            self.copy_ms += half.measure(&mut self.times)?;
        }
        Ok(self.copy_ms)
    }
}

impl Place {
    fn target(&self) -> Target {
        match *self {
            Place::Image { image, .. } => Target::Image(image),
            Place::Buffer { buffer, .. } => Target::Buffer(buffer),
        }
    }
}

impl Staged {
    fn box_of(&self, target: &Image) -> ImageRegion {
        let Place::Image { start, size, .. } = self.place else { misuse("a box of a buffer") };
        let region = ImageRegion { buffer_offset: self.source_offset, start, size };
        let wanted = region.texels() * target.spec().format.bytes();
        if wanted != self.bytes {
            let name = target.spec().name;
            misuse(format_args!("{} bytes staged for {wanted} of {name}", self.bytes));
        }
        region
    }

    fn bytes(&self) -> BufferRegion {
        let Place::Buffer { offset, .. } = self.place else { misuse("bytes of an image") };
        BufferRegion { source_offset: self.source_offset, target_offset: offset, bytes: self.bytes }
    }
}

impl Half {
    fn measure(&mut self, kept: &mut Option<Vec<SubmitTimes>>) -> Result<f64> {
        if std::mem::take(&mut self.unmeasured)
            && let Some(timestamps) = &self.timestamps
            && let Some(times) = timestamps.take()?
        {
            let ms = times.step_ms().map(|(_, ms)| ms).sum();
            kept.iter_mut().for_each(|kept| kept.push(times.clone()));
            return Ok(ms);
        }
        Ok(0.0)
    }
}
