//! Random scenes of computed channels, random settings, and what goes wrong with reads.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use ashfall::error::Result;
use ashfall::import::DenseVolume;
use ashfall::render::paging::{CopyPath, PagingSettings};
use ashfall::render::{Addressing, Layout, LayoutChoice, SceneData, Settings, VolumeData};
use ashfall::scene::{Overrides, Scene};
use ashfall::source::faulty::{Failing, Fault, Faulty, Slow, Stalling};
use ashfall::source::{BrickEntry, BrickSource, Description, KINDS, computed};
use ashfall::volume::{BrickId, Size3, VolumeVoxels, VoxelFormat, WorldFromVoxel};

use crate::chance::Chance;

/// Views of every scene.
pub const VIEWS: usize = 3;

const VIEWS_TEXT: &str = r#"
[[view]]
name = "corner"
eye = [1.9, -1.1, 1.4]
target = [0.5, 0.5, 0.5]
up = [0.0, 0.0, 1.0]
fov_degrees = 36.0
[[view]]
name = "inside"
eye = [0.11, 0.17, 0.23]
target = [0.8, 0.7, 0.6]
up = [0.0, 0.0, 1.0]
fov_degrees = 70.0
[[view]]
name = "parallel"
eye = [0.5, 0.5, -2.0]
target = [0.5, 0.5, 0.5]
up = [0.0, 1.0, 0.0]
height = 1.1
"#;

/// A volume and how it is looked at.
pub struct World {
    volume: Arc<DenseVolume>,
    text: String,
    overrides: Overrides,
    /// In words, for a failure.
    pub what: String,
}

/// A volume that several faulty sources share.
pub struct Shared(Arc<DenseVolume>);

impl BrickSource for Shared {
    fn description(&self) -> &Description {
        self.0.description()
    }

    fn entry(&self, id: BrickId) -> Result<BrickEntry> {
        self.0.entry(id)
    }

    fn read(&self, id: BrickId, bytes: &mut Vec<u8>) -> Result<()> {
        self.0.read(id, bytes)
    }
}

/// What goes wrong.
pub enum Trouble {
    Nothing,
    Slow(Slow),
    Failing(Failing),
    Stalling(Stalling),
    /// The source says again and again that it has changed.
    Bumps,
}

impl Trouble {
    pub fn random(chance: &mut Chance) -> Trouble {
        match chance.below(16) {
            0 | 1 => Trouble::Slow(Slow(Duration::from_micros(chance.below(2000) as u64))),
            2 | 3 => Trouble::Failing(Failing(u64::from(chance.between(3, 9)))),
            4 => Trouble::Stalling(Stalling::default()),
            5..8 => Trouble::Bumps,
            _ => Trouble::Nothing,
        }
    }

    pub fn name(&self) -> String {
        match self {
            Trouble::Nothing => "nothing wrong".to_owned(),
            Trouble::Slow(slow) => format!("slow {:?}", slow.0),
            Trouble::Failing(failing) => format!("read {} fails", failing.0),
            Trouble::Stalling(_) => "stalling".to_owned(),
            Trouble::Bumps => "bumps".to_owned(),
        }
    }
}

impl Fault for Trouble {
    fn before(&self, read: u64, id: BrickId) -> Result<()> {
        match self {
            Trouble::Slow(slow) => slow.before(read, id),
            Trouble::Failing(failing) => failing.before(read, id),
            Trouble::Stalling(stalling) => stalling.before(read, id),
            Trouble::Nothing | Trouble::Bumps => Ok(()),
        }
    }
}

