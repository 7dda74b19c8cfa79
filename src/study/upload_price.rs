//! What bringing bricks to the device costs, beside copying as many bytes in memory: the host's part
//! (voxels to texels, in the staging half), the way from there into slots (copied, or copied and placed
//! by a compute pass), both in flight together; and one copy of a whole image.

use std::sync::Arc;

use serde::Serialize;

use crate::error::{Error, Result};
use crate::gpu::{
    Buffer, BufferSpec, ComputePipeline, Gpu, Image, ImageSpec, MemoryHome, Place, Recorder,
    RoleKind, ShaderCompiler, Staging, TimePoint,
};
use crate::passes::place;
use crate::render::paging::{CopyPath, Placing, StagedBrick, write_texels};
use crate::render::{Layout, TexelLayout};
use crate::residency::AtlasLayout;
use crate::study::repeated::{Spread, Timer, Took};
use crate::study::sampler_precision::noise;
use crate::twins::place::Placement;
use crate::volume::{BRICK_APRON, BrickId, Size3, ValueRange, VoxelFormat};

/// How much is measured.
#[derive(Clone, Debug)]
pub struct Effort {
    /// Payloads of bricks, voxels along each axis.
    pub payloads: Vec<u32>,
    /// Texels moved in one turn, MiB.
    pub mib: u32,
    /// Both staging halves together, MiB.
    pub staging_mib: u32,
    /// Turns that count; one more comes before them.
    pub repeats: u32,
}

/// How fast texels move.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Rate {
    /// 10^9 bytes of texels a second, by the table's clock.
    pub gb_per_second: Spread,
    /// Over memcpy's of the same turn, by the table's clock.
    pub over_memcpy: Spread,
    /// Over memcpy's of the same turn, on the wall: here host and device may work side by side.
    pub wall_over_memcpy: Spread,
}

/// Bricks of one size and format on one path.
#[derive(Clone, Debug, Serialize)]
pub struct UploadRow {
    /// "straight" or "placed".
    pub path: &'static str,
    /// Voxels along each axis, without apron.
    pub payload: u32,
    /// Of voxels.
    pub voxels: &'static str,
    /// "plain" or "quads".
    pub layout: &'static str,
    /// Of texels.
    pub texels: &'static str,
    /// Bytes of a brick's texels, apron included.
    pub brick_bytes: u64,
    /// Bricks moved in one turn.
    pub bricks: u32,
    /// Bricks of one batch, at most.
    pub bricks_in_batch: u32,
    /// Of memory, as many bytes.
    pub memcpy: Rate,
    /// Voxels to texels, into mapped staging memory.
    pub host: Rate,
    /// From the staging half into slots, by way of the upload buffer where they are placed; batch by
    /// batch, waited for.
    pub copy: Rate,
    /// Both, one half filled while the other is copied.
    pub together: Rate,
    /// As many bytes as one region of an image.
    pub one_region: Rate,
}

/// What was not measured, and why.
#[derive(Clone, Debug, Serialize)]
pub struct LeftOut {
    /// The path.
    pub path: &'static str,
    /// For these texels.
    pub texels: &'static str,
    /// Why.
    pub why: String,
}

/// All rows, and what they were measured with.
#[derive(Clone, Debug, Serialize)]
pub struct UploadTable {
    /// The device's name.
    pub device: String,
    /// Driver name and version.
    pub driver: String,
    /// "processor" or "wall": whose time rates and ratios count, where nothing else is said.
    pub clock: &'static str,
    /// Turns that count.
    pub repeats: u32,
    /// By payload and format.
    pub rows: Vec<UploadRow>,
    /// Paths that this device lacks.
    pub left_out: Vec<LeftOut>,
}

const FORMATS: [(VoxelFormat, Layout); 4] = [
    (VoxelFormat::U8, Layout::Plain),
    (VoxelFormat::U8, Layout::Quads),
    (VoxelFormat::U16, Layout::Plain),
    (VoxelFormat::F32, Layout::Plain),
];

