//! A scene together with its voxels.

use crate::error::Result;
use crate::scene::{Scene, Volume};
use crate::volume::VolumeVoxels;

/// A checked scene and the voxels of each of its volumes, in the same order.
pub struct SceneData {
    /// What to draw.
    pub scene: Scene,
    /// The channels that each volume of the scene shows.
    pub volumes: Vec<VolumeVoxels>,
}

impl SceneData {
    /// Joins a scene with its voxels.
    ///
    /// # Errors
    /// Exit code 3 for what this program cannot draw yet.
    ///
    /// # Panics
    /// When voxels do not belong to the scene: our own bug.
    pub fn new(scene: Scene, volumes: Vec<VolumeVoxels>) -> Result<SceneData> {
        assert_eq!(scene.volumes.len(), volumes.len(), "one set of voxels per volume");
        for (volume, voxels) in scene.volumes.iter().zip(&volumes) {
            assert_eq!(volume.channels.len(), voxels.channels.len(), "voxels of every channel");
        }
        SceneData::check_drawable(&scene)?;
        Ok(SceneData { scene, volumes })
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

    /// The volume that is drawn and its voxels.
    pub fn volume(&self) -> (&Volume, &VolumeVoxels) {
        (&self.scene.volumes[0], &self.volumes[0])
    }
}