impl World {
    pub fn random(chance: &mut Chance) -> World {
        let size = Size3::from_array([(); 3].map(|()| chance.between(5, 72)));
        let longest = f64::from(size.to_array().into_iter().max().unwrap_or(1));
        let place = WorldFromVoxel::from_spacing([1.0 / longest; 3]).expect("a spacing");
        let kinds: Vec<_> = (0..chance.between(1, 4)).map(|_| chance.one(&KINDS)).collect();
        let mut text =
            "format = 1\n[[volume]]\nname = \"made\"\nsource = \"made.bricks\"\n".to_owned();
        let mut channels = Vec::new();
        for kind in &kinds {
            let field = computed(kind, size).expect("a known kind");
            let bytes = field.format() == VoxelFormat::U8 && *kind != "checkerboard";
            let color = [(); 3].map(|()| f64::from(chance.between(1, 9)) * 0.1);
            text += &format!(
                "[[volume.channel]]\nwindow = [0.0, {}]\ntransfer = [\n\
                 {{ at = 0.{}, color = {color:?}, extinction = 0.0 }},\n\
                 {{ at = 0.5, color = {color:?}, extinction = {}.5 }},\n\
                 {{ at = 1.0, color = [1.0, 0.9, 0.8], extinction = 9.0 }},\n]\n",
                if bytes { "255.0" } else { "1.0" },
                chance.between(0, 4),
                chance.between(0, 4),
            );
            channels.extend(field.whole(place).expect("small").channels);
        }
        text += VIEWS_TEXT;
        let payload = chance.one(&[8, 16, 32]);
        let voxels = VolumeVoxels { size, world_from_voxel: place, channels };
        let volume = DenseVolume::new("made", Arc::new(voxels), Size3::cube(payload));
        let overrides = Overrides {
            size: Some([(); 2].map(|()| chance.between(9, 64))),
            level_max: chance.one(&[None, Some(0), Some(1)]),
            step: Some(chance.one(&[0.5, 1.0, 2.0])),
            early_stop: chance.one(&[None, Some(0.0)]),
            ..Overrides::default()
        };
        let what = format!("{kinds:?} of {size} in bricks of {payload}, {overrides:?}");
        World { volume: Arc::new(volume), text, overrides, what }
    }

    /// Its source, which `trouble` spoils.
    pub fn source(&self, trouble: Trouble) -> Arc<Faulty<Shared, Trouble>> {
        Arc::new(Faulty::new(Shared(self.volume.clone()), trouble))
    }

    /// The scene; not `exact`: with what is resident in place of what is not.
    pub fn data(&self, source: Arc<dyn BrickSource>, exact: bool) -> SceneData {
        let refine = Some(if exact { "exact" } else { "substitute" }.to_owned());
        let overrides = Overrides { refine, ..self.overrides.clone() };
        let scene = Scene::from_toml(&self.text, Path::new("made.toml"), &overrides)
            .unwrap_or_else(|why| panic!("{}: {why}", self.what));
        let channels = (0..source.description().channels.len() as u16).collect();
        SceneData::new(scene, vec![VolumeData::new(source, channels)]).expect("drawable")
    }
}

/// Of drawing in bricks.
pub fn settings(chance: &mut Chance, patience: Duration) -> Settings {
    let paging = PagingSettings {
        atlas_slots: Some(chance.one(&[8, 9, 12, 16, 24, 40, 64, 100, 128, 200, 256, 400, 512])),
        staging_bricks: chance.one(&[None, Some(1), Some(3), Some(16)]),
        loaders: Some(chance.between(1, 8)),
        copy_path: Some(chance.one(&[CopyPath::Straight, CopyPath::Placed])),
        lockstep: chance.once_in(2),
        show_states: false,
        patience,
        ..PagingSettings::default()
    };
    Settings {
        tile: chance.one(&[[1024, 1024], [40, 24], [16, 64]]),
        submit_ms: None,
        steps_per_dispatch: chance.one(&[32, 512, 4096]),
        layout: chance.one(&[LayoutChoice::Auto, LayoutChoice::Only(Layout::Plain)]),
        addressing: Addressing::Paged,
        level_min: 0,
        level_shift: 0,
        steps_longer: 0,
        skipping: !chance.once_in(3),
        paging,
    }
}
