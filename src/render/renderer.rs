//! Builds what the plan lists and draws views with it.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::time::Instant;

use glam::DVec3;

use crate::error::Result;
use crate::gpu::{
    Buffer, ComputePipeline, Gpu, Image, Record, RoleKind, Sampler, SamplerFilter, Staging,
    TimePoint, Timestamps,
};
use crate::passes::march_shape::FilterShape;
use crate::render::frame::{self, Tile};
use crate::render::paging::{self, Paged, RoundPicture, Watch};
use crate::render::plan::{DISPATCHES_PER_SUBMIT, Plan};
use crate::render::plan_objects::copies_of;
use crate::render::scene_change::{NextScene, SceneChange};
use crate::render::scene_data::SceneData;
use crate::render::statistics::{Statistics, peak_rss_bytes};
use crate::render::submit_bound::SubmitBound;
use crate::render::tracing;
use crate::render::upload::{upload, upload_codes};
use crate::scene::{Part, RayFrame};
use crate::source::BrickSource;
use crate::trace::Trace;
use crate::twins::ray_setup::ViewRays;
use crate::volume::WorldFromVoxel;

/// A finished view: linear rgb over the background, and alpha; row 0 on top.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Row by row.
    pub pixels: Vec<[f32; 4]>,
}

/// Everything that drawing a scene on a device takes, made once.
pub struct Renderer {
    pub(super) gpu: Arc<Gpu>,
    pub(super) plan: Plan,
    pub(super) buffers: Buffers,
    pub(super) channels: Vec<Image>,
    pub(super) macrocells: Option<Image>,
    pub(super) sampler: Option<Sampler>,
    pub(super) way: Way,
    pub(super) timestamps: Option<Timestamps>,
    pub(super) submit_bound: SubmitBound,
    /// What the first submit waits for.
    pub(super) uploaded: Vec<TimePoint>,
    pub(super) volume_size: [u32; 3],
    /// Of the volume.
    source: Arc<dyn BrickSource>,
    pub(super) next_scene: NextScene,
    pub(super) background: [f32; 3],
    pub(super) early_stop: f32,
    upload_ms: f64,
    bytes_uploaded: u64,
    records: Vec<Record>,
    /// Counts changes of the source.
    pub(super) epoch: Arc<AtomicU64>,
    pub(super) trace: Option<Arc<Trace>>,
}

pub(super) struct Buffers {
    pub views: Buffer,
    pub transfer: Buffer,
    pub picture: Buffer,
    pub counters: Buffer,
}

/// How rays come to their pixels.
pub(super) enum Way {
    /// In one dispatch.
    Cast(Arc<ComputePipeline>),
    /// Set up, marched in several dispatches, resolved.
    Staged(Box<Staged>),
    /// Through the bricks of an atlas, round by round. Taken out while a view is drawn.
    Paged(Option<Box<Paged>>),
}

pub(super) struct Staged {
    pub rays: Arc<ComputePipeline>,
    pub march: Arc<ComputePipeline>,
    pub resolve: Arc<ComputePipeline>,
    pub ray_geometry: Buffer,
    pub ray_state: Buffer,
}

impl Renderer {
    /// Makes every object of the plan and copies the voxels to the device.
    ///
    /// # Errors
    /// Exit code 4 when the device runs out of memory or is lost.
    pub fn new(gpu: &Arc<Gpu>, plan: Plan, data: &SceneData) -> Result<Renderer> {
        Renderer::traced(gpu, plan, data, None)
    }

