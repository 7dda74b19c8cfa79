//! One tile of one view: the ray's journey from pixel to picture.

use crate::error::Result;
use crate::gpu::{Recorder, RoleKind, Submitted};
use crate::passes::{march, rays, resolve};
use crate::render::plan::DISPATCHES_PER_SUBMIT;
use crate::render::renderer::Renderer;
use crate::twins;

/// A rectangle of pixels of a view.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tile {
    pub view: u32,
    pub origin_pixel: [u32; 2],
    pub size_pixel: [u32; 2],
}

/// Sets the rays up, marches them in bounded submits until even the longest has ended, and resolves
/// them. `submitted` is told of every submit and returns once it has ended.
pub(super) fn draw(
    renderer: &Renderer,
    tile: Tile,
    mut submitted: impl FnMut(&Submitted) -> Result<()>,
) -> Result<()> {
    let buffers = &renderer.buffers;
    let dispatches = renderer.plan.passes[1].dispatches_per_tile;
    for first in (0..dispatches).step_by(DISPATCHES_PER_SUBMIT as usize) {
        let mut recorder = renderer.recorder();
        if first == 0 {
            set_up_rays(renderer, &mut recorder, tile);
        }
        let last = dispatches.min(first + DISPATCHES_PER_SUBMIT);
        for _ in first..last {
            march_rays(renderer, &mut recorder, tile);
        }
        if last == dispatches {
            let push = resolve::Push {
                background: renderer.background,
                unused_0: 0,
                tile_size_pixel: tile.size_pixel,
            };
            let resources = resolve::Resources {
                ray_state: &buffers.ray_state,
                picture: &buffers.picture,
                counters: &buffers.counters,
            };
            resolve::record(&mut recorder, &renderer.pipelines.resolve, &resources, &push);
        }
        submitted(&recorder.submit(&renderer.uploaded)?)?;
    }
    Ok(())
}

fn set_up_rays<'r>(renderer: &'r Renderer, recorder: &mut Recorder<'r>, tile: Tile) {
    let push = twins::rays::Push {
        tile_origin_pixel: tile.origin_pixel,
        tile_size_pixel: tile.size_pixel,
        volume_size: renderer.volume_size,
        view: tile.view,
        // One step that no volume outlasts: the medium is homogeneous.
        step_world: renderer.plan.step_world.unwrap_or(1e300),
    };
    let resources = rays::Resources {
        views: &renderer.buffers.views,
        ray_geometry: &renderer.buffers.ray_geometry,
        ray_state: &renderer.buffers.ray_state,
    };
    rays::record(recorder, &renderer.pipelines.rays, &resources, &push);
}

fn march_rays<'r>(renderer: &'r Renderer, recorder: &mut Recorder<'r>, tile: Tile) {
    let push = march::Push {
        tile_size_pixel: tile.size_pixel,
        blocks_max: renderer.plan.blocks_per_dispatch(),
        early_stop: renderer.early_stop,
    };
    let resources = march::Resources {
        ray_geometry: &renderer.buffers.ray_geometry,
        transfer: &renderer.buffers.transfer,
        ray_state: &renderer.buffers.ray_state,
        channels: &renderer.channels,
        sampler: renderer.sampler.as_ref(),
    };
    march::record(recorder, &renderer.pipelines.march, &resources, &push);
}

impl Renderer {
    fn recorder(&self) -> Recorder<'_> {
        Recorder::new(&self.gpu, RoleKind::Render, self.timestamps.as_ref())
    }
}
