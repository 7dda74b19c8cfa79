//! Two staging halves: the host fills one while the transfer role copies from the other.

use std::sync::Arc;

use crate::error::Result;
use crate::gpu::device::Gpu;
use crate::gpu::memory::MemoryHome;
use crate::gpu::misuse::misuse;
use crate::gpu::recorder::Recorder;
use crate::gpu::resources::{Buffer, BufferSpec, Image};
use crate::gpu::roles::{RoleKind, TimePoint};
use crate::gpu::timestamps::Timestamps;

/// Two host-visible upload buffers, swapped after each submit.
pub struct Staging {
    gpu: Arc<Gpu>,
    halves: [Buffer; 2],
    current: usize,
    timestamps: [Option<Timestamps>; 2],
    copy_ms: f64,
    unmeasured: [bool; 2],
    last: Option<TimePoint>,
}

impl Staging {
    /// The two buffers that staging of `half_bytes` each consists of.
    pub fn specs(half_bytes: u64) -> [BufferSpec; 2] {
        let half = |name| BufferSpec { name, bytes: half_bytes, home: MemoryHome::Upload };
        [half("staging_half_0"), half("staging_half_1")]
    }

    /// Makes both halves.
    ///
    /// # Errors
    /// Exit code 4 when memory is full.
    pub fn new(gpu: &Arc<Gpu>, half_bytes: u64) -> Result<Staging> {
        let [first, second] = Staging::specs(half_bytes);
        Ok(Staging {
            gpu: gpu.clone(),
            halves: [Buffer::new(gpu, &first)?, Buffer::new(gpu, &second)?],
            current: 0,
            timestamps: [
                Timestamps::new(gpu, RoleKind::Transfer, 1)?,
                Timestamps::new(gpu, RoleKind::Transfer, 1)?,
            ],
            copy_ms: 0.0,
            unmeasured: [false; 2],
            last: None,
        })
    }

    /// Bytes of one half.
    pub fn half_bytes(&self) -> u64 {
        self.halves[0].bytes()
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
        if texels.len() as u64 > self.half_bytes() {
            misuse("a copy larger than a staging half");
        }
        let current = self.current;
        self.measure(current)?;
        let half = &self.halves[current];
        // Waits for the copy that read this half two submits ago.
        half.write(0, texels)?;
        let timestamps = self.timestamps[current].as_ref();
        let mut recorder = Recorder::new(&self.gpu, RoleKind::Transfer, timestamps);
        recorder.copy_to_image(label, half, 0, target, start, size);
        let submitted = recorder.submit(&[])?;
        self.unmeasured[current] = true;
        self.last = Some(submitted.point);
        self.current = 1 - current;
        Ok(submitted.point)
    }

    /// Waits for every copy and returns the milliseconds they took on the device, as far as its
    /// transfer queue has timestamps.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost.
    pub fn finish(&mut self) -> Result<f64> {
        if let Some(last) = self.last {
            self.gpu.wait(last)?;
        }
        self.measure(0)?;
        self.measure(1)?;
        Ok(self.copy_ms)
    }

    fn measure(&mut self, half: usize) -> Result<()> {
        if std::mem::take(&mut self.unmeasured[half])
            && let Some(timestamps) = &self.timestamps[half]
        {
            self.copy_ms += timestamps.step_ms()?.iter().map(|(_, ms)| ms).sum::<f64>();
        }
        Ok(())
    }
}
