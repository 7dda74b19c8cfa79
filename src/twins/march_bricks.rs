//! Moves every ray on through the bricks that are there; twin of `shaders/march_bricks.comp`, but for the
//! papers' order.

use bytemuck::{Pod, Zeroable};

use crate::twins::brick_look_up::{Scene, mark_place};
use crate::twins::brick_march::{Settings, march_bricks as march_ray};
use crate::twins::cache::{Cache, Progress};
use crate::twins::limits::{PLACE_ENDED, PLACE_RUNNING};
use crate::twins::ranks::rank_of_place;
use crate::twins::ray::{RayGeometry, RayState};
use crate::twins::ray_block::{MET_PENDING, RayBlock};
use crate::twins::ray_setup::{ViewRays, set_up_ray_within};

/// The shader's push constants.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Push {
    /// First pixel of the tile: column, row.
    pub tile_origin_pixel: [u32; 2],
    /// Pixels of the tile across and down.
    pub tile_size_pixel: [u32; 2],
    /// Voxels of level 0 along each axis.
    pub volume_size: [u32; 3],
    /// Index of the view.
    pub view: u32,
    /// Blocks of samples in this dispatch.
    pub blocks_max: u32,
    /// A ray ends when less than this is transmitted.
    pub early_stop: f32,
    /// Counts from 1.
    pub round: u32,
    /// 1: the round's last dispatch, which says where rays wait.
    pub last: u32,
}

/// Everything that is kept of the rays of a tile.
#[derive(Clone, Debug, PartialEq)]
pub struct Rays {
    /// `[ray]`
    pub geometry: Vec<RayGeometry>,
    /// `[ray]`
    pub states: Vec<RayState>,
    /// `[ray]`
    pub blocks: Vec<RayBlock>,
    /// `[ray]`
    pub places: Vec<u32>,
}

/// Marches every ray; in the round's last dispatch the cache's progress learns where they wait. `views`
/// are used where settings say that there are several levels.
pub fn march_bricks(
    rays: &mut Rays,
    cache: &mut Cache,
    scene: &Scene,
    settings: &Settings,
    views: &[ViewRays],
    push: &Push,
) {
    let levels = scene.levels.len() as u32;
    for ray in 0..rays.places.len() {
        let mut place = rays.places[ray];
        let round = push.round;
        let goes_on = place != PLACE_ENDED;
        if goes_on
            && (place == PLACE_RUNNING
                || !mark_place(cache, scene, round, place, rays.blocks[ray].met))
        {
            let (state, partial) = (&mut rays.states[ray], &mut rays.blocks[ray]);
            let mut blocks_left = push.blocks_max;
            place = loop {
                let geometry = &rays.geometry[ray];
                let push_and_left = (push, &mut blocks_left);
                let missing =
                    march_ray(geometry, state, partial, cache, scene, settings, push_and_left);
                if state.next_sample < geometry.sample_count {
                    break missing.unwrap_or(PLACE_RUNNING);
                }
                if !settings.several_levels || partial.level + 1 >= levels {
                    break PLACE_ENDED;
                }
                partial.level += 1;
                let level = &scene.levels[partial.level as usize];
                let [x, y, z, step_world] = level.per_scale_step;
                let [width, _] = push.tile_size_pixel;
                let in_tile = [ray as u32 % width, ray as u32 / width];
                rays.geometry[ray] = set_up_ray_within(
                    &views[push.view as usize],
                    std::array::from_fn(|a| push.tile_origin_pixel[a] + in_tile[a]),
                    push.volume_size,
                    step_world,
                    level.depth,
                    [x, y, z],
                );
                state.next_sample = 0;
            };
            if place < PLACE_RUNNING {
                mark_place(cache, scene, round, place, rays.blocks[ray].met);
            }
            rays.places[ray] = place;
            cache.progress.moved += 1;
        }
        if push.last != 0 {
            tell_progress(&mut cache.progress, place, rays.blocks[ray].met, scene, settings);
        }
    }
}

/// Where a ray stands after a round.
fn tell_progress(
    progress: &mut Progress,
    place: u32,
    met: u32,
    scene: &Scene,
    settings: &Settings,
) {
    let ended = place == PLACE_ENDED;
    let waits = match settings.substitute {
        true => ended && met & MET_PENDING != 0,
        false => place < PLACE_RUNNING,
    };
    if !settings.substitute && !ended {
        let rank = if waits { rank_of_place(scene.levels, place) } else { 0 };
        progress.front = progress.front.min(rank);
    }
    progress.waiting += u32::from(waits);
    progress.running += u32::from(!waits && !ended);
}
