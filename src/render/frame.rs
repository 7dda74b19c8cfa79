//! One tile of one view: the ray's journey from pixel to picture.

use crate::error::Result;
use crate::gpu::{Buffer, ComputePipeline, Recorder, RoleKind, Submitted};
use crate::passes::march_shape::SceneResources;
use crate::passes::{cast, march, rays, resolve};
use crate::render::renderer::{Renderer, Staged, Way};
use crate::render::submit_bound::Portion;
use crate::twins;

/// A rectangle of pixels of a view.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tile {
    pub view: u32,
    pub origin_pixel: [u32; 2],
    pub size_pixel: [u32; 2],
    /// Of its view.
    pub is_first: bool,
}

/// Draws a tile; `submitted` is told of every submit and returns once it has ended.
pub(super) fn draw(
    renderer: &Renderer,
    tile: Tile,
    mut submitted: impl FnMut(&Submitted) -> Result<()>,
) -> Result<()> {
    match &renderer.way {
        Way::Cast(pipeline) => {
            let mut recorder = renderer.recorder();
            cast_rays(renderer, pipeline, &mut recorder, tile);
            submitted(&recorder.submit(&renderer.uploaded)?)
        }
        // Rounds, not one way: see paging::draw.
        Way::Paged(_) => Ok(()),
        Way::Staged(staged) => {
            let plan = &renderer.plan;
            let all = plan.blocks_per_dispatch().saturating_mul(plan.march_dispatches());
            let mut marched = 0u32;
            while marched < all {
                let Portion { blocks, per_submit, .. } = renderer.submit_bound.portion(plan);
                let mut recorder = renderer.recorder();
                if marched == 0 {
                    set_up_rays(renderer, staged, &mut recorder, tile);
                }
                for _ in 0..per_submit.min((all - marched).div_ceil(blocks)) {
                    march_rays(renderer, staged, &mut recorder, tile, blocks);
                    marched = marched.saturating_add(blocks);
                }
                if marched >= all {
                    renderer.resolve_rays(
                        &mut recorder,
                        &staged.resolve,
                        &staged.ray_state,
                        None,
                        tile,
                    );
                }
                submitted(&recorder.submit(&renderer.uploaded)?)?;
            }
            Ok(())
        }
    }
}

fn cast_rays<'r>(
    renderer: &'r Renderer,
    pipeline: &'r ComputePipeline,
    recorder: &mut Recorder<'r>,
    tile: Tile,
) {
    let push = twins::cast::Push {
        rays: renderer.ray_push(tile),
        blocks_max: renderer.plan.blocks_per_dispatch(),
        early_stop: renderer.early_stop,
        background: renderer.background,
        unused_0: 0,
    };
    let resources = cast::Resources {
        views: &renderer.buffers.views,
        picture: &renderer.buffers.picture,
        counters: &renderer.buffers.counters,
        scene: renderer.scene_resources(),
    };
    cast::record(recorder, pipeline, &resources, &push);
}

fn set_up_rays<'r>(
    renderer: &'r Renderer,
    staged: &'r Staged,
    recorder: &mut Recorder<'r>,
    tile: Tile,
) {
    let resources = rays::Resources {
        views: &renderer.buffers.views,
        ray_geometry: &staged.ray_geometry,
        ray_state: &staged.ray_state,
    };
    rays::record(recorder, &staged.rays, &resources, &renderer.ray_push(tile));
}

fn march_rays<'r>(
    renderer: &'r Renderer,
    staged: &'r Staged,
    recorder: &mut Recorder<'r>,
    tile: Tile,
    blocks: u32,
) {
    let push = march::Push {
        tile_size_pixel: tile.size_pixel,
        blocks_max: blocks,
        early_stop: renderer.early_stop,
    };
    let resources = march::Resources {
        ray_geometry: &staged.ray_geometry,
        ray_state: &staged.ray_state,
        scene: renderer.scene_resources(),
    };
    march::record(recorder, &staged.march, &resources, &push);
}

impl Renderer {
    pub(super) fn recorder(&self) -> Recorder<'_> {
        Recorder::new(&self.gpu, RoleKind::Render, self.timestamps.as_ref())
    }

    /// Records what turns ray states into pixels; `states` where the picture shows what rays met.
    pub(super) fn resolve_rays<'r>(
        &'r self,
        recorder: &mut Recorder<'r>,
        pipeline: &'r ComputePipeline,
        ray_state: &'r Buffer,
        states: Option<(&'r Buffer, &'r Buffer)>,
        tile: Tile,
    ) {
        let push = resolve::Push {
            background: self.background,
            unused_0: 0,
            tile_size_pixel: tile.size_pixel,
        };
        let resources = resolve::Resources {
            ray_state,
            picture: &self.buffers.picture,
            counters: &self.buffers.counters,
            states,
        };
        resolve::record(recorder, pipeline, &resources, &push);
    }

    fn ray_push(&self, tile: Tile) -> twins::rays::Push {
        twins::rays::Push {
            tile_origin_pixel: tile.origin_pixel,
            tile_size_pixel: tile.size_pixel,
            volume_size: self.volume_size,
            view: tile.view,
            // One step that no volume outlasts: the medium is homogeneous.
            step_world: self.plan.step_world.unwrap_or(1e300),
        }
    }

    fn scene_resources(&self) -> SceneResources<'_> {
        SceneResources {
            transfer: &self.buffers.transfer,
            channels: &self.channels,
            macrocells: self.macrocells.as_ref(),
            sampler: self.sampler.as_ref(),
        }
    }
}
