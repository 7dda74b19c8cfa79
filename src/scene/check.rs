//! From the file as written to a scene that cannot be wrong.

use std::collections::HashSet;
use std::ops::Range;
use std::path::Path;

use glam::DVec3;
use toml::Spanned;

use crate::error::{Error, Result};
use crate::scene::check_channel::checked_level;
use crate::scene::file::{PathFile, RawFile, SceneFile, SourceFile, ViewFile, VolumeFile};
use crate::scene::{
    CameraPath, Filter, Integrator, Memory, Overrides, Picture, Place, Projection, Quality, Refine,
    Scene, Source, View, Volume, names_files,
};
use crate::volume::{RawLayout, Size3, VoxelFormat, WorldFromVoxel};

/// Pixels along one side: what every Vulkan device's limits and our picture buffers can hold.
const PICTURE_EDGE_PIXELS_MAX: i64 = 32_768;
/// Voxels along one axis: positions keep their integer part in 31 bits with room for differences.
const VOLUME_EDGE_VOXELS_MAX: i64 = 1 << 24;
/// World units: lengths and places beyond have no picture in f32.
const WORLD_MAX: f64 = 1e30;
/// Voxel edges below have no picture either.
const WORLD_MIN: f64 = 1e-30;
/// Channels of one volume drawn in one pass.
const CHANNELS_MAX: usize = 16;

impl Scene {
    /// Reads and checks a scene file.
    ///
    /// # Errors
    /// Exit code 3 at a place in the file, or 2 at a flag, with the remedy.
    pub fn load(path: &Path, overrides: &Overrides) -> Result<Scene> {
        let bytes = std::fs::read(path)
            .map_err(|why| Error::input(format!("{}: cannot be read: {why}", path.display())))?;
        let text = String::from_utf8(bytes).map_err(|why| {
            let at = why.utf8_error().valid_up_to();
            let before = String::from_utf8_lossy(&why.as_bytes()[..at]);
            Place::in_file(path, &before, &(at..at))
                .error("is not UTF-8 from here on: a scene is a TOML file, saved as UTF-8")
        })?;
        Scene::from_toml(&text, path, overrides)
    }

    /// Checks a scene given as text; `path` is named in messages and anchors relative paths.
    ///
    /// # Errors
    /// As [`Scene::load`].
    pub fn from_toml(text: &str, path: &Path, overrides: &Overrides) -> Result<Scene> {
        let check = Check { path, text };
        let file: SceneFile = toml::from_str(text).map_err(|why| check.not_a_scene(why))?;
        check.scene(file, overrides)
    }
}

impl Quality {
    /// What a scene has that says nothing of quality, with these flags.
    ///
    /// # Errors
    /// Exit code 2 at a flag, with the remedy.
    pub fn of_flags(overrides: &Overrides) -> Result<Quality> {
        let check = Check { path: Path::new(""), text: "" };
        check.quality(super::file::QualityFile::default(), overrides)
    }
}

/// A value and where it was said.
pub(super) struct Located<T> {
    pub value: T,
    pub place: Place,
}

/// A scene file that is being checked.
pub(super) struct Check<'a> {
    path: &'a Path,
    text: &'a str,
}

