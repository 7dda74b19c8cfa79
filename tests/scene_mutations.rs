//! A hundred thousand mutated scene files: a scene that holds what it promises, or one sentence; never
//! a panic.

mod random;

use std::collections::HashSet;
use std::panic::catch_unwind;
use std::path::Path;

use ashfall::scene::{Overrides, Projection, Scene, Source};
use random::Random;

const MUTANTS: u64 = 100_000;

/// Valid scenes that use every key between them.
const SEEDS: [&str; 4] = [
    r#"format = 1
[picture]
size = [512, 256]
background = [0.0, 0.5, 1.0]
[quality]
integrator = "riemann"
step = 0.25
filter = "exact"
refine = "substitute"
level_max = 3
level_loss = 0.02
early_stop = 0.0005
[memory]
atlas_mib = 256
ram_mib = 1024
staging_mib = 16
[[volume]]
name = "bonsai"
source = "bonsai.raw"
raw = { size = [256, 256, 256], type = "u8", endian = "little" }
spacing = [1.0, 1.0, 2.5]
[[volume.channel]]
level_min = 1
level_max = 2
window = [0.0, 255.0]
transfer = [
  { at = 0.0, color = [0, 0, 0], extinction = 0.0 },
  { at = 0.5, color = [0.2, 0.4, 0.6], extinction = 0.1 },
  { at = 0.5, color = [1, 0.8, 0.6], extinction = 0.3 },
  { at = 1.0, color = [1, 1, 1], extinction = 1e3 },
]
[[view]]
name = "front"
eye = [128, 128, -400]
target = [128, 128, 128]
up = [0, 1, 0]
fov_degrees = 40
"#,
    r#"format = 1
# A comment with "quotes", and ä, ∞ and 'more'.
[[volume]]
name = "bulb \"x\" \u00e4"
source = { computed = "mandelbulb", size = [4096, 4096, 4096] }
transform = [[0.5, 0.1, 0.0, -10.0], [0.0, 0.5, 0.2, 20.0], [0.3, 0.0, -0.5, 1e3]]
channel = [{ window = [-1e3, 1e3], transfer = [{ at = 0.5, color = [0, 1, 0], extinction = 7 }] }]
[[view]]
name = "above"
eye = [1e3, -2e3, 3e3]
target = [0.0, 0.0, 0.0]
up = [0.0, 0.0, 1.0]
height = 300
[[view]]
name = "left-eye_2"
eye = [-1.0, 0.0, 0.0]
target = [1.0, 0.5, 0.25]
up = [0.0, 0.0, 1.0]
frustum = [-0.5, 0.6, -0.4, 0.3]
"#,
    r#"format = 1
quality.step = 1
quality.filter = 'hardware'
memory = { atlas_mib = 1, ram_mib = 1, staging_mib = 1 }
[[volume]]
source = "../volumes/tiff/several_channels.tif"
spacing = [0.511878, 0.511878, 0.499413]
[[volume.channel]]
index = 1
window = [0.0, 40000.0]
transfer = [{ at = 0.00, color = [0.1, 0.9, 0.2], extinction = 0.0 }]
[[volume.channel]]
index = 0
window = [640.0, 5600.0]
transfer = [{ at = 0.0, color = [0, 0, 0], extinction = 0 }, { at = 1, color = [1, 1, 1], extinction = 1 }]
[[volume]]
name = "second"
source = """
motor.nii.gz"""
[[volume.channel]]
window = [-3.5, +12.0]
transfer = [{ at = 1.0, color = [1.0, 0.9, 0.2], extinction = 1.0 }]
[[view]]
eye = [34.0, -55.0, 62.0]
target = [34.0, 33.0, 11.0]
up = [0.0, 0.0, 1.0]
fov_degrees = 0.001
"#,
    r#"format=1
volume=[{name='a',source={computed='constant',size=[1,1,1]},channel=[{window=[0,1],transfer=[{at=0,color=[0,0,0],extinction=0}]}]}]
view=[{eye=[0,0,-1e30],target=[0,0,0],up=[0,1,0],fov_degrees=179}]
"#,
];

