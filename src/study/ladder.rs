//! A ladder of scenes: from the plainest, one small volume of one value, up to the fullest, each rung with
//! one feature more; and the fullest without one feature.
//!
//! Stands apart so that one list of features serves the test that holds plans to it (`tests/ladder.rs`)
//! and the bench that prices them (`feature_price`).

use std::collections::BTreeSet;
use std::fmt::Write;
use std::sync::Arc;

use crate::error::Result;
use crate::import::DenseVolume;
use crate::render::paging::{CopyPath, PagingSettings};
use crate::render::{Addressing, Layout, LayoutChoice, Plan, SceneData, Settings, VolumeData};
use crate::scene::{Overrides, Scene};
use crate::volume::{ChannelVoxels, Size3, VolumeVoxels, Voxels, WorldFromVoxel};

/// What a scene may have beyond the plainest, in the order of the ladder.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Feature {
    /// Voxels that differ.
    Field,
    /// A transfer function of more pieces than a shader selects from.
    LongTransfer,
    /// Another channel, of another format.
    SecondChannel,
    /// A channel of colours.
    Rgba,
    /// Voxels that are NaN.
    NanVoxels,
    /// Rays that end before the volume does.
    EarlyStop,
    /// Spans between samples.
    Preintegrated,
    /// Another view.
    SecondView,
    /// A picture larger than a tile.
    Tiles,
    /// Rays longer than a dispatch.
    ShortDispatches,
    /// Bricks in atlases, with a page table.
    Paged,
    /// Bricks that show nothing are crossed at once.
    Skipping,
    /// A view that uses several levels.
    SeveralLevels,
    /// Coarser levels in place of missing bricks.
    Substitute,
    /// Bricks through an upload buffer, placed by a pass.
    Placed,
    /// Tints by what rays met.
    ShowStates,
}

impl Feature {
    /// All of them, from the lowest rung up.
    pub const ALL: [Feature; 16] = [
        Feature::Field,
        Feature::LongTransfer,
        Feature::SecondChannel,
        Feature::Rgba,
        Feature::NanVoxels,
        Feature::EarlyStop,
        Feature::Preintegrated,
        Feature::SecondView,
        Feature::Tiles,
        Feature::ShortDispatches,
        Feature::Paged,
        Feature::Skipping,
        Feature::SeveralLevels,
        Feature::Substitute,
        Feature::Placed,
        Feature::ShowStates,
    ];

    /// In words.
    pub const fn name(self) -> &'static str {
        match self {
            Feature::Field => "voxels that vary",
            Feature::LongTransfer => "long transfer function",
            Feature::SecondChannel => "second channel",
            Feature::Rgba => "RGBA channel",
            Feature::NanVoxels => "NaN voxels",
            Feature::EarlyStop => "early stop",
            Feature::Preintegrated => "preintegrated",
            Feature::SecondView => "second view",
            Feature::Tiles => "tiles",
            Feature::ShortDispatches => "short dispatches",
            Feature::Paged => "paging",
            Feature::Skipping => "skipping",
            Feature::SeveralLevels => "several levels",
            Feature::Substitute => "substitute",
            Feature::Placed => "placed copies",
            Feature::ShowStates => "shown states",
        }
    }

    /// The feature without which it means nothing.
    pub const fn needs(self) -> Option<Feature> {
        match self {
            Feature::Field | Feature::SecondView | Feature::Tiles => None,
            Feature::Skipping
            | Feature::SeveralLevels
            | Feature::Substitute
            | Feature::Placed
            | Feature::ShowStates => Some(Feature::Paged),
            _ => Some(Feature::Field),
        }
    }

    /// The features of the fullest scene that are left when this one is taken away, and what needs it.
    pub fn all_without(self) -> Vec<Feature> {
        let stays = |feature: &Feature| {
            let needs = |at: &Feature| at.needs();
            !std::iter::successors(Some(*feature), needs).any(|needed| needed == self)
        };
        Feature::ALL.into_iter().filter(stays).collect()
    }
}