impl Check<'_> {
    pub(super) fn place(&self, span: &Range<usize>) -> Place {
        Place::in_file(self.path, self.text, span)
    }

    fn start(&self) -> Place {
        self.place(&(0..0))
    }

    /// What TOML or the types of keys refuse, with the key's name.
    fn not_a_scene(&self, mut why: toml::de::Error) -> Error {
        let span = why.span().unwrap_or(0..0);
        // Without the text at hand, the error tells the key instead of drawing the place.
        why.set_input(None);
        let said = why.to_string();
        let message = why.message().trim().replace('\n', ", ");
        let key = said.rsplit_once("\nin `").map(|(_, key)| key.trim_end().trim_end_matches('`'));
        let remedy = match key {
            Some(list @ ("volume" | "view" | "volume.channel"))
                if message.contains("expected a sequence") =>
            {
                format!(": write it in double brackets, [[{list}]]")
            }
            _ => String::new(),
        };
        let message = match (key, self.text.get(span.clone())) {
            (Some(key), _) => format!("{key}: {message}{remedy}"),
            (None, Some(word)) if message == "duplicate key" => {
                format!("{} is given twice: leave one", word.trim())
            }
            _ => message,
        };
        self.place(&span).error(message)
    }

    pub(super) fn located<T>(&self, value: Spanned<T>) -> Located<T> {
        let place = self.place(&value.span());
        Located { value: value.into_inner(), place }
    }

    /// The flag's value, else the file's, else the default.
    fn pick<T>(
        &self,
        flag: Option<T>,
        name: &'static str,
        file: Option<Spanned<T>>,
        default: T,
    ) -> Located<T> {
        self.pick_optional(flag, name, file)
            .unwrap_or_else(|| Located { value: default, place: self.start() })
    }

    fn pick_optional<T>(
        &self,
        flag: Option<T>,
        name: &'static str,
        file: Option<Spanned<T>>,
    ) -> Option<Located<T>> {
        match flag {
            Some(value) => Some(Located { value, place: Place::Flag(name) }),
            None => file.map(|value| self.located(value)),
        }
    }

    fn scene(&self, file: SceneFile, overrides: &Overrides) -> Result<Scene> {
        match file.format.map(|format| self.located(format)) {
            None => {
                return Err(self
                    .start()
                    .error("a scene starts with `format = 1`, which is missing"));
            }
            Some(format) if format.value != 1 => {
                return Err(format.place.error(format!(
                    "format {} is not known: this program reads format 1",
                    format.value
                )));
            }
            Some(_) => {}
        }
        let picture = self.picture(file.picture, overrides)?;
        let quality = self.quality(file.quality, overrides)?;
        let memory = self.memory(file.memory, overrides)?;
        if file.volume.is_empty() {
            return Err(self.start().error("a scene needs at least one [[volume]]"));
        }
        if file.view.is_empty() {
            return Err(self.start().error("a scene needs at least one [[view]]"));
        }
        let mut names = HashSet::new();
        let mut volumes = Vec::new();
        for (index, volume) in file.volume.into_iter().enumerate() {
            let place = self.place(&volume.span());
            let volume = self.volume(index, self.located(volume))?;
            if !names.insert(volume.name.clone()) {
                return Err(place.error(format!("two volumes are named \"{}\"", volume.name)));
            }
            volumes.push(volume);
        }
        names.clear();
        let mut views = Vec::new();
        for (index, view) in file.view.into_iter().enumerate() {
            let place = self.place(&view.span());
            let view = self.view(index, self.located(view))?;
            if !names.insert(view.name.clone()) {
                return Err(place.error(format!("two views are named \"{}\"", view.name)));
            }
            views.push(view);
        }
        let path = file.path.map(|path| self.path(path, &views)).transpose()?;
        Ok(Scene { picture, quality, memory, volumes, views, path })
    }

    fn path(&self, file: PathFile, views: &[View]) -> Result<CameraPath> {
        let mut through = Vec::new();
        for name in file.through.into_iter().map(|name| self.located(name)) {
            if !views.iter().any(|view| view.name == name.value) {
                let name_text = name.value.escape_debug();
                return Err(name
                    .place
                    .error(format!("the path goes through \"{name_text}\", which is no view")));
            }
            through.push(name.value);
        }
        let default = CameraPath::FRAMES_DEFAULT.into();
        let frames = self.pick(None, "--frames", file.frames, default);
        let checked = u32::try_from(frames.value).ok();
        let Some(frames) = checked.filter(|of| (1..=CameraPath::FRAMES_MAX).contains(of)) else {
            let most = CameraPath::FRAMES_MAX;
            return Err(frames
                .place
                .error(format!("a path has 1 to {most} frames, got {}", frames.value)));
        };
        Ok(CameraPath { through, frames, closed: file.closed.unwrap_or(false) })
    }

    fn picture(&self, file: super::file::PictureFile, overrides: &Overrides) -> Result<Picture> {
        let size = self.pick(
            overrides.size.map(|size| size.map(i64::from)),
            "--size",
            file.size,
            [512, 512],
        );
        if !size.value.iter().all(|edge| (1..=PICTURE_EDGE_PIXELS_MAX).contains(edge)) {
            return Err(size.place.error(format!(
                "picture size must be 1 to {PICTURE_EDGE_PIXELS_MAX} pixels a side, got {} x {}",
                size.value[0], size.value[1]
            )));
        }
        let background = self.pick(overrides.background, "--background", file.background, [0.0; 3]);
        let in_range = |c: &f64| (0.0..=f64::from(f32::MAX)).contains(c);
        if !background.value.iter().all(in_range) {
            return Err(background.place.error(format!(
                "background must be finite and not negative, got {:?}",
                background.value
            )));
        }
        Ok(Picture {
            size: size.value.map(|edge| edge as u32),
            background: background.value.map(|c| c as f32),
        })
    }

    fn quality(&self, file: super::file::QualityFile, overrides: &Overrides) -> Result<Quality> {
        let integrator = self.pick(
            overrides.integrator.clone(),
            "--integrator",
            file.integrator,
            "riemann".to_owned(),
        );
        let known = Integrator::ALL.into_iter().find(|known| known.name() == integrator.value);
        let integrator = known.ok_or_else(|| {
            integrator.place.error(format!(
                "integrator \"{}\" is not known: use \"riemann\", \"preintegrated\" or \"adaptive\"",
                integrator.value
            ))
        })?;
        let tolerance = self.pick_optional(overrides.tolerance, "--tolerance", file.tolerance);
        if let Some(tolerance) = &tolerance {
            let got = tolerance.value;
            if !(Quality::TOLERANCE_LEAST..1.0).contains(&got) {
                return Err(tolerance.place.error(format!(
                    "tolerance must be at least {} and less than 1, got {got}",
                    Quality::TOLERANCE_LEAST
                )));
            }
            if !integrator.has_tolerance() {
                return Err(tolerance.place.error(format!(
                    "tolerance belongs to the integrator \"adaptive\", not to \"{}\": set step instead",
                    integrator.name()
                )));
            }
        }
        let step = self.pick(overrides.step, "--step", file.step, 0.5);
        if !(1e-6..=1e6).contains(&step.value) {
            return Err(step.place.error(format!(
                "step must be within 1e-6 and 1e6 voxel edges, got {}",
                step.value
            )));
        }
        let filter =
            self.pick(overrides.filter.clone(), "--filter", file.filter, "exact".to_owned());
        let filter = match filter.value.as_str() {
            "exact" => Filter::Exact,
            "hardware" => Filter::Hardware,
            other => {
                return Err(filter.place.error(format!(
                    "filter \"{other}\" is not known: use \"exact\" or \"hardware\""
                )));
            }
        };
        let refine =
            self.pick(overrides.refine.clone(), "--refine", file.refine, "exact".to_owned());
        let refine = match refine.value.as_str() {
            "exact" => Refine::Exact,
            "substitute" => Refine::Substitute,
            other => {
                return Err(refine.place.error(format!(
                    "refine \"{other}\" is not known: use \"exact\" or \"substitute\""
                )));
            }
        };
        let level_max = self
            .pick_optional(overrides.level_max, "--level-max", file.level_max)
            .map(|level| {
                checked_level(&level).map_err(|why| level.place.error(format!("level_max {why}")))
            })
            .transpose()?;
        let level_loss = self.pick_optional(overrides.level_loss, "--level-loss", file.level_loss);
        if let Some(loss) = level_loss.as_ref().filter(|loss| !(0.0..1.0).contains(&loss.value)) {
            return Err(loss.place.error(format!(
                "level_loss must be at least 0 and less than 1, got {}",
                loss.value
            )));
        }
        let early_stop = self.pick(overrides.early_stop, "--early-stop", file.early_stop, 0.0005);
        if !(0.0..1.0).contains(&early_stop.value) {
            return Err(early_stop.place.error(format!(
                "early_stop must be at least 0 (never) and less than 1, got {}",
                early_stop.value
            )));
        }
        Ok(Quality {
            integrator,
            step: step.value,
            filter,
            refine,
            level_max,
            level_loss: level_loss.map(|loss| loss.value),
            early_stop: early_stop.value,
            tolerance: tolerance.map_or(Quality::TOLERANCE_DEFAULT, |tolerance| tolerance.value),
        })
    }

    fn memory(&self, file: super::file::MemoryFile, overrides: &Overrides) -> Result<Memory> {
        let mib = |flag, name, file, key: &str, default| {
            let picked = self.pick(flag, name, file, default);
            u64::try_from(picked.value).ok().filter(|mib| (1..=1 << 24).contains(mib)).ok_or_else(
                || {
                    picked.place.error(format!(
                        "{key} must be 1 to {} MiB, got {}",
                        1 << 24,
                        picked.value
                    ))
                },
            )
        };
        Ok(Memory {
            atlas_mib: mib(overrides.atlas_mib, "--atlas-mib", file.atlas_mib, "atlas_mib", 256)?,
            ram_mib: mib(overrides.ram_mib, "--ram-mib", file.ram_mib, "ram_mib", 1024)?,
            staging_mib: mib(
                overrides.staging_mib,
                "--staging-mib",
                file.staging_mib,
                "staging_mib",
                16,
            )?,
        })
    }

    fn volume(&self, index: usize, file: Located<VolumeFile>) -> Result<Volume> {
        let Located { value: file, place } = file;
        let name = match file.name.map(|name| self.located(name)) {
            None => format!("volume {index}"),
            Some(name) if name.value.trim().is_empty() => {
                return Err(name.place.error("a volume's name must not be empty"));
            }
            Some(name) => name.value,
        };
        let refuse = |place: &Place, why: &str| place.error(format!("volume \"{name}\": {why}"));
        let Some(source) = file.source.map(|source| self.located(source)) else {
            return Err(refuse(&place, "source is missing: name a file or { computed = \"...\" }"));
        };
        let source_place = source.place;
        let source = match source.value {
            SourceFile::Path(path) if path.is_empty() => {
                return Err(refuse(&source_place, "source must not be empty"));
            }
            SourceFile::Path(path) => {
                let raw = match (file.raw, import_knows(&path)) {
                    (Some(raw), Some(ending)) => {
                        let why =
                            format!("raw belongs to raw files, not to {ending}: leave it out");
                        return Err(refuse(&self.place(&raw.span()), &why));
                    }
                    (None, None) if is_raw(&path) => {
                        let why = "a raw file does not say how its voxels lie: \
                            add raw = { size = [x, y, z], type = \"u8\" }";
                        return Err(refuse(&source_place, why));
                    }
                    (raw, _) => raw.map(|raw| self.raw(&name, raw.into_inner())).transpose()?,
                };
                let folder = self.path.parent().unwrap_or(Path::new(""));
                Source::File { path: folder.join(path), raw }
            }
            SourceFile::Computed(computed) => {
                if let Some(raw) = file.raw {
                    return Err(refuse(
                        &self.place(&raw.span()),
                        "raw belongs to a raw file, not to a computed source",
                    ));
                }
                let size = self.size3(&name, self.located(computed.size))?;
                Source::Computed { kind: computed.computed.into_inner(), size }
            }
        };
        let spacing = file.spacing.map(|spacing| self.located(spacing));
        let transform = file.transform.map(|transform| self.located(transform));
        let world_from_voxel = match (spacing, transform) {
            (Some(_), Some(transform)) => {
                return Err(refuse(&transform.place, "give spacing or transform, not both"));
            }
            (Some(spacing), None) => Some(
                WorldFromVoxel::from_spacing(spacing.value)
                    .and_then(|map| within_world(map, "spacing"))
                    .map_err(|why| refuse(&spacing.place, &why.message))?,
            ),
            (None, Some(transform)) => Some(
                WorldFromVoxel::from_rows(transform.value)
                    .and_then(|map| within_world(map, "transform"))
                    .map_err(|why| refuse(&transform.place, &why.message))?,
            ),
            (None, None) => None,
        };
        if file.channel.is_empty() {
            return Err(refuse(&place, "needs at least one [[volume.channel]]"));
        }
        if file.channel.len() > CHANNELS_MAX {
            return Err(refuse(
                &place,
                &format!("shows {} channels, at most {CHANNELS_MAX} at once", file.channel.len()),
            ));
        }
        let mut channels = Vec::new();
        let mut indices = HashSet::new();
        for (position, channel) in file.channel.into_iter().enumerate() {
            let place = self.place(&channel.span());
            let channel = self.channel(&name, position, self.located(channel))?;
            if matches!(source, Source::Computed { .. }) && channel.index > 0 {
                let why = "is not there: a computed source has one channel, index 0";
                return Err(refuse(&place, &format!("channel index {} {why}", channel.index)));
            }
            if !indices.insert(channel.index) {
                return Err(refuse(&place, &format!("shows channel {} twice", channel.index)));
            }
            channels.push(channel);
        }
        Ok(Volume { name, source, world_from_voxel, channels, place: source_place })
    }

    fn raw(&self, volume: &str, file: RawFile) -> Result<RawLayout> {
        let size = self.size3(volume, self.located(file.size))?;
        let format = self.located(file.format);
        let known = VoxelFormat::from_name(&format.value)
            .filter(|format| *format != VoxelFormat::Rgba8)
            .ok_or_else(|| {
                format.place.error(format!(
                    "volume \"{volume}\": raw type \"{}\" is not known: use u8, u16, i16 or f32",
                    format.value
                ))
            })?;
        let big_endian = match file.endian.map(|endian| self.located(endian)) {
            None => false,
            Some(endian) => match endian.value.as_str() {
                "little" => false,
                "big" => true,
                other => {
                    return Err(endian.place.error(format!(
                        "volume \"{volume}\": endian \"{other}\" is not known: use \"little\" or \"big\""
                    )));
                }
            },
        };
        Ok(RawLayout { size, format: known, big_endian })
    }

    fn size3(&self, volume: &str, size: Located<[i64; 3]>) -> Result<Size3> {
        if size.value.iter().all(|edge| (1..=VOLUME_EDGE_VOXELS_MAX).contains(edge)) {
            return Ok(Size3::from_array(size.value.map(|edge| edge as u32)));
        }
        Err(size.place.error(format!(
            "volume \"{volume}\": size must be 1 to {VOLUME_EDGE_VOXELS_MAX} voxels along each axis, got {:?}",
            size.value
        )))
    }

    fn view(&self, index: usize, file: Located<ViewFile>) -> Result<View> {
        let Located { value: file, place } = file;
        let name = match file.name.map(|name| self.located(name)) {
            None => format!("view{index}"),
            Some(name) => {
                if !names_files(&name.value) {
                    return Err(name.place.error(format!(
                        "view \"{}\": a view's name is made of letters, digits, blanks, - and _",
                        name.value.escape_debug()
                    )));
                }
                name.value
            }
        };
        let refuse = |place: &Place, why: &str| place.error(format!("view \"{name}\": {why}"));
        let point = |key: &str, value: Option<Spanned<[f64; 3]>>| -> Result<Located<DVec3>> {
            let Some(value) = value.map(|value| self.located(value)) else {
                return Err(refuse(&place, &format!("{key} = [x, y, z] is missing")));
            };
            let vector = DVec3::from_array(value.value);
            if vector.abs().max_element() <= WORLD_MAX && vector.is_finite() {
                return Ok(Located { value: vector, place: value.place });
            }
            let why = format!("{key} must be finite and within 1e30, got {:?}", value.value);
            Err(refuse(&value.place, &why))
        };
        let eye = point("eye", file.eye)?;
        let target = point("target", file.target)?;
        let up = point("up", file.up)?;
        let fov = file.fov_degrees.map(|fov| self.located(fov));
        let height = file.height.map(|height| self.located(height));
        let frustum = file.frustum.map(|frustum| self.located(frustum));
        let projection = match (fov, height, frustum) {
            (Some(fov), None, None) => {
                if !(0.001..=179.0).contains(&fov.value) {
                    let why =
                        format!("fov_degrees must be within 0.001 and 179, got {}", fov.value);
                    return Err(refuse(&fov.place, &why));
                }
                Projection::Perspective { fov_degrees: fov.value }
            }
            (None, Some(height), None) => {
                if !(height.value > 0.0 && height.value <= WORLD_MAX) {
                    let why = format!("height must be positive and finite, got {}", height.value);
                    return Err(refuse(&height.place, &why));
                }
                Projection::Orthographic { height: height.value }
            }
            (None, None, Some(frustum)) => {
                let [left, right, bottom, top] = frustum.value;
                let bounded = frustum.value.iter().all(|edge| edge.abs() <= 1e6);
                if !(bounded && left < right && bottom < top) {
                    let why = format!(
                        "frustum must be [left, right, bottom, top] with left < right and bottom < top, got {:?}",
                        frustum.value
                    );
                    return Err(refuse(&frustum.place, &why));
                }
                Projection::Frustum { bounds: frustum.value }
            }
            _ => {
                return Err(refuse(&place, "give one of fov_degrees, height and frustum"));
            }
        };
        View::looking_at(name.clone(), eye.value, target.value, up.value, projection)
            .map_err(|(key, why)| refuse(if key == "up" { &up.place } else { &target.place }, why))
    }
}