    /// As [`Renderer::new`]; what happens from now on is recorded in `trace`, uploads included.
    ///
    /// # Errors
    /// As [`Renderer::new`].
    pub fn traced(
        gpu: &Arc<Gpu>,
        plan: Plan,
        data: &SceneData,
        trace: Option<&Arc<Trace>>,
    ) -> Result<Renderer> {
        let scene = &data.scene;
        let make = |name: &str| Buffer::new(gpu, &plan.buffer(name).spec);
        let buffers = Buffers {
            views: make("views")?,
            transfer: make("transfer")?,
            picture: make("picture")?,
            counters: make("counters")?,
        };
        write_scene(&buffers, &plan, data)?;

        let pipeline = |index: usize| ComputePipeline::new(gpu, plan.passes[index].shader.clone());
        let way = match plan.passes[..] {
            _ if plan.paging.is_some() => Way::Paged(None),
            [_] => Way::Cast(pipeline(0)?),
            _ => Way::Staged(Box::new(Staged {
                rays: pipeline(0)?,
                march: pipeline(1)?,
                resolve: pipeline(2)?,
                ray_geometry: make("ray_geometry")?,
                ray_state: make("ray_state")?,
            })),
        };
        let atlases =
            plan.paging.as_ref().map_or(0, |paging| paging.residency.atlases.len() as u32);
        // March, rays and resolve; where bricks are paged, clearing, forgetting, publishing and managing too.
        let channels = plan.shape.channels.len() as u32;
        let of_pages = if atlases > 0 { 24 + 5 * atlases + channels } else { 0 };
        let steps = DISPATCHES_PER_SUBMIT + 2 + of_pages;
        let timestamps = Timestamps::new(gpu, RoleKind::Render, steps)?;

        let mut channels = Vec::new();
        let mut macrocells = None;
        let mut sampler = None;
        let mut uploaded = Vec::new();
        let mut upload_ms = 0.0;
        let mut bytes_uploaded = 0;
        if !plan.images.is_empty() {
            let filter = match plan.shape.filter {
                FilterShape::Sampler => SamplerFilter::Linear,
                FilterShape::Fetch | FilterShape::Quads => SamplerFilter::Nearest,
            };
            sampler = Some(Sampler::new(gpu, filter)?);
        }
        if !plan.images.is_empty() && plan.paging.is_none() {
            let (_, voxels) = data.volume()?;
            let half_bytes = plan.buffer("staging_half_0").spec.bytes;
            let copies = copies_of(&plan.images, half_bytes);
            let mut staging = Staging::for_copies(gpu, half_bytes, copies)?;
            let upload_span = tracing::begin_uploads(trace, &mut staging);
            for planned in &plan.images {
                let image = Image::new(gpu, &planned.spec)?;
                let Some(channel) = planned.channel else {
                    let codes = plan.macrocells.as_ref().map(|planned| &planned.codes);
                    if let Some(codes) = codes {
                        uploaded.extend(upload_codes(&mut staging, &image, codes)?);
                    }
                    macrocells = Some(image);
                    continue;
                };
                if let Some(layout) = &plan.texel_layouts[channel] {
                    let source = &voxels.channels[channel].voxels;
                    uploaded.extend(upload(&mut staging, &image, source, voxels.size, layout)?);
                    let texels: u64 = planned.size.iter().map(|edge| u64::from(*edge)).product();
                    bytes_uploaded += texels * layout.format.bytes();
                }
                channels.push(image);
            }
            upload_ms = staging.finish()?;
            tracing::end_uploads(trace, upload_span, &mut staging, bytes_uploaded);
        }
        let volume_size = data.volumes[0].source.description().size().to_array();
        let way = match plan.paging.clone() {
            Some(paging) => {
                let shaders: Vec<_> = plan.passes.iter().map(|pass| pass.shader.clone()).collect();
                Way::Paged(Some(Box::new(Paged::new(gpu, paging, &shaders, data, &plan, trace)?)))
            }
            None => way,
        };
        Ok(Renderer {
            gpu: gpu.clone(),
            buffers,
            channels,
            macrocells,
            sampler,
            way,
            timestamps,
            submit_bound: SubmitBound::new(plan.settings.submit_ms, gpu.facts().kind),
            uploaded,
            volume_size,
            source: data.volumes[0].source.clone(),
            next_scene: NextScene::default(),
            background: scene.picture.background,
            early_stop: scene.quality.ray_end() as f32,
            upload_ms,
            bytes_uploaded,
            records: Vec::new(),
            epoch: Arc::default(),
            trace: trace.cloned(),
            plan,
        })
    }

    /// What was built.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// What was recorded for the last view, submit by submit.
    pub fn records(&self) -> &[Record] {
        &self.records
    }

    /// Counts changes of the source: whoever changes it adds one, from any thread, also while a view is
    /// drawn, which then begins anew. No brick of before is shown after.
    pub fn epoch(&self) -> Arc<AtomicU64> {
        self.epoch.clone()
    }

    /// Where any thread may leave another scene for this renderer, also while it draws.
    pub fn next_scene(&self) -> NextScene {
        self.next_scene.clone()
    }

    /// Goes on with another scene of the same volume, as [`SceneChange::new`] planned it from this plan.
    /// Bricks of channels that both scenes show stay where they are.
    ///
    /// # Errors
    /// Exit code 4 when the device runs out of memory or is lost; 3 when the volume is another one, or the
    /// change was planned from another renderer's plan and this one cannot go on with it.
    pub fn change(&mut self, change: SceneChange) -> Result<()> {
        let SceneChange { plan, data, forget } = change;
        if !Arc::ptr_eq(&self.source, &data.volumes[0].source) {
            return Err(data.scene.volumes[0].place.error(
                "the volume is not the one that is drawn: make a new renderer for it".to_owned(),
            ));
        }
        self.plan.check_alike(&plan)?;
        let of_transfer = &plan.buffer("transfer").spec;
        if of_transfer.bytes > self.buffers.transfer.bytes() {
            self.buffers.transfer = Buffer::new(&self.gpu, of_transfer)?;
        }
        write_scene(&self.buffers, &plan, &data)?;
        if let (Way::Paged(Some(paged)), Some(next)) = (&mut self.way, plan.paging.clone()) {
            let shaders: Vec<_> = plan.passes.iter().map(|pass| pass.shader.clone()).collect();
            paged.change(&self.gpu, next, &shaders, &forget)?;
        }
        self.background = data.scene.picture.background;
        self.early_stop = data.scene.quality.ray_end() as f32;
        self.plan = plan;
        Ok(())
    }

