//! Random volumes and cameras, as the shaders take them.

use crate::random::Random;
use ashfall::scene::{Projection, View};
use ashfall::twins::ray_setup::ViewRays;
use ashfall::volume::WorldFromVoxel;
use glam::{DMat3, DVec3};

pub fn pick<T: Copy>(random: &mut Random, from: &[T]) -> T {
    from[(random.unit() * from.len() as f64) as usize]
}

pub fn unit_vector(random: &mut Random) -> DVec3 {
    loop {
        let v = DVec3::from_array([0; 3].map(|_| random.between(-1.0, 1.0)));
        if v.length() > 0.1 {
            return v.normalize();
        }
    }
}

/// A box of voxels anywhere in the world.
pub struct Placed {
    pub size: [u32; 3],
    pub world_from_voxel: WorldFromVoxel,
}

pub fn placed(random: &mut Random, size: [u32; 3], aslant: bool) -> Placed {
    let spacing = DVec3::from_array([0; 3].map(|_| 10f64.powf(random.between(-1.0, 1.0))));
    let turn = match aslant {
        true => DMat3::from_axis_angle(unit_vector(random), random.between(0.0, 6.0)),
        false => DMat3::IDENTITY,
    };
    let linear = turn * DMat3::from_diagonal(spacing);
    let origin = DVec3::from_array([0; 3].map(|_| random.between(-1e3, 1e3)));
    let row = |r: usize| [linear.x_axis[r], linear.y_axis[r], linear.z_axis[r], origin[r]];
    let world_from_voxel = WorldFromVoxel::from_rows([row(0), row(1), row(2)]).expect("regular");
    Placed { size, world_from_voxel }
}

impl Placed {
    pub fn point(&self, part: DVec3) -> DVec3 {
        self.world_from_voxel.point(part * DVec3::from_array(self.size.map(f64::from)))
    }

    pub fn diagonal_world(&self) -> f64 {
        self.point(DVec3::ONE).distance(self.point(DVec3::ZERO))
    }

    /// A camera that looks at a point of the volume, from outside, from far away or from inside.
    pub fn view(&self, random: &mut Random) -> View {
        let target = self.point(DVec3::from_array([0; 3].map(|_| random.unit())));
        let length = self.diagonal_world();
        let away = pick(random, &[0.2, 1.0, 1.0, 50.0]);
        let eye = target + unit_vector(random) * length * away;
        let projection = match pick(random, &[0, 1, 2]) {
            0 => Projection::Perspective { fov_degrees: pick(random, &[10.0, 50.0, 120.0]) },
            1 => Projection::Orthographic { height: length * random.between(0.1, 1.5) },
            _ => Projection::Frustum { bounds: [-0.9, 0.3, -0.1, 0.7] },
        };
        View::looking_at("view".to_owned(), eye, target, unit_vector(random), projection)
            .expect("a good view")
    }

    /// Along an axis of the world: directions have parts that are zero.
    pub fn view_along_axis(&self, random: &mut Random) -> View {
        let target = self.point(DVec3::from_array([0; 3].map(|_| random.unit())));
        let along = pick(random, &[0, 1, 2]);
        let length = self.diagonal_world() * pick(random, &[1.0, -1.0]);
        let eye = target + DVec3::AXES[along] * length;
        let up = DVec3::AXES[(along + 1) % 3];
        let projection =
            Projection::Orthographic { height: length.abs() * random.between(1e-3, 1.0) };
        View::looking_at("axis".to_owned(), eye, target, up, projection).expect("a good view")
    }

    pub fn rays(&self, view: &View, picture: [u32; 2]) -> ViewRays {
        let world = view.ray_frame_world(picture);
        let voxel = world.in_voxels(&self.world_from_voxel);
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
}