/// Measures every path, payload and format; `progress` is told the finished part.
///
/// # Errors
/// Exit code 4 when the device runs out of memory or is lost.
pub fn measure(
    gpu: &Arc<Gpu>,
    compiler: &ShaderCompiler,
    effort: &Effort,
    progress: &mut dyn FnMut(f64),
) -> Result<UploadTable> {
    let timer = Timer::of(gpu);
    let meter = Meter { gpu, compiler, timer, repeats: effort.repeats };
    let (mut rows, mut left_out) = (Vec::new(), Vec::new());
    let cases = effort.payloads.len() * FORMATS.len();
    for (index, payload) in effort.payloads.iter().enumerate() {
        for (number, (format, layout)) in FORMATS.into_iter().enumerate() {
            let range = ValueRange { least: 0.0, greatest: 1.0 };
            let layout = TexelLayout::of(format, range, layout);
            let bricks = Bricks::new(gpu, effort, *payload, format, layout)?;
            for path in [CopyPath::Straight, CopyPath::Placed] {
                match unmeasured(gpu, path, &layout) {
                    None => rows.push(bricks.row(&meter, path)?),
                    Some(why) if index == 0 => left_out.push(why),
                    Some(_) => {}
                }
            }
            progress((index * FORMATS.len() + number + 1) as f64 / cases as f64);
        }
    }
    Ok(UploadTable {
        device: gpu.facts().name.clone(),
        driver: gpu.facts().driver.clone(),
        clock: timer.name("wall"),
        repeats: effort.repeats,
        rows,
        left_out,
    })
}

/// Why a path is not measured, where it is not.
fn unmeasured(gpu: &Gpu, path: CopyPath, layout: &TexelLayout) -> Option<LeftOut> {
    let lacking = path == CopyPath::Placed && !gpu.stores(layout.format);
    lacking.then(|| LeftOut {
        path: path.name(),
        texels: layout.format.name(),
        why: "this device's shaders cannot store such texels".to_owned(),
    })
}

/// What measures.
struct Meter<'m> {
    gpu: &'m Arc<Gpu>,
    compiler: &'m ShaderCompiler,
    timer: Timer,
    repeats: u32,
}

/// As many bricks as a turn moves, and where they go.
struct Bricks {
    payload: u32,
    format: VoxelFormat,
    layout: TexelLayout,
    slot: Size3,
    brick_bytes: u64,
    /// Voxels of all bricks, one after another.
    voxels: Vec<u8>,
    atlas: AtlasLayout,
    half_bytes: u64,
}

/// Of one turn.
#[derive(Clone, Copy, Default)]
struct Turn {
    memcpy: Took,
    host: Took,
    copy: Took,
    together: Took,
    one_region: Took,
}

impl Bricks {
    fn new(
        gpu: &Gpu,
        effort: &Effort,
        payload: u32,
        format: VoxelFormat,
        layout: TexelLayout,
    ) -> Result<Bricks> {
        let slot = Size3::cube(payload + 2 * BRICK_APRON);
        let texels = slot.len().unwrap_or(0) as u64;
        let brick_bytes = texels * layout.format.bytes();
        let wanted = ((u64::from(effort.mib) << 20) / brick_bytes).max(1) as u32;
        let slots = slot.to_array();
        let fit = AtlasLayout::fit(gpu, "atlas", layout.format, false, slots, wanted, u64::MAX / 2);
        let Some(atlas) = fit else {
            return Err(Error::machine("this device holds no image of one brick: lower --payload"));
        };
        let one = noise(format, slot.x);
        let count = atlas.slot_count() as usize;
        Ok(Bricks {
            payload,
            format,
            layout,
            slot,
            brick_bytes,
            voxels: one.bytes().repeat(count),
            atlas,
            half_bytes: ((u64::from(effort.staging_mib) << 20) / 2)
                .max(brick_bytes.next_multiple_of(16)),
        })
    }