/// How large a ladder's scenes are.
#[derive(Clone, Copy, Debug)]
pub struct Extent {
    /// Voxels along each axis.
    pub edge: u32,
    /// Voxels of a brick along each axis.
    pub payload: u32,
    /// Pixels across and down. Several levels are in use where they are a little fewer than voxels.
    pub size: [u32; 2],
}

/// A scene with these features and no other, and how it is drawn.
///
/// # Errors
/// When this machine has no memory for it.
pub fn scene(features: &[Feature], extent: &Extent) -> Result<(SceneData, Settings)> {
    let has = |feature| features.contains(&feature);
    let overrides = Overrides { size: Some(extent.size), ..Overrides::default() };
    let scene = Scene::from_toml(&text(features, extent), "ladder".as_ref(), &overrides)?;
    let volume = VolumeVoxels {
        size: Size3::cube(extent.edge),
        world_from_voxel: WorldFromVoxel::from_spacing([1.0 / f64::from(extent.edge); 3])?,
        channels: channels(features, extent.edge),
    };
    let dense = DenseVolume::new("ladder", Arc::new(volume), Size3::cube(extent.payload));
    let whole = dense.voxels().clone();
    let data = SceneData::new(scene, vec![VolumeData::of_whole(Arc::new(dense), whole)])?;
    let paging = PagingSettings {
        copy_path: has(Feature::Placed).then_some(CopyPath::Placed),
        show_states: has(Feature::ShowStates),
        ..PagingSettings::default()
    };
    let [width, height] = extent.size;
    let all = Settings::default();
    let settings = Settings {
        tile: if has(Feature::Tiles) { [width.div_ceil(2), height.div_ceil(2)] } else { all.tile },
        steps_per_dispatch: match has(Feature::ShortDispatches) {
            true => extent.edge,
            false => all.steps_per_dispatch,
        },
        // RGBA has no other, and a feature is not to change another's texels.
        layout: LayoutChoice::Only(Layout::Plain),
        addressing: if has(Feature::Paged) { Addressing::Paged } else { Addressing::Direct },
        skipping: has(Feature::Skipping),
        paging,
        ..all
    };
    Ok((data, settings.checked()?))
}

/// Points of a long transfer function.
const LONG_POINTS: u32 = 32;

fn text(features: &[Feature], extent: &Extent) -> String {
    let has = |feature| features.contains(&feature);
    let mut text = format!(
        "format = 1\n[quality]\nintegrator = \"{}\"\nrefine = \"{}\"\nearly_stop = {}\n{}[memory]\natlas_mib = 4096\nram_mib = 4096\n",
        if has(Feature::Preintegrated) { "preintegrated" } else { "riemann" },
        if has(Feature::Substitute) { "substitute" } else { "exact" },
        if has(Feature::EarlyStop) { "0.001" } else { "0.0" },
        if has(Feature::SeveralLevels) { "" } else { "level_max = 0\n" },
    );
    let spacing = 1.0 / f64::from(extent.edge);
    // Writing into text does not fail.
    let _ = write!(
        text,
        "[[volume]]\nname = \"ladder\"\nsource = \"in memory\"\nspacing = [{spacing}, {spacing}, {spacing}]\n"
    );
    let short = "  { at = 0.0, color = [0.1, 0.2, 0.8], extinction = 0.0 },\n  \
        { at = 0.2, color = [0.2, 0.7, 0.4], extinction = 0.0 },\n  \
        { at = 1.0, color = [1.0, 0.9, 0.8], extinction = 12.0 },\n";
    let long: String = (0..LONG_POINTS)
        .map(|point| {
            let at = f64::from(point) / f64::from(LONG_POINTS - 1);
            let extinction = if at < 0.2 { 0.0 } else { at * at * 12.0 };
            format!("  {{ at = {at}, color = [{at}, 0.5, 0.3], extinction = {extinction} }},\n")
        })
        .collect();
    let mut channel = |transfer: &str, top: f64| {
        let _ =
            write!(text, "[[volume.channel]]\nwindow = [0.0, {top}]\ntransfer = [\n{transfer}]\n");
    };
    channel(if has(Feature::LongTransfer) { &long } else { short }, 1.0);
    if has(Feature::SecondChannel) {
        channel(short, 65535.0);
    }
    if has(Feature::Rgba) {
        channel(short, 255.0);
    }
    text += "[[view]]\nname = \"corner\"\neye = [1.9, -1.1, 1.4]\n";
    text += SEEN;
    if has(Feature::SecondView) {
        text += "[[view]]\nname = \"other\"\neye = [-1.4, 0.2, 1.5]\n";
        text += SEEN;
    }
    text
}