    /// Draws one view; `progress` is told the finished part, 0 to 1.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost.
    pub fn draw(
        &mut self,
        view: usize,
        progress: &mut dyn FnMut(f64),
    ) -> Result<(Picture, Statistics)> {
        match self.draw_view(view, progress, None)? {
            Some(drawn) => Ok(drawn),
            None => unreachable!("nobody watches who could break off"),
        }
    }

    /// As [`Renderer::draw`]; `watch` is told the whole picture of every round, the last included, while
    /// it is refined by substitution, if one tile holds it, and may break off there: then there is nothing
    /// more. In lockstep nothing goes on meanwhile.
    ///
    /// # Errors
    /// As [`Renderer::draw`].
    pub fn draw_watched(
        &mut self,
        view: usize,
        watch: &mut dyn FnMut(RoundPicture) -> ControlFlow<()>,
    ) -> Result<Option<(Picture, Statistics)>> {
        self.draw_view(view, &mut |_| {}, Some(&mut Watch::new(watch)))
    }

    fn draw_view(
        &mut self,
        view: usize,
        progress: &mut dyn FnMut(f64),
        mut watch: Option<&mut Watch>,
    ) -> Result<Option<(Picture, Statistics)>> {
        let start = Instant::now();
        let _view = self.span("view");
        while let Way::Paged(paged) = &mut self.way {
            if let Some(change) = self.next_scene.take() {
                self.change(change)?;
                continue;
            }
            let Some(mut paged) = paged.take() else { unreachable!("only a drawing has it") };
            let drawn = self.draw_paged(&mut paged, view, progress, watch.as_deref_mut());
            self.way = Way::Paged(Some(paged));
            // Nothing: another scene has come meanwhile, or nobody wants more of this one.
            if let Some((picture, mut statistics)) = drawn? {
                statistics.wall_ms = start.elapsed().as_secs_f64() * 1e3;
                return Ok(Some((picture, statistics)));
            }
            if watch.as_ref().is_some_and(|watch| watch.broken_off) {
                return Ok(None);
            }
        }
        let mut statistics = Statistics {
            rounds: 1,
            converged: true,
            bytes_uploaded: self.bytes_uploaded,
            device: self.plan.device.clone(),
            driver: self.plan.driver.clone(),
            ..Statistics::default()
        };
        if self.bytes_uploaded > 0 && self.gpu.has_timestamps(RoleKind::Transfer) {
            statistics.add_step("upload", self.upload_ms);
        }
        let size = self.plan.pixels[view].size;
        let mut pixels = vec![[0.0; 4]; size[0] as usize * size[1] as usize];
        let mut records = Vec::new();
        let submits =
            self.plan.tiles * self.plan.march_dispatches().div_ceil(DISPATCHES_PER_SUBMIT);
        for tile in self.tiles(view as u32) {
            self.buffers.counters.write(0, &[0; 8])?;
            frame::draw(self, tile, |submitted| {
                let waiting = self.span("wait");
                self.gpu.wait(submitted.point)?;
                drop(waiting);
                self.add_times(&mut statistics);
                records.push(submitted.record.clone());
                progress(records.len() as f64 / f64::from(submits));
                Ok(())
            })?;
            statistics.samples += self.collect(tile, &mut pixels)?;
        }
        statistics.wall_ms = start.elapsed().as_secs_f64() * 1e3;
        statistics.device_bytes = self.gpu.ledger.bytes();
        statistics.peak_rss_bytes = peak_rss_bytes();
        statistics.validation_messages = self.gpu.messages().len() as u64;
        self.records = records;
        Ok(Some((Picture { size, pixels }, statistics)))
    }