    fn row(&self, meter: &Meter, path: CopyPath) -> Result<UploadRow> {
        let Meter { gpu, timer, repeats, .. } = *meter;
        let total = self.brick_bytes * u64::from(self.atlas.slot_count());
        let mut way = Way::new(meter, self, path)?;
        let spec = BufferSpec { name: "whole", bytes: total, home: MemoryHome::Upload };
        let whole = Buffer::new(gpu, &spec)?;
        let source = vec![1u8; total as usize];
        let mut target = vec![0u8; total as usize];
        whole.write(0, &source)?;
        let mut turns = Vec::new();
        for turn in 0..=repeats {
            let (_, memcpy) = timer.time(|| {
                target.copy_from_slice(&source);
                std::hint::black_box(&mut target);
                Ok(())
            })?;
            let (host, copy) = self.apart(timer, &mut way)?;
            let (_, together) = timer.time(|| self.together(&mut way))?;
            let (_, one_region) = timer.time(|| {
                let mut recorder = Recorder::new(gpu, RoleKind::Transfer, None);
                recorder.copy_to_image(
                    "whole",
                    &whole,
                    0,
                    way.atlas(),
                    [0; 3],
                    self.atlas.spec.size,
                );
                gpu.wait(recorder.submit(&[])?.point)
            })?;
            if turn > 0 {
                turns.push(Turn { memcpy, host, copy, together, one_region });
            }
        }
        let rate = |part: fn(&Turn) -> Took| rate(&turns, total, part);
        Ok(UploadRow {
            path: path.name(),
            payload: self.payload,
            voxels: self.format.name(),
            layout: self.layout.layout.name(),
            texels: self.layout.format.name(),
            brick_bytes: self.brick_bytes,
            bricks: self.atlas.slot_count(),
            bricks_in_batch: self.bricks_in_batch() as u32,
            memcpy: rate(|turn| turn.memcpy),
            host: rate(|turn| turn.host),
            copy: rate(|turn| turn.copy),
            together: rate(|turn| turn.together),
            one_region: rate(|turn| turn.one_region),
        })
    }

    fn bricks_in_batch(&self) -> usize {
        (self.half_bytes / self.brick_bytes.next_multiple_of(16)).max(1) as usize
    }

    fn batches(&self) -> impl Iterator<Item = std::ops::Range<u32>> {
        let (count, batch) = (self.atlas.slot_count(), self.bricks_in_batch());
        (0..count).step_by(batch).map(move |first| first..count.min(first + batch as u32))
    }

    fn stage(&self, way: &mut Way, slots: std::ops::Range<u32>) -> Result<()> {
        let brick_voxels = self.voxels.len() / self.atlas.slot_count() as usize;
        for slot in slots {
            let voxels = &self.voxels[slot as usize * brick_voxels..][..brick_voxels];
            let (start, size) = (self.atlas.slot_origin(slot), self.atlas.slot);
            let place = way.takes(slot, self.brick_bytes, start, size);
            way.staging.stage_with(place, self.brick_bytes, |texels| {
                write_texels(voxels, self.format, self.slot, &self.layout, texels);
            })?;
        }
        Ok(())
    }

    /// Batch by batch, each waited for: what the host took, and what the way into slots did.
    fn apart(&self, timer: Timer, way: &mut Way) -> Result<(Took, Took)> {
        let (mut host, mut copy) = (Took::default(), Took::default());
        for slots in self.batches() {
            host += timer.time(|| self.stage(way, slots))?.1;
            copy += timer.time(|| way.send().and_then(|last| way.wait(last)))?.1;
        }
        Ok((host, copy))
    }

    /// One half is filled while the other is on its way.
    fn together(&self, way: &mut Way) -> Result<()> {
        let mut last = None;
        for slots in self.batches() {
            self.stage(way, slots)?;
            last = way.send()?;
        }
        way.wait(last)
    }
}

