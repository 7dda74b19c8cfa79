//! A scene together with its volumes' bricks.

use std::sync::Arc;

use glam::DVec3;

use crate::error::Result;
use crate::render::volume_data::VolumeData;
use crate::scene::{Scene, Source, Volume};
use crate::volume::{VolumeVoxels, WorldFromVoxel};

/// A checked scene and the bricks of each of its volumes, in the same order.
pub struct SceneData {
    /// What to draw.
    pub scene: Scene,
    /// The channels that each volume of the scene shows.
    pub volumes: Vec<VolumeData>,
}

impl SceneData {
    /// Joins a scene with its volumes.
    ///
    /// # Errors
    /// Exit code 3 for what this program cannot draw yet.
    ///
    /// # Panics
    /// As [`SceneData::joined`].
    pub fn new(scene: Scene, volumes: Vec<VolumeData>) -> Result<SceneData> {
        SceneData::check_drawable(&scene)?;
        Ok(SceneData::joined(scene, volumes))
    }

    /// As [`SceneData::new`], for what the reference alone can draw: several volumes.
    ///
    /// # Panics
    /// When volumes do not belong to the scene: our own bug.
    pub fn joined(scene: Scene, volumes: Vec<VolumeData>) -> SceneData {
        assert_eq!(scene.volumes.len(), volumes.len(), "bricks of every volume");
        for (volume, data) in scene.volumes.iter().zip(&volumes) {
            assert_eq!(volume.channels.len(), data.channels.len(), "bricks of every channel");
        }
        let placed = scene.volumes.iter().zip(volumes).map(|(volume, data)| data.placed(volume));
        let volumes = placed.collect();
        SceneData { scene, volumes }
    }

    /// Another scene of the same volumes and channels.
    ///
    /// # Errors
    /// As [`SceneData::new`].
    ///
    /// # Panics
    /// As [`SceneData::joined`].
    pub fn again(&self, scene: Scene) -> Result<SceneData> {
        SceneData::new(scene, self.volumes.clone())
    }

    /// What can be said before any voxel is read.
    ///
    /// # Errors
    /// As [`SceneData::new`].
    pub fn check_drawable(scene: &Scene) -> Result<()> {
        if let [_, second, ..] = &scene.volumes[..] {
            return Err(second.place.error(format!(
                "volume \"{}\" is the scene's second, and several volumes in one scene are not built yet: leave one",
                second.name
            )));
        }
        Ok(())
    }

    /// The middle of a volume, world.
    pub fn middle_world(&self, volume: usize) -> DVec3 {
        let size = self.volumes[volume].source.description().size().to_array();
        self.world_from_voxel(volume).point(DVec3::from_array(size.map(f64::from)) / 2.0)
    }

    /// Voxel (corner origin) of a volume's level 0 to world: what the scene states wins.
    pub fn world_from_voxel(&self, volume: usize) -> WorldFromVoxel {
        self.volumes[volume].world_from_voxel()
    }

    /// Whether every volume may be had whole: `ram_mib` holds each. Reads nothing.
    ///
    /// # Errors
    /// One sentence at the volume's place, exit code 3.
    pub fn check_memory(&self) -> Result<()> {
        (0..self.volumes.len()).try_for_each(|volume| self.check_memory_of(volume))
    }

    fn check_memory_of(&self, index: usize) -> Result<()> {
        let volume = &self.scene.volumes[index];
        let remedy = match volume.source {
            Source::Computed { .. } => "lower size or raise --ram-mib",
            Source::File { .. } => "raise --ram-mib",
        };
        let checked = self.volumes[index].check_memory(self.scene.memory.ram_mib, remedy);
        checked.map_err(|why| volume.at(why))
    }

    /// All voxels of level 0 that a volume shows, if `ram_mib` allows.
    ///
    /// # Errors
    /// As [`SceneData::check_memory`] and [`VolumeData::whole`], at the volume's place.
    pub fn whole(&self, index: usize) -> Result<Arc<VolumeVoxels>> {
        self.check_memory_of(index)?;
        self.volumes[index].whole().map_err(|why| self.scene.volumes[index].at(why))
    }

    /// All voxels of a level of a volume, if `ram_mib` allows for level 0.
    ///
    /// # Errors
    /// As [`SceneData::whole`].
    ///
    /// # Panics
    /// When there is no such level: our own bug.
    pub fn level(&self, index: usize, level: u8) -> Result<Arc<VolumeVoxels>> {
        self.check_memory_of(index)?;
        self.volumes[index].level(level).map_err(|why| self.scene.volumes[index].at(why))
    }

    /// The volume that is drawn and all its voxels.
    ///
    /// # Errors
    /// As [`SceneData::whole`].
    pub fn volume(&self) -> Result<(&Volume, Arc<VolumeVoxels>)> {
        Ok((&self.scene.volumes[0], self.whole(0)?))
    }
}