const NUMBERS: [&str; 26] = [
    "nan",
    "-nan",
    "inf",
    "-inf",
    "0",
    "-0",
    "-0.0",
    "1",
    "-1",
    "0.5",
    "2",
    "1e308",
    "-1e308",
    "1e309",
    "1e-308",
    "5e-324",
    "3.4028235e38",
    "3.5e38",
    "1e30",
    "1.0000001e30",
    "16777216",
    "4294967296",
    "9223372036854775807",
    "-9223372036854775808",
    "9223372036854775808",
    "0x7f",
];
const WORDS: [&str; 22] = [
    "\"\"",
    "\"a\\nb\"",
    "\"\\u0000\"",
    "'exact'",
    "\"nowhere.raw\"",
    "true",
    "1979-05-27",
    "[]",
    "{}",
    "[[]]",
    "[[view]]",
    "[[volume]]",
    "[[volume.channel]]",
    "[picture]",
    "format",
    "size =",
    "transform",
    "height",
    "=",
    ",",
    "\n",
    "# ",
];

fn mutant(seed: u64) -> String {
    let mut random = Random(seed);
    let mut text = random.one(&SEEDS).to_owned();
    for _ in 0..[1, 1, 2, 4][random.index(4)] {
        text = match random.index(10) {
            0 => with_other_bytes(text, &mut random),
            1 | 2 => with_other_parts(&lines(&text), &mut random),
            3 | 4 => with_other_parts(&tokens(&text), &mut random),
            5..=7 => with_another_number(&text, &mut random),
            8 => with_a_word(&text, &mut random),
            _ => spliced(&text, &mut random),
        };
    }
    text
}

