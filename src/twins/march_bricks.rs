//! Moves every ray on through the bricks that are there; twin of `shaders/march_bricks.comp` in exact
//! refinement and one level.

use bytemuck::{Pod, Zeroable};

use crate::twins::brick_march::{Scene, Settings, march_bricks as march_ray, mark_place};
use crate::twins::cache::Cache;
use crate::twins::limits::{PLACE_ENDED, PLACE_RUNNING};
use crate::twins::ranks::rank_of_place;
use crate::twins::ray::{RayGeometry, RayState};
use crate::twins::ray_block::RayBlock;

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

/// Marches every ray; `last`: the cache's progress learns where they wait.
pub fn march_bricks(
    rays: &mut Rays,
    cache: &mut Cache,
    scene: &Scene,
    settings: &Settings,
    last: bool,
) {
    for ray in 0..rays.places.len() {
        let mut place = rays.places[ray];
        if place == PLACE_ENDED {
            continue;
        }
        let round = settings.round;
        if place == PLACE_RUNNING || !mark_place(cache, scene, round, place) {
            let geometry = &rays.geometry[ray];
            let (state, partial) = (&mut rays.states[ray], &mut rays.blocks[ray]);
            let missing = march_ray(geometry, state, partial, cache, scene, settings);
            place = match missing {
                _ if state.next_sample >= geometry.sample_count => PLACE_ENDED,
                None => PLACE_RUNNING,
                Some(place) => {
                    mark_place(cache, scene, round, place);
                    place
                }
            };
            rays.places[ray] = place;
            cache.progress.moved += 1;
        }
        if last && place != PLACE_ENDED {
            let waits = place != PLACE_RUNNING;
            let rank = if waits { rank_of_place(scene.levels, place) } else { 0 };
            let progress = &mut cache.progress;
            progress.front = progress.front.min(rank);
            progress.waiting += u32::from(waits);
            progress.running += u32::from(!waits);
        }
    }
}