/// From the staging half into slots, as the paging loop goes it.
struct Way {
    gpu: Arc<Gpu>,
    staging: Staging,
    /// One atlas.
    atlases: [Image; 1],
    placing: Option<Placing>,
    /// In the half being filled.
    staged: Vec<StagedBrick>,
}

impl Way {
    fn new(meter: &Meter, bricks: &Bricks, path: CopyPath) -> Result<Way> {
        let gpu = meter.gpu;
        let placing = match path {
            CopyPath::Straight => None,
            CopyPath::Placed => {
                let shader = meter.compiler.compile(&place::variant(bricks.layout.format))?;
                let upload = BufferSpec {
                    name: "upload",
                    bytes: bricks.half_bytes,
                    home: MemoryHome::Device,
                };
                let placements = Placing::placements_spec(bricks.atlas.slot_count() as usize);
                let pipelines = vec![ComputePipeline::new(gpu, shader)?];
                Some(Placing::new(gpu, &upload, &placements, pipelines, false)?)
            }
        };
        let spec = ImageSpec { stored: placing.is_some(), ..bricks.atlas.spec };
        Ok(Way {
            gpu: gpu.clone(),
            staging: Staging::new(gpu, bricks.half_bytes)?,
            atlases: [Image::new(gpu, &spec)?],
            placing,
            staged: Vec::new(),
        })
    }

    fn atlas(&self) -> &Image {
        &self.atlases[0]
    }

    /// Where the texels of a brick that is staged next go.
    fn takes(&mut self, slot: u32, bytes: u64, start: [u32; 3], size: [u32; 3]) -> Place {
        let Some(placing) = &mut self.placing else {
            return Place::Image { image: 0, start, size };
        };
        let offset = placing.free;
        placing.free = (offset + bytes).next_multiple_of(16);
        let first_word = (offset / 4) as u32;
        let placement = Placement { start, first_word, size, unused_0: 0 };
        let id = BrickId { volume: 0, channel: 0, level: 0, x: slot, y: 0, z: 0 };
        self.staged.push(StagedBrick { id, slot, bytes, atlas: 0, placement });
        Place::Buffer { buffer: 0, offset }
    }

    /// Submits what is staged; returns when it will be in its slots.
    fn send(&mut self) -> Result<Option<TimePoint>> {
        let waits: Vec<_> = self.placing.iter().filter_map(|placing| placing.placed_at).collect();
        let upload: Vec<_> = self.placing.iter().map(|placing| &placing.upload).collect();
        let flushed = self.staging.flush("copy", &[&self.atlases[0]], &upload, &waits)?;
        let Some(copied) = flushed else { return Ok(None) };
        let staged = std::mem::take(&mut self.staged);
        match &mut self.placing {
            None => Ok(Some(copied.point)),
            Some(placing) => {
                let placed = placing.place(&self.gpu, &self.atlases, &staged, copied.point)?;
                Ok(Some(placed.point))
            }
        }
    }

    fn wait(&self, last: Option<TimePoint>) -> Result<()> {
        last.map_or(Ok(()), |last| self.gpu.wait(last))
    }
}

fn rate(turns: &[Turn], bytes: u64, part: fn(&Turn) -> Took) -> Rate {
    let of = |value: fn(&Took) -> f64, part: fn(&Turn) -> Took| -> Vec<f64> {
        turns.iter().map(|turn| value(&part(turn))).collect()
    };
    let memcpy: fn(&Turn) -> Took = |turn| turn.memcpy;
    let ms = of(|took| took.ms, part);
    let gb: Vec<f64> = ms.iter().map(|ms| bytes as f64 / ms * 1e-6).collect();
    Rate {
        gb_per_second: Spread::of(&gb),
        over_memcpy: Spread::of_ratios(&of(|took| took.ms, memcpy), &ms),
        wall_over_memcpy: Spread::of_ratios(
            &of(|took| took.wall_ms, memcpy),
            &of(|took| took.wall_ms, part),
        ),
    }
}