fn with_other_bytes(text: String, random: &mut Random) -> String {
    let mut bytes = text.into_bytes();
    for _ in 0..1 + random.index(4) {
        let at = random.index(bytes.len());
        match random.index(4) {
            0 if !bytes.is_empty() => bytes[at] = random.next() as u8,
            1 if !bytes.is_empty() => drop(bytes.remove(at)),
            2 => bytes.truncate(at),
            // Deep nesting must not overflow the stack.
            _ => {
                let many = if random.index(8) == 0 { random.index(20_000) } else { 1 };
                let byte = b"[{\"'=,.\n\\#\r\t"[random.index(12)];
                bytes.splice(at..at, std::iter::repeat_n(byte, many));
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

fn lines(text: &str) -> Vec<&str> {
    text.split_inclusive('\n').collect()
}

/// Runs of letters, digits and the like, and every other character by itself.
fn tokens(text: &str) -> Vec<&str> {
    let word = |c: char| c.is_alphanumeric() || "_.-+".contains(c);
    let mut tokens = Vec::new();
    let mut rest = text;
    while let Some(first) = rest.chars().next() {
        let end = rest.find(|c| !word(c)).filter(|end| *end > 0).unwrap_or(rest.len());
        let (token, after) = rest.split_at(if word(first) { end } else { first.len_utf8() });
        tokens.push(token);
        rest = after;
    }
    tokens
}

fn with_other_parts(parts: &[&str], random: &mut Random) -> String {
    let mut parts = parts.to_vec();
    let (a, b) = (random.index(parts.len()), random.index(parts.len()));
    match random.index(4) {
        _ if parts.is_empty() => {}
        0 => drop(parts.remove(a)),
        1 => parts.insert(b, parts[a]),
        2 => parts.swap(a, b),
        _ => parts[a] = parts[b],
    }
    parts.concat()
}

fn with_another_number(text: &str, random: &mut Random) -> String {
    let mut tokens = tokens(text);
    let numbers: Vec<usize> =
        (0..tokens.len()).filter(|index| tokens[*index].parse::<f64>().is_ok()).collect();
    if numbers.is_empty() {
        return text.to_owned();
    }
    tokens[numbers[random.index(numbers.len())]] = random.one(&NUMBERS);
    tokens.concat()
}

fn with_a_word(text: &str, random: &mut Random) -> String {
    let mut tokens = tokens(text);
    let at = random.index(tokens.len());
    let word = random.one(&WORDS);
    if random.index(2) == 0 || tokens.is_empty() {
        tokens.insert(at, word);
    } else {
        tokens[at] = word;
    }
    tokens.concat()
}

fn spliced(text: &str, random: &mut Random) -> String {
    let other = lines(random.one(&SEEDS));
    let own = lines(text);
    let (head, tail) = (random.index(own.len() + 1), random.index(other.len() + 1));
    own[..head].concat() + &other[tail..].concat()
}

/// Flags that win over the scene, good and bad, for one mutant in eight.
fn flags(seed: u64) -> Overrides {
    let mut random = Random(!seed);
    if random.index(8) > 0 {
        return Overrides::default();
    }
    let mut number = || random.one(&NUMBERS).parse::<f64>().ok();
    Overrides {
        step: number(),
        early_stop: number(),
        background: number().map(|c| [0.0, c, 1.0]),
        level_max: number().map(|level| level as i64),
        level_loss: number(),
        atlas_mib: number().map(|mib| mib as i64),
        size: number().map(|edge| [edge as u32, 8]),
        ..Overrides::default()
    }
}

/// What is wrong with a scene that was accepted.
fn broken(scene: &Scene) -> Result<(), String> {
    let hold = |holds: bool, what: &str| if holds { Ok(()) } else { Err(what.to_owned()) };
    let f32_max = f64::from(f32::MAX);
    let picture = &scene.picture;
    hold(picture.size.iter().all(|edge| (1..=32_768).contains(edge)), "picture size")?;
    hold(picture.background.iter().all(|c| c.is_finite() && *c >= 0.0), "background")?;
    let quality = &scene.quality;
    hold((1e-6..=1e6).contains(&quality.step), "step")?;
    hold((0.0..1.0).contains(&quality.early_stop), "early_stop")?;
    hold(quality.level_max.is_none_or(|level| level < 32), "level_max")?;
    hold(quality.level_loss.is_none_or(|loss| (0.0..1.0).contains(&loss)), "level_loss")?;
    for channel in scene.volumes.iter().flat_map(|volume| &volume.channels) {
        let most = channel.level_max.unwrap_or(31);
        hold(channel.level_min <= most && most < 32, "levels of a channel")?;
    }
    let memory = &scene.memory;
    for mib in [memory.atlas_mib, memory.ram_mib, memory.staging_mib] {
        hold((1..=1 << 24).contains(&mib), "memory")?;
    }
    hold(!scene.volumes.is_empty() && !scene.views.is_empty(), "a volume and a view")?;
    let names: HashSet<_> = scene.volumes.iter().map(|volume| &volume.name).collect();
    hold(names.len() == scene.volumes.len(), "volume names differ")?;
    for volume in &scene.volumes {
        hold(!volume.name.trim().is_empty(), "volume name")?;
        let size = match &volume.source {
            Source::File { raw, .. } => raw.map(|raw| raw.size),
            Source::Computed { size, .. } => Some(*size),
        };
        let edges = size.map_or([1; 3], |size| size.to_array());
        hold(edges.iter().all(|edge| (1..=1 << 24).contains(edge)), "volume size")?;
        if let Some(map) = &volume.world_from_voxel {
            hold(map.rows().iter().flatten().all(|entry| entry.is_finite()), "transform")?;
            let edges = map.spacing().to_array();
            hold(edges.iter().all(|e| *e as f32 > 0.0 && (*e as f32).is_finite()), "spacing")?;
            hold(map.voxel_from_world().is_finite(), "inverse")?;
            for view in &scene.views {
                let frame = view.ray_frame_world(picture.size).in_voxels(map);
                let (origin, direction) = frame.ray(picture.size[0] - 1, picture.size[1] - 1);
                hold(origin.is_finite() && direction.is_finite(), "rays in voxels")?;
            }
        }
        let indices: HashSet<_> = volume.channels.iter().map(|channel| channel.index).collect();
        hold(indices.len() == volume.channels.len(), "channels differ")?;
        hold((1..=16).contains(&volume.channels.len()), "channel count")?;
        for channel in &volume.channels {
            let [lo, hi] = channel.window;
            hold(lo < hi && lo.abs() <= f32_max && hi.abs() <= f32_max, "window")?;
            let points = channel.transfer.points();
            hold(!points.is_empty(), "points")?;
            hold(points.windows(2).all(|pair| pair[0].at <= pair[1].at), "order of points")?;
            hold(points.windows(3).all(|three| three[0].at < three[2].at), "jumps")?;
            for point in points {
                hold((0.0..=1.0).contains(&point.at), "at")?;
                hold((0.0..=1e24).contains(&point.extinction), "extinction")?;
                hold(point.color.iter().all(|c| (0.0..=1e8).contains(c)), "color")?;
            }
        }
    }
    let names: HashSet<_> = scene.views.iter().map(|view| &view.name).collect();
    hold(names.len() == scene.views.len(), "view names differ")?;
    for view in &scene.views {
        let plain = |c: char| c.is_alphanumeric() || "-_ ".contains(c);
        hold(!view.name.is_empty() && view.name.chars().all(plain), "view name")?;
        hold(view.eye.abs().max_element() <= 1e30, "eye")?;
        for axis in [view.forward, view.right, view.up] {
            hold((axis.length() - 1.0).abs() < 1e-9, "unit vectors")?;
        }
        let skew =
            [view.forward.dot(view.right), view.forward.dot(view.up), view.right.dot(view.up)];
        hold(skew.iter().all(|dot| dot.abs() < 1e-9), "right angles")?;
        hold(
            match view.projection {
                Projection::Perspective { fov_degrees } => (0.001..=179.0).contains(&fov_degrees),
                Projection::Orthographic { height } => height > 0.0 && height <= 1e30,
                Projection::Frustum { bounds: [left, right, bottom, top] } => {
                    left < right
                        && bottom < top
                        && [left, right, bottom, top].iter().all(|e| e.abs() <= 1e6)
                }
            },
            "projection",
        )?;
    }
    Ok(())
}

/// Whether the mutant was accepted; or what is wrong.
fn judged(text: &str, overrides: &Overrides) -> Result<bool, String> {
    let path = Path::new("folder/scene.toml");
    let scene = catch_unwind(|| Scene::from_toml(text, path, overrides))
        .map_err(|_| "a panic".to_owned())?;
    match scene {
        Ok(scene) => broken(&scene).map(|()| true).map_err(|what| format!("accepted, but: {what}")),
        Err(why) => {
            let sentence = why.to_string();
            let placed = sentence.starts_with("folder/scene.toml:") || sentence.starts_with("--");
            let one_line = !sentence.chars().any(char::is_control);
            if one_line && placed && sentence.len() > 20 {
                Ok(false)
            } else {
                Err(format!("no sentence with a place: {sentence:?}"))
            }
        }
    }
}

#[test]
fn mutated_scenes_are_scenes_or_sentences() {
    let (mut accepted, mut wrong) = (0u64, Vec::new());
    for seed in 0..MUTANTS {
        let text = mutant(seed);
        match judged(&text, &flags(seed)) {
            Ok(good) => accepted += u64::from(good),
            Err(why) => wrong.push(format!("mutant {seed}: {why}\n{text}")),
        }
    }
    wrong.truncate(3);
    assert!(wrong.is_empty(), "{}", wrong.join("\n--------\n"));
    // Both sides of the fence are walked.
    let share = accepted as f64 / MUTANTS as f64;
    assert!((0.1..0.9).contains(&share), "{accepted} of {MUTANTS} mutants were accepted");
}

#[test]
fn the_seeds_are_good_scenes() {
    for text in SEEDS {
        assert_eq!(judged(text, &Overrides::default()), Ok(true), "{text}");
    }
}

#[test]
fn a_broken_scene_is_noticed() {
    let scene = || Scene::from_toml(SEEDS[0], Path::new("a.toml"), &Overrides::default()).unwrap();
    let planted: [fn(&mut Scene); 8] = [
        |scene| scene.picture.size[1] = 0,
        |scene| scene.picture.background[2] = f32::NAN,
        |scene| scene.quality.step = f64::INFINITY,
        |scene| scene.memory.ram_mib = 0,
        |scene| scene.volumes[0].channels[0].window = [1.0, 1.0],
        |scene| scene.volumes.push(scene.volumes[0].clone()),
        |scene| scene.views[0].up = scene.views[0].right,
        |scene| scene.views[0].projection = Projection::Orthographic { height: f64::NAN },
    ];
    for plant in planted {
        let mut scene = scene();
        assert_eq!(broken(&scene), Ok(()));
        plant(&mut scene);
        assert!(broken(&scene).is_err());
    }
}