const SEEN: &str = "target = [0.5, 0.5, 0.5]\nup = [0.0, 0.0, 1.0]\nfov_degrees = 40.0\n";

fn channels(features: &[Feature], edge: u32) -> Vec<ChannelVoxels> {
    let has = |feature| features.contains(&feature);
    let rows = (0..edge).flat_map(|z| (0..edge).map(move |y| (y, z)));
    let places = rows.flat_map(|(y, z)| (0..edge).map(move |x| [x, y, z]));
    let unit = |at: u32| (f64::from(at) + 0.5) / f64::from(edge);
    // A hill around a place: nothing in most corners.
    let hill = |centre: [f64; 3]| {
        places.clone().map(move |at| {
            let square: f64 = (0..3).map(|axis| (unit(at[axis]) - centre[axis]).powi(2)).sum();
            (1.0 - square.sqrt() / 0.5).max(0.0)
        })
    };
    let hole = |index: usize| has(Feature::NanVoxels) && index.is_multiple_of(97);
    let first = hill([0.5; 3]).enumerate().map(|(index, value)| match has(Feature::Field) {
        _ if hole(index) => f32::NAN,
        true => value as f32,
        false => 0.5,
    });
    let mut all = vec![Voxels::F32(first.collect())];
    if has(Feature::SecondChannel) {
        let values = hill([0.4, 0.6, 0.5]).map(|value| (value * 65535.0) as u16);
        all.push(Voxels::U16(values.collect()));
    }
    if has(Feature::Rgba) {
        let colour = |v: f64| [v, 1.0 - v, v * v, v].map(|part| (part * 255.0) as u8);
        all.push(Voxels::Rgba8(hill([0.6, 0.4, 0.5]).map(colour).collect()));
    }
    let of = |voxels| ChannelVoxels { voxels, slope: 1.0, intercept: 0.0 };
    all.into_iter().map(of).collect()
}

/// Names of all that a plan lists: object kinds, buffers, images, passes, their bindings and the macros of
/// all their variants together.
pub fn inventory(plan: &Plan) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    names.extend(plan.objects.keys().map(|kind| format!("object {kind}")));
    names.extend(plan.buffers.iter().map(|buffer| format!("buffer {}", buffer.name)));
    names.extend(plan.images.iter().map(|image| format!("image {}", image.name)));
    for pass in &plan.passes {
        names.insert(format!("pass {}", pass.name));
        names.extend(pass.bindings.iter().map(|name| format!("binding {}.{name}", pass.name)));
        names.extend(pass.defines.iter().map(|(name, _)| format!("macro {name}")));
    }
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_needs_a_feature_goes_with_it() {
        assert_eq!(Feature::Field.all_without(), [Feature::SecondView, Feature::Tiles]);
        let unpaged = Feature::Paged.all_without();
        assert_eq!(unpaged, Feature::ALL[..10]);
        assert_eq!(Feature::Skipping.all_without().len(), Feature::ALL.len() - 1);
    }
}
