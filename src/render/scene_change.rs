//! Another scene for a renderer that goes on: planned by any thread, taken up between two rounds.

use std::sync::{Arc, Mutex, PoisonError};

use crate::error::{Error, Result};
use crate::gpu::{Gpu, Shader, ShaderCompiler};
use crate::passes::forget;
use crate::render::image_layout::LayoutChoice;
use crate::render::plan::Plan;
use crate::render::scene_data::SceneData;
use crate::render::settings::{Addressing, Settings};

/// Other views, channels, windows or transfer functions of the volume that a renderer draws in pages. What
/// both scenes have in common stays: bricks on the device and in memory, and every object that serves both.
pub struct SceneChange {
    pub(super) plan: Plan,
    pub(super) data: SceneData,
    pub(super) forget: Shader,
}

impl SceneChange {
    /// Plans the change from what a renderer was planned as, or from what it was changed to, to `data`,
    /// whose volume has the same source. `ram_mib` stays as it was. Makes no Vulkan object.
    ///
    /// # Errors
    /// As [`Plan::new`]; and, exit code 3, when a renderer of `before` cannot go on with the scene: with
    /// the reason, so that a new one is made.
    pub fn new(
        gpu: &Gpu,
        compiler: &ShaderCompiler,
        before: &Plan,
        data: SceneData,
    ) -> Result<SceneChange> {
        let mut plan = Plan::new(gpu, compiler, &data, &before.settings_again())?;
        before.check_alike(&plan)?;
        plan.pixels_max = before.pixels_max;
        let forget = compiler.compile(&forget::variant())?;
        Ok(SceneChange { plan, data, forget })
    }

    /// What will be drawn.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }
}

impl Plan {
    /// Settings under which another scene of the volume is planned alike: voxels lie as chosen here.
    fn settings_again(&self) -> Settings {
        let chosen =
            self.paging.as_ref().map(|paging| LayoutChoice::Only(paging.layouts[0].layout));
        let addressing =
            if self.paging.is_some() { Addressing::Paged } else { self.settings.addressing };
        Settings { layout: chosen.unwrap_or(self.settings.layout), addressing, ..self.settings }
    }

    /// Refuses a plan that a renderer of this one cannot go on with.
    pub(super) fn check_alike(&self, next: &Plan) -> Result<()> {
        let unlike = match (&self.paging, &next.paging) {
            _ if self.views.len() != next.views.len() => Some("it has another number of views"),
            _ if self.pixels_max < next.pixels_max => Some("its pictures are larger"),
            (Some(paging), Some(of_next)) => paging.unlike(of_next),
            _ => Some("voxels are drawn directly"),
        };
        unlike.map_or(Ok(()), |why| {
            let cannot = "the next scene cannot take the place of this one";
            Err(Error::input(format!("{cannot}: {why}: make a new renderer for it")))
        })
    }
}

/// Where any thread leaves a scene for a renderer that may be drawing: it takes the scene up after the
/// round that is under way, and begins its view anew. Of several left in the meantime the last counts.
#[derive(Clone, Default)]
pub struct NextScene(Arc<Mutex<Option<SceneChange>>>);

impl NextScene {
    /// Leaves a scene.
    pub fn leave(&self, change: SceneChange) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(change);
    }

    pub(super) fn take(&self) -> Option<SceneChange> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    pub(super) fn is_left(&self) -> bool {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).is_some()
    }
}