    fn draw_paged(
        &mut self,
        paged: &mut Paged,
        view: usize,
        progress: &mut dyn FnMut(f64),
        mut watch: Option<&mut Watch>,
    ) -> Result<Option<(Picture, Statistics)>> {
        let mut statistics = Statistics {
            converged: true,
            device: self.plan.device.clone(),
            driver: self.plan.driver.clone(),
            ..Statistics::default()
        };
        let size = self.plan.pixels[view].size;
        let mut pixels = vec![[0.0; 4]; size[0] as usize * size[1] as usize];
        let mut records = Vec::new();
        let mut converged = true;
        paged.begin_view();
        let tiles = self.tiles(view as u32);
        let mut number = 0;
        while let Some(tile) = tiles.get(number) {
            let epoch = paged.epoch;
            self.buffers.counters.write(0, &[0; 8])?;
            let mut part = |of_tile: f64| progress((number as f64 + of_tile) / tiles.len() as f64);
            let watch = watch.as_deref_mut().filter(|_| tiles.len() == 1);
            let heard = (&mut part as &mut dyn FnMut(f64), watch);
            if !paging::draw(self, paged, *tile, &mut statistics, &mut records, heard)? {
                return Ok(None);
            }
            if number > 0 && paged.epoch != epoch {
                // Tiles of before show the source as it was.
                number = 0;
                converged = true;
                statistics.samples = 0;
                statistics.bricks_needed = 0;
                continue;
            }
            converged &= statistics.converged;
            statistics.samples += self.collect(*tile, &mut pixels)?;
            number += 1;
        }
        paged.script_picture(&pixels)?;
        paged.tell(&mut statistics)?;
        statistics.converged = converged;
        statistics.device_bytes = self.gpu.ledger.bytes();
        statistics.peak_rss_bytes = peak_rss_bytes();
        statistics.validation_messages = self.gpu.messages().len() as u64;
        self.records = records;
        Ok(Some((Picture { size, pixels }, statistics)))
    }

    fn tiles(&self, view: u32) -> Vec<Tile> {
        let Part { first, size: [width, height], .. } = self.plan.pixels[view as usize];
        let [across, down] = self.plan.tile;
        let mut tiles = Vec::new();
        for y in (0..height).step_by(down as usize) {
            for x in (0..width).step_by(across as usize) {
                let size_pixel = [across.min(width - x), down.min(height - y)];
                let origin_pixel = [first[0] + x, first[1] + y];
                let is_first = tiles.is_empty();
                tiles.push(Tile { view, origin_pixel, size_pixel, is_first });
            }
        }
        tiles
    }

    /// Copies a finished tile into the picture and returns the samples it took.
    pub(super) fn collect(&self, tile: Tile, pixels: &mut [[f32; 4]]) -> Result<u64> {
        let [tile_width, tile_height] = tile.size_pixel.map(|edge| edge as usize);
        let mut drawn = vec![[0.0f32; 4]; tile_width * tile_height];
        self.buffers.picture.read(0, bytemuck::cast_slice_mut(&mut drawn))?;
        let Part { first, size, .. } = self.plan.pixels[tile.view as usize];
        let [left, top] = [0, 1].map(|axis| (tile.origin_pixel[axis] - first[axis]) as usize);
        for (row, line) in drawn.chunks_exact(tile_width).enumerate() {
            let start = (top + row) * size[0] as usize + left;
            pixels[start..start + tile_width].copy_from_slice(line);
        }
        let mut counters = [0u32; 2];
        self.buffers.counters.read(0, bytemuck::cast_slice_mut(&mut counters))?;
        Ok(u64::from(counters[1]) << 32 | u64::from(counters[0]))
    }
}

/// Writes what passes read of the scene alone.
fn write_scene(buffers: &Buffers, plan: &Plan, data: &SceneData) -> Result<()> {
    let (scene, world_from_voxel) = (&data.scene, data.world_from_voxel(0));
    let frames = scene.views.iter().map(|view| view.ray_frame_world(scene.picture.size));
    let views: Vec<_> = frames.map(|frame| view_rays(&frame, &world_from_voxel)).collect();
    buffers.views.write(0, bytemuck::cast_slice(&views))?;
    buffers.transfer.write(0, bytemuck::cast_slice(&plan.segments))
}

/// A view's rays in voxels and in the world, as the shader takes them.
fn view_rays(world: &RayFrame, world_from_voxel: &WorldFromVoxel) -> ViewRays {
    let voxel = world.in_voxels(world_from_voxel);
    let wide = |v: DVec3| [v.x, v.y, v.z, 0.0];
    ViewRays {
        origin_voxel: wide(voxel.origin),
        origin_column_voxel: wide(voxel.origin_column),
        origin_row_voxel: wide(voxel.origin_row),
        direction_voxel: wide(voxel.direction),
        direction_column_voxel: wide(voxel.direction_column),
        direction_row_voxel: wide(voxel.direction_row),
        direction_world: wide(world.direction),
        direction_column_world: wide(world.direction_column),
        direction_row_world: wide(world.direction_row),
    }
}