/// Refuses voxels whose edges, or a place that, f32 cannot hold with room for products.
fn within_world(map: WorldFromVoxel, key: &str) -> Result<WorldFromVoxel> {
    let edges = map.spacing().to_array();
    let origin = map.point(DVec3::ZERO).abs().max_element();
    if edges.iter().all(|edge| (WORLD_MIN..=WORLD_MAX).contains(edge)) && origin <= WORLD_MAX {
        return Ok(map);
    }
    Err(Error::input(format!(
        "{key} must give voxel edges within {WORLD_MIN:e} and {WORLD_MAX:e} and an origin within {WORLD_MAX:e}, got edges {edges:?}"
    )))
}

/// Endings of files that say themselves how their voxels lie.
fn import_knows(path: &str) -> Option<&'static str> {
    const ENDINGS: [&str; 12] = [
        ".bricks", ".nii", ".nii.gz", ".nrrd", ".nhdr", ".mha", ".mhd", ".tif", ".tiff", ".npy",
        ".vti", ".segy",
    ];
    let path = path.to_ascii_lowercase();
    ENDINGS.into_iter().find(|ending| path.ends_with(ending))
}

/// Whether a file's name says that it holds voxels and nothing else.
fn is_raw(path: &str) -> bool {
    let path = path.to_ascii_lowercase();
    let plain = path.strip_suffix(".gz").or(path.strip_suffix(".zst")).unwrap_or(&path);
    plain.ends_with(".raw") || plain.ends_with(".bin")
}
