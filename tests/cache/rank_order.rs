//! What is claimed of ranks: along every ray they grow from brick to brick, levels by depth included.

use ashfall::twins::ranks::{brick_of_place, level_of_place, place_of_brick, rank_of_place};
use ashfall::volume::{Levels, Size3};

use crate::random::Random;
use crate::view_levels::{crossing, depths_between, inner_view, level_views, ray_of_pixel};
use crate::views::placed;
use crate::world::{below, pick};

const PICTURE: [u32; 2] = [12, 12];
/// Places along the ray, across the volume.
const STEPS: u32 = 1500;

#[test]
fn ranks_grow_from_brick_to_brick_along_every_ray() {
    let mut random = Random(700);
    let (mut borders, mut inside, mut parallel, mut changes) = (0, 0, 0, 0);
    for case in 0..300 {
        let size = [0; 3].map(|_| pick(&mut random, &[1, 7, 40, 65, 130]));
        let payload = pick(&mut random, &[[8; 3], [4, 5, 3], [16; 3]]);
        let volume = placed(&mut random, size, case % 3 != 0);
        let spacing = volume.world_from_voxel.spacing().to_array();
        let levels = Levels::of(Size3::from_array(size), spacing, Size3::from_array(payload));
        let view = match case % 5 {
            0 => volume.view_along_axis(&mut random),
            1 | 2 => inner_view(&volume, &mut random),
            _ => volume.view(&mut random),
        };
        let rays = volume.rays(&view, PICTURE);
        let (near, far) =
            crossing(ray_of_pixel(&rays, PICTURE.map(|edge| f64::from(edge) / 2.0)), size);
        if far <= near {
            continue;
        }
        let finest = below(&mut random, levels.count() as u32) as usize;
        let used = 1 + below(&mut random, (levels.count() - finest) as u32);
        let depths = depths_between(&mut random, [near, far], used);
        let (views, ranks) = level_views(&levels, payload, &rays, finest, &depths, 1.0);
        for view in &views {
            for brick in [[0; 3], view.bricks.map(|edge| edge as i32 - 1), view.eye_brick] {
                let place = place_of_brick(view, brick);
                let level = level_of_place(&views, place);
                assert_eq!((views[level], brick_of_place(view, place)), (*view, brick));
            }
        }
        for pixel in 0..PICTURE[0] * PICTURE[1] {
            let at = [pixel % PICTURE[0], pixel / PICTURE[0]].map(|p| f64::from(p) + 0.5);
            let (origin, direction) = ray_of_pixel(&rays, at);
            let (enter, leave) = crossing((origin, direction), size);
            let mut last: Option<(u32, u32, usize)> = None;
            for step in 0..STEPS {
                let t = enter + (leave - enter) * (f64::from(step) + 0.5) / f64::from(STEPS);
                if leave <= enter {
                    break;
                }
                let number = depths.iter().rposition(|depth| t >= *depth).unwrap_or(0) + finest;
                let level = &views[number];
                let brick: [i32; 3] = std::array::from_fn(|axis| {
                    let place = origin[axis] + t * direction[axis];
                    let cell = (place * level.per_scale_step[axis] - 0.5).floor() as i32;
                    cell.max(0) / payload[axis] as i32
                });
                let place = place_of_brick(level, brick);
                let rank = rank_of_place(&views, place);
                assert!(rank < ranks, "case {case}: rank {rank} of {ranks}");
                if let Some((place_before, rank_before, level_before)) = last {
                    if place_before == place {
                        continue;
                    }
                    assert!(
                        rank > rank_before,
                        "case {case}, pixel {pixel}: rank {rank} of {brick:?} in level {number} \
                         after {rank_before}"
                    );
                    borders += 1;
                    changes += u32::from(level_before != number);
                }
                last = Some((place, rank, number));
            }
        }
        let eye_inside =
            (0..3).all(|axis| (0.0..f64::from(size[axis])).contains(&rays.origin_voxel[axis]));
        let is_parallel = rays.direction_column_voxel == [0.0; 4];
        parallel += u32::from(is_parallel);
        inside += u32::from(eye_inside && !is_parallel);
    }
    let seen = [borders / 100, inside, parallel, changes / 100];
    assert!(seen.iter().all(|count| *count > 5), "borders, inside, parallel, changes: {seen:?}");
}
